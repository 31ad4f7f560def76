//! `softtwin record`: everything on the wire into an MCAP file.

use crate::failure::usage;
use crate::live::DomainArgs;
use crate::report;
use anyhow::Result;
use indicatif::{ProgressBar, ProgressStyle};
use recording::{FreeSpace, RecordSummary, Recorder, RecorderOptions, Retention, RotateOptions};
use runtime::metrics;
use runtime::service::{self, Watchdog};
use serde_json::json;
use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use wire::thread_group::ThreadGroup;
use wire::{KeyExpr, OwnFiles};

/// How often the service manager gets a new status line, and the metrics new values.
const STATUS_EVERY: Duration = Duration::from_secs(1);

const EXAMPLES: &str = "\
Examples:
  Everything but fields, until Ctrl-C:
    softtwin record --out run.mcap
  States of two actuators for one minute, fields of the surface too:
    softtwin record 'softtwin/finger_*/state' 'softtwin/*/field/surface' \\
      --fields --seconds 60 --out run.mcap
  For months: a new file each hour, the last 48 kept (run-0001.mcap, run-0002.mcap, ...); a restart continues with the next number:
    softtwin record --out run.mcap --rotate-minutes 60 --keep 48
  The same within 20 GB, and never the last 2 GB of the disk; with a page for Prometheus:
    softtwin record --out run.mcap --rotate-minutes 60 --keep-mb 20000 \\
      --free-mb 2000 --metrics 127.0.0.1:9466

