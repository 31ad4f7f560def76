//! `softtwin learn`.

use crate::failure::{configuration, unexplained};
use crate::{files, output, report};
use formats::log::{Recording, Series};
use serde::Serialize;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use train::comparison::{RecordedInputs, SensorBiases};
use train::measured::{
    Difference, LearningReport, Measured, MeasuredError, MeasuredStates, ModesDifference, Run, correct, learn,
};

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
        let mut data = Measured::default();
        for recording in recordings {
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
        let mut learned = learn(&name, &data).map_err(unexplained)?;
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
        let mut runs = Vec::new();
        for recording in recordings {
            let inputs = RecordedInputs::new(&model.header, recording, SensorBiases::default(), &mut remarks);
            let mut states = vec![None; recording.time_s.len()];
            let of_rows = inputs.and_then(|inputs| {
                inputs.follow(&model, |row, evaluation| {
                    states[row] = Some(evaluation.inputs);
                    Ok(())
                })
            });
            let of_rows = of_rows.map_err(files::not_compared)?;
            remarks.extend(of_rows);
            runs.push(MeasuredStates {
                states,
                outputs: recording.outputs.iter().map(|series| series.values.clone()).collect(),
            });
        }
        let found = correct(&mut model, &outputs, &runs, &mut remarks).map_err(|error| match error {
            MeasuredError::NoSuchOutput { .. } => configuration(error),
            error => unexplained(error),
        })?;
        files::save(&self.out, &model.to_bytes()?)?;
        if self.json {
            let one = |of: &Difference| {
                json!({"name": of.name, "regime": of.regime.name(), "states": of.states, "rms": of.rms,
                    "rms_left_out": of.rms_left_out, "largest_offset": of.largest_offset, "half_width": of.half_width,
                    "kept": of.is_kept})
            };
            let of_modes = |of: &ModesDifference| {
                json!({"regime": of.regime.name(), "modes": of.modes, "values": of.values, "rms_mm": of.rms_mm,
                    "rms_left_out_mm": of.rms_left_out_mm, "share_mm": of.share_mm, "half_width_mm": of.half_width_mm,
                    "kept": of.is_kept})
            };
            let offsets: Vec<Value> = found.offsets.iter().map(one).collect();
            let modes: Vec<Value> = found.modes.iter().map(of_modes).collect();
            return output::json(
                &json!({"source": "finite elements", "modes": modes, "offsets": offsets, "remarks": remarks}),
            );
        }
        output!("{}: finite elements with a measured difference", self.out.display())?;
        for of in &found.modes {
            output!(
                "  {} modes of the {} regime: {} values, RMS {:.3} mm, {:.3} on left-out parts, changed by {:.3}{}",
                of.modes,
                of.regime.name(),
                of.values,
                of.rms_mm,
                of.rms_left_out_mm,
                of.share_mm,
                if of.is_kept { "" } else { "  not kept" }
            )?;
        }
        output!(
            "  {:<20}{:>8}{:>8}{:>12}{:>14}{:>16}{:>12}",
            "output",
            "regime",
            "states",
            "RMS before",
            "RMS left out",
            "largest offset",
            "half-width"
        )?;
        for of in &found.offsets {
            output!(
                "  {:<20}{:>8}{:>8}{:>12.4}{:>14.4}{:>16.4}{:>12.4}{}",
                of.name,
                of.regime.name(),
                of.states,
                of.rms,
                of.rms_left_out,
                of.largest_offset,
                of.half_width,
                if of.is_kept { "" } else { "  not kept" }
            )?;
        }
        remarks.iter().try_for_each(|remark| output!("  note: {remark}"))?;
        Ok(())
    }
}

/// What was learned from measurements alone.
#[derive(Serialize)]
struct LearnedModel {
    title: String,
    #[serde(flatten)]
    learned: LearningReport,
}
