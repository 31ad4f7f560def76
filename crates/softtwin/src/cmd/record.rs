//! `softtwin record`: everything on the wire into an MCAP file.

use crate::failure::usage;
use crate::live::DomainArgs;
use crate::output;
use anyhow::Result;
use indicatif::{ProgressBar, ProgressStyle};
use recording::{RecordSummary, Recorder, RecorderOptions, RotateOptions};
use serde_json::json;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};
use wire::KeyExpr;

const EXAMPLES: &str = "\
Examples:
  Everything but fields, until Ctrl-C:
    softtwin record --out run.mcap
  States of two actuators for one minute, fields of the surface too:
    softtwin record 'softtwin/finger_*/state' 'softtwin/*/field/surface' --fields --seconds 60 --out run.mcap
  For months: a new file each hour, the last 48 kept (run-0001.mcap, run-0002.mcap, ...):
    softtwin record --out run.mcap --rotate-minutes 60 --keep 48

A kill or a power cut loses at most the last second; the file reads without its footer. Open it with any MCAP viewer, with
`softtwin replay`, `softtwin export`. It ends with exit code 1 when the disk is full (what is written stays readable), when its
file is deleted, and when a topic could not be recorded to the end. A closed terminal (SIGHUP) does not end it.";

/// Record readings, states, health and, if asked, fields into MCAP files.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES)]
pub struct Args {
    /// Topics, as key expressions (`*` one chunk, `**` any)
    #[arg(value_name = "KEY", default_value = "softtwin/**")]
    keys: Vec<String>,
    /// File to write; an existing one is never overwritten
    #[arg(long, value_name = "MCAP", help_heading = "Output")]
    out: PathBuf,
    /// Record whole fields too: 5.3 bytes a value before compression, so 0.67 MB a sample of 5 fields at 25,022 nodes
    #[arg(long, help_heading = "Selection")]
    fields: bool,
    /// Stop after so many seconds
    #[arg(long, value_name = "SECONDS", value_parser = crate::range::seconds, help_heading = "Selection")]
    seconds: Option<f64>,
    /// Begin a new file at this size, MB
    #[arg(long, value_name = "MB", value_parser = clap::value_parser!(u64).range(1..=1_000_000_000))]
    rotate_mb: Option<u64>,
    /// Begin a new file after this time, minutes
    #[arg(long, value_name = "MINUTES", value_parser = crate::range::number(0.001, 1_000_000.0))]
    rotate_minutes: Option<f64>,
    /// Keep only so many files of this run
    #[arg(long, value_name = "FILES", value_parser = crate::range::count(1, 1_000_000))]
    keep: Option<usize>,
    /// Memory for what waits for the disk, MB; beyond, messages are dropped and counted
    #[arg(long, value_name = "MB", default_value_t = 64, value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    queue_mb: u64,
    /// End with one JSON object
    #[arg(long, help_heading = "Output")]
    json: bool,
    #[command(flatten)]
    domain: DomainArgs,
}

impl Args {
    /// Records until a signal, the end of the time, or a full disk.
    ///
    /// # Errors
    /// Wrong key expressions or options, an existing file, a disk that refuses.
    pub fn run(self) -> Result<()> {
        let options = self.options()?;
        let stop = runtime::service::stop_flag()?;
        runtime::service::ignore_hangup_and_size_limit()?;
        let mut recorder = Recorder::start(&self.domain.domain(), options)?;
        let end = self.seconds.map(|seconds| Instant::now() + Duration::from_secs_f64(seconds));
        let bar = progress();
        let (mut troubles, mut skipped) = (BTreeMap::new(), BTreeMap::new());
        let ran = recorder.run(&stop, |summary| {
            bar.set_message(line(summary));
            if troubles != summary.troubles {
                bar.suspend(|| say_what_is_new(&troubles, &summary.troubles));
                troubles.clone_from(&summary.troubles);
            }
            if skipped != summary.skipped {
                let is_new = |(topic, _): &(&String, &String)| !skipped.contains_key(*topic);
                let causes: Vec<&String> =
                    summary.skipped.iter().filter(is_new).map(|(_, cause)| cause).collect();
                bar.suspend(|| causes.iter().for_each(|cause| tracing::warn!("not recorded: {cause}")));
                skipped.clone_from(&summary.skipped);
            }
            if end.is_some_and(|end| Instant::now() >= end) {
                stop.store(true, Ordering::Relaxed);
            }
        });
        bar.finish_and_clear();
        // The file is closed before anything is reported: a broken port must not cost the footer.
        let summary = recorder.finish()?;
        ran?;
        self.report(&summary)?;
        let untold: Vec<&str> = summary.troubles.values().map(String::as_str).collect();
        anyhow::ensure!(untold.is_empty(), "at the end this could not be recorded: {}", untold.join("; "));
        Ok(())
    }