A kill or a power cut loses at most the last second; the file reads without its footer. Open it with any MCAP viewer, with \
`softtwin replay`, `softtwin export`; `softtwin-convert run.mcap` (Python client) makes a file that Foxglove and rerun draw; they read the folder of a series as one recording. On a full disk the oldest files of the \
series make room where --keep, --keep-mb or --free-mb is given; otherwise it ends with exit code 1 (what is written stays readable), \
as it does when its file is deleted, and when a topic could not be recorded to the end. SIGHUP begins a new file where there are \
several, and ends nothing: a closed terminal does not stop a recorder.";

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
    /// Stop after this number of seconds
    #[arg(long, value_name = "SECONDS", value_parser = crate::range::seconds, help_heading = "Selection")]
    seconds: Option<f64>,
    /// Begin a new file at this size, MB
    #[arg(long, value_name = "MB", value_parser = clap::value_parser!(u64).range(1..=1_000_000_000))]
    rotate_mb: Option<u64>,
    /// Begin a new file after this time, minutes
    #[arg(long, value_name = "MINUTES", value_parser = crate::range::number(0.001, 1_000_000.0))]
    rotate_minutes: Option<f64>,
    /// Keep only this number of files of this series, those of earlier runs included
    #[arg(long, value_name = "FILES", value_parser = crate::range::count(1, 1_000_000))]
    keep: Option<usize>,
    /// Keep only so much of this series, MB, earlier runs included; a file is ended at a quarter of it at the latest
    #[arg(long, value_name = "MB", value_parser = clap::value_parser!(u64).range(1..=1_000_000_000))]
    keep_mb: Option<u64>,
    /// Remove the oldest files of this series while less than so much of the disk is free, MB
    #[arg(long, value_name = "MB", value_parser = clap::value_parser!(u64).range(1..=1_000_000_000))]
    free_mb: Option<u64>,
    /// Serve Prometheus metrics at http://ADDR/metrics; loopback only [default: off]
    #[arg(long, value_name = "127.0.0.1:PORT", value_parser = metrics::loopback, help_heading = "Output")]
    metrics: Option<SocketAddr>,
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
        service::keep_memory_small();
        let options = self.options()?;
        let stop = service::stop_flag()?;
        let new_file = service::reload_flag()?;
        service::ignore_size_limit()?;
        let listener = metrics::listen(self.metrics)?;
        let domain = self.domain.domain();
        let mut recorder = Recorder::start(&domain, options)?;
        let mut group = ThreadGroup::new(stop.clone());
        let own_files = OwnFiles::of(&domain)?;
        group.start("files", move |end| service::watch_files(&own_files, end))?;
        let shown = Arc::new(Mutex::new(RecordSummary::default()));
        let (of_page, place) = (shown.clone(), self.folder());
        metrics::start(&mut group, listener, || move || page(&of_page, &place))?;
        service::notify_ready(&format!("recording to {}", self.out.display()));
        let (mut watchdog, mut next_status) = (Watchdog::from_env(), Instant::now());
        let end = self.seconds.map(|seconds| Instant::now() + Duration::from_secs_f64(seconds));
        let bar = progress();
        let (mut errors, mut skipped) = (BTreeMap::new(), BTreeMap::new());
        let ran = recorder.run(&stop, |recorder, summary| {
            bar.set_message(line(summary));
            watchdog.feed(summary.flushes);
            if Instant::now() >= next_status {
                next_status = Instant::now() + STATUS_EVERY;
                service::notify_status(&line(summary));
                lock(&shown).clone_from(summary);
            }
            if new_file.swap(false, Ordering::Relaxed) {
                service::notify_reloading();
                recorder.begin_new_file();
                bar.suspend(|| tracing::info!("reloaded: a new file is begun where there are several"));
                service::notify_reloaded();
            }
            if errors != summary.errors {
                bar.suspend(|| log_changes(&errors, &summary.errors));
                errors.clone_from(&summary.errors);
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
        service::notify_stopping();
        let ended = group.end();
        // The file is closed before anything is reported: a broken port must not cost the footer.
        let summary = recorder.finish()?;
        ran?;
        ended?;
        self.report(&summary)?;
        let unrecorded: Vec<&str> = summary.errors.values().map(String::as_str).collect();
        anyhow::ensure!(unrecorded.is_empty(), "not recorded: {}", unrecorded.join("; "));
        Ok(())
    }

    fn options(&self) -> Result<RecorderOptions> {
        let keys =
            self.keys.iter().map(|key| KeyExpr::new(key).map_err(usage)).collect::<Result<Vec<_>>>()?;
        let given = [("--keep", self.keep.is_some()), ("--keep-mb", self.keep_mb.is_some())];
        let mut given = given.into_iter().chain([("--free-mb", self.free_mb.is_some())]);
        if self.rotate_mb.is_none()
            && self.rotate_minutes.is_none()
            && let Some((option, _)) = given.find(|(_, is_given)| *is_given)
        {
            let needed =
                format!("{option} needs --rotate-mb or --rotate-minutes: without them there is one file");
            return Err(usage(needed));
        }
        let measure = |path: &Path| runtime::machine::space(path).map(|space| space.free_bytes);
        let keep = Retention {
            files: self.keep,
            total_bytes: self.keep_mb.map(|mb| mb << 20),
            free: self.free_mb.map(|mb| FreeSpace { bytes: mb << 20, measure }),
        };
        let rotate = RotateOptions {
            max_bytes: self.rotate_mb.map(|mb| mb << 20),
            max_time_ns: self.rotate_minutes.map(|minutes| (minutes * 60e9) as u64),
            keep,
        };
        let queue_bytes = self.queue_mb << 20;
        let path = self.out.clone();
        Ok(RecorderOptions { keys, with_fields: self.fields, path, rotate, queue_bytes })
    }

    /// Where the files lie.
    fn folder(&self) -> PathBuf {
        let folder = self.out.parent().filter(|folder| !folder.as_os_str().is_empty());
        folder.unwrap_or(Path::new(".")).to_owned()
    }

    fn report(&self, summary: &RecordSummary) -> Result<()> {
        let files: Vec<String> = summary.files.files.iter().map(|path| path.display().to_string()).collect();
        let found = json!({
            "messages": summary.messages,
            "missing": summary.missing,
            "dropped": summary.dropped,
            "errors": summary.errors,
            "skipped": summary.skipped,
            "written": summary.files.messages,
            "files": files,
            "files_removed": summary.files.removed,
        });
        report::print(&found, self.json)
    }
}

fn page(summary: &Mutex<RecordSummary>, folder: &Path) -> String {
    let free_bytes = runtime::machine::space(folder).map(|space| space.free_bytes).ok();
    metrics::recorder(&lock(summary), free_bytes)
}

fn lock(summary: &Mutex<RecordSummary>) -> MutexGuard<'_, RecordSummary> {
    summary.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Logs new and ended errors, not every retry.
fn log_changes(before: &BTreeMap<String, String>, now: &BTreeMap<String, String>) {
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
