//! `softtwin learn`.

use crate::failure::unexplained;
use crate::{bench, files, memory_report, output};
use formats::log::Series;
use serde_json::{Map, Value, json};
use std::path::PathBuf;
use train::measured::{Learned, Measured, Run, learn, learn_with_memory};
use train::memory::Identified;

const EXAMPLES: &str = "\
Examples:
  A twin from one run of a bench, with its half-widths:
    softtwin learn run1.csv --log log.toml --out mine.twin
  From several runs; their differences are in the half-widths:
    softtwin learn run1.csv run2.csv --log log.toml --out mine.twin

  With memory (line, play, creep) where it improves parts that were left out:
    softtwin learn run1.csv --log log.toml --memory --out mine.twin

The model is measured, without mesh. Exit code 65: the recording teaches nothing.";

/// Learn a model from measured inputs and outputs alone.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES)]
pub struct Args {
    /// Recordings.
    #[arg(value_name = "RECORDING", required = true)]
    recordings: Vec<PathBuf>,
    /// Mapping of the columns.
    #[arg(long, value_name = "FILE.toml")]
    log: PathBuf,
    /// Identify memory of the inputs: line, play, creep (docs/memory.md).
    #[arg(long)]
    memory: bool,
    /// Model file to write.
    #[arg(long, value_name = "FILE.twin")]
    out: PathBuf,
    /// One JSON object instead of text.
    #[arg(long)]
    json: bool,
}

impl Args {
    /// Learns and writes the model.
    pub fn run(self) -> anyhow::Result<()> {
        let recordings = bench::read_all(&self.recordings, &self.log)?;
        let mut remarks = Vec::new();
        let mut data = Measured::default();
        for (recording, path) in recordings.into_iter().zip(&self.recordings) {
            remarks.extend(recording.remarks.iter().map(|remark| format!("{}: {remark}", path.display())));
            data.inputs = recording.inputs.iter().map(|series| series.name.clone()).collect();
            data.outputs = recording.outputs.iter().map(|series| series.name.clone()).collect();
            let values = |all: Vec<Series>| all.into_iter().map(|series| series.values).collect();
            data.runs.push(Run {
                time_s: recording.time_s,
                inputs: values(recording.inputs),
                outputs: values(recording.outputs),
            });
        }
        let name = self.out.file_stem().map_or("measured".into(), |stem| stem.to_string_lossy().into_owned());
        let (learned, found) = if self.memory {
            let (learned, found) = learn_with_memory(&name, &data).map_err(unexplained)?;
            (learned, Some(found))
        } else {
            (learn(&name, &data).map_err(unexplained)?, None)
        };
        remarks.extend(learned.remarks.iter().cloned());
        remarks.extend(found.iter().flat_map(|found| found.remarks.iter().cloned()));
        files::save(&self.out, &learned.model.to_bytes()?)?;
        if self.json {
            return output::json(&as_json(&learned, found.as_ref(), &remarks));
        }
        output!(
            "{}: measured, {} rows, inputs {}; {}",
            self.out.display(),
            learned.rows,
            learned.inputs.join(", "),
            learned.kernel
        )?;
        output!(
            "  {:<20}{:>12}{:>12}{:>14}{:>14}{:>20}",
            "output",
            "range",
            "noise",
            "RMS left out",
            "half-width",
            "loading/unloading"
        )?;
        for report in &learned.outputs {
            output!(
                "  {:<20}{:>12.4}{:>12.4}{:>14.4}{:>14.4}{:>18.1} %",
                report.name,
                report.range,
                report.noise,
                report.rms,
                report.half_width,
                100.0 * report.loop_share
            )?;
        }
        output!(
            "  RMS error on left-out parts {:.1} % of the length of the outputs' range",
            100.0 * learned.error_share
        )?;
        if let Some(found) = &found {
            memory_report::print(found)?;
        }
        for remark in &remarks {
            output!("  note: {remark}")?;
        }
        Ok(())
    }
}

fn as_json(learned: &Learned, found: Option<&Identified>, remarks: &[String]) -> Value {
    let outputs: Map<String, Value> = learned
        .outputs
        .iter()
        .map(|report| {
            let value = json!({"range": report.range, "noise": report.noise, "rms": report.rms,
                "half_width": report.half_width, "loop_share": report.loop_share, "explained": report.explained});
            (report.name.clone(), value)
        })
        .collect();
    json!({"source": "measured", "rows": learned.rows, "inputs": learned.inputs, "outputs": outputs, "kernel": learned.kernel,
        "memory": found.map(memory_report::as_json), "turns": learned.turns, "error_share": learned.error_share, "remarks": remarks})
}