    fn options(&self) -> Result<RecorderOptions> {
        let keys =
            self.keys.iter().map(|key| KeyExpr::new(key).map_err(usage)).collect::<Result<Vec<_>>>()?;
        if self.keep.is_some() && self.rotate_mb.is_none() && self.rotate_minutes.is_none() {
            return Err(usage(
                "--keep needs --rotate-mb or --rotate-minutes: without them there is one file",
            ));
        }
        let rotate = RotateOptions {
            max_bytes: self.rotate_mb.map(|mb| mb << 20),
            max_time_ns: self.rotate_minutes.map(|minutes| (minutes * 60e9) as u64),
            keep: self.keep,
        };
        let queue_bytes = self.queue_mb << 20;
        Ok(RecorderOptions { keys, with_fields: self.fields, path: self.out.clone(), rotate, queue_bytes })
    }

    fn report(&self, summary: &RecordSummary) -> Result<()> {
        let files: Vec<String> = summary.files.files.iter().map(|path| path.display().to_string()).collect();
        if self.json {
            return output::json(&json!({
                "messages": summary.messages,
                "missing": summary.missing,
                "dropped": summary.dropped,
                "troubles": summary.troubles,
                "skipped": summary.skipped,
                "written": summary.files.messages,
                "files": files,
                "files_removed": summary.files.removed,
            }));
        }
        for (topic, count) in &summary.messages {
            output!("{topic}  {count} messages")?;
        }
        output!(
            "{} published samples never arrived, {} were dropped before the disk",
            summary.missing,
            summary.dropped
        )?;
        if !summary.skipped.is_empty() {
            let topics: Vec<&str> = summary.skipped.keys().map(String::as_str).collect();
            output!("{} topics of another version were skipped: {}", topics.len(), topics.join(", "))?;
        }
        output!("{} messages in {}", summary.files.messages, files.join(", "))?;
        Ok(())
    }
}

/// Troubles come and go; each is said when it comes, and when it is over, and not with every try in between.
fn say_what_is_new(before: &BTreeMap<String, String>, now: &BTreeMap<String, String>) {
    for (_, what) in now.iter().filter(|(whom, _)| !before.contains_key(*whom)) {
        tracing::warn!("cannot be recorded, tried again each second: {what}");
    }
    for whom in before.keys().filter(|whom| !now.contains_key(*whom)) {
        tracing::warn!("{whom}: recorded again");
    }
}

fn progress() -> ProgressBar {
    let style = ProgressStyle::with_template("{elapsed_precise} recording: {msg}");
    let bar = ProgressBar::new_spinner();
    bar.set_draw_target(indicatif::ProgressDrawTarget::stderr_with_hz(4));
    if let Ok(style) = style { bar.with_style(style) } else { bar }
}

fn line(summary: &RecordSummary) -> String {
    let messages: u64 = summary.messages.values().sum();
    format!(
        "{messages} messages, {} topics, {} missing, {} dropped",
        summary.messages.len(),
        summary.missing,
        summary.dropped
    )
}
