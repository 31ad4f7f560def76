//! `softtwin learn`.

use crate::failure::{configuration, unexplained};
use crate::{files, report};
use formats::log::Recording;
use serde::Serialize;
use std::path::{Path, PathBuf};
use train::measured::{Corrected, LearningReport, Measured, MeasuredError, MeasuredStates, correct, learn};

const EXAMPLES: &str = "\
Examples:
  A twin from one run of a bench, with its half-widths:
    softtwin learn run1.csv --log log.toml --out mine.twin
  From several runs; their differences are in the half-widths:
    softtwin learn run1.csv run2.csv --log log.toml --out mine.twin

  A finite-element model with the measured difference of its angle and markers:
    softtwin learn run1.csv --log log.toml --model finger.twin --out mine.twin

Without --model the model is measured, without mesh. With it, the outputs of the mapping are observables of the model or coordinates \
of its node sets; they move the leading modes of the field and get offsets for the rest, smooth over the inputs and 0 where nothing was \
measured. Exit code 65: the model explains too little of the recording.";

/// Make a model of measurements, or correct a finite-element model by them: from recordings of a bench.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES)]
pub struct Args {
    /// Recordings.
    #[arg(value_name = "RECORDING", required = true)]
    recordings: Vec<PathBuf>,
    /// Mapping of the columns.
    #[arg(long, value_name = "FILE.toml")]
    log: PathBuf,
    /// Finite-element model that gets the measured difference; default: measurements alone.
    #[arg(long, value_name = "FILE.twin")]
    model: Option<PathBuf>,
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
        let runs = self.recordings.iter().map(|run| files::bench_run(run, &self.log));
        let recordings = runs.collect::<anyhow::Result<Vec<_>>>()?;
        let mut remarks = Vec::new();
        for (recording, path) in recordings.iter().zip(&self.recordings) {
            remarks.extend(recording.remarks.iter().map(|remark| format!("{}: {remark}", path.display())));
        }
        if let Some(model) = &self.model {
            return self.correct(model, &recordings, remarks);
        }
        let name = self.out.file_stem().map_or("measured".into(), |stem| stem.to_string_lossy().into_owned());
        let mut learned = learn(&name, &Measured::of(recordings)).map_err(unexplained)?;
        learned.remarks.splice(0..0, remarks);
        files::save(&self.out, &learned.model.to_bytes()?)?;
        let title = format!("{}: measured", self.out.display());
        let learned = LearningReport::of(&learned);
        report::print(&LearnedModel { title, learned }, self.json)
    }

    /// Adds the measured difference to a finite-element model.
    fn correct(&self, path: &Path, recordings: &[Recording], mut remarks: Vec<String>) -> anyhow::Result<()> {
        let mut model = files::model(path)?;
        if model.is_measured() {
            return Err(configuration(anyhow::anyhow!(
                "--model {}: expected a finite-element model, found a measured one; learn it again with all recordings instead",
                path.display()
            )));
        }
        let outputs: Vec<String> =
            recordings.first().map_or_else(Vec::new, |r| r.outputs.iter().map(|s| s.name.clone()).collect());
        let states = |recording| MeasuredStates::of(&model, recording, &mut remarks);
        let runs: Vec<_> =
            recordings.iter().map(states).collect::<Result<_, _>>().map_err(files::not_compared)?;
        let found = correct(&mut model, &outputs, &runs, &mut remarks).map_err(|error| match error {
            MeasuredError::NoSuchOutput { .. } => configuration(error),
            error => unexplained(error),
        })?;
        files::save(&self.out, &model.to_bytes()?)?;
        let title = format!("{}: finite elements with a measured difference", self.out.display());
        report::print(&CorrectedModel { title, source: "finite elements", found, remarks }, self.json)
    }
}

/// What was learned from measurements alone.
#[derive(Serialize)]
struct LearnedModel {
    title: String,
    #[serde(flatten)]
    learned: LearningReport,
}

/// A finite-element model with what was measured beside it.
#[derive(Serialize)]
struct CorrectedModel {
    title: String,
    source: &'static str,
    #[serde(flatten)]
    found: Corrected,
    remarks: Vec<String>,
}
