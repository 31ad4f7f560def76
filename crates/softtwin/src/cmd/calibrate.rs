//! `softtwin calibrate`.

mod found;
mod memory;
mod plan;

use crate::failure::{configuration, unexplained, usage};
use crate::unknowns::Unknowns;
use crate::{files, report};
use anyhow::{Context, bail};
use estimate::{Curves, Fit, InputRole, Measurement, Setup};
use found::{Summary, figure};
use memory::Calibration;
use plan::PlanArgs;
use rom::inputs::{InputSpec, PRESSURE};
use runtime::config::Scene;
use runtime::estimation::{self, SensorValues};
use runtime::measured::MeasuredInputs;
use runtime::source::SensorTrace;
use std::path::{Path, PathBuf};

const EXAMPLES: &str = "\
Examples:
  What a recording says about gap, gauge bias and stiffness; the scene names the unknowns and the sensors:
    softtwin calibrate --scene config/scenes/estimate.toml --recording run.mcap
  The same for a table, with a picture of measured and predicted values, and a scene with the result:
    softtwin calibrate --scene config/scenes/estimate.toml \\
      --recording run.csv --picture fit.svg --out calibrated.toml
  With a memory between the measured pressure and the one that acts (line, play, creep), where it explains parts that were left out:
    softtwin calibrate --scene config/scenes/estimate.toml \\
      --recording run.csv --memory finger-memory.twin --out calibrated.toml
  Before measuring: which four pressures tell gap, gauge bias and stiffness apart, with the load cell, the markers, or both:
    softtwin calibrate --scene config/scenes/estimate.toml --plan
  The plate can be moved to three places; two holds of 400 readings each, for a script:
    softtwin calibrate --scene config/scenes/estimate.toml --plan \\
      --gap 30 40 50 --holds 2 --readings 400 --json

A table has the columns t_s,pressure_mpa[,gap_mm][,measured_force_n][,marker1_x_mm,marker1_y_mm,marker1_z_mm]... and those of measured \
inputs and observables by name; an empty cell is a missing value. `identifiable` is false where the recording does not tell a quantity: its value then rests on the \
prior of the scene. With --json the last thing on standard output is one JSON object. Exit code 1: the fit did not converge. \
Exit code 65: the model does not explain the recording, because more values than --max-rejected contradict the fit, or because \
what is left over follows time or the direction of the pressure; nothing is saved then without --force.";

/// Fit the unknowns of a scene to a recording, or plan the readings that tell them apart.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES)]
pub struct Args {
    /// Scene with `[actuator.estimate]`.
    #[arg(long, value_name = "FILE.toml")]
    scene: PathBuf,
    /// Recorded readings: CSV, or MCAP of `softtwin record`.
    #[arg(long, value_name = "FILE", required_unless_present = "plan")]
    recording: Option<PathBuf>,
    /// Mapping of a table's columns; default: the names of a trace.
    #[arg(long, value_name = "FILE.toml")]
    log: Option<PathBuf>,
    /// The actuator, where the scene has several with unknowns.
    #[arg(long, value_name = "NAME")]
    actuator: Option<String>,
    /// Sensor topic, where the recording has several.
    #[arg(long, value_name = "KEY")]
    topic: Option<String>,
    /// Scene with the fitted values as priors.
    #[arg(long, value_name = "FILE.toml")]
    out: Option<PathBuf>,
    /// Identify the memory of the pressure and write the model with it (docs/memory.md). The scene of --out names this model.
    #[arg(long, value_name = "FILE.twin")]
    memory: Option<PathBuf>,
    /// Largest fraction of the values that may contradict the fit.
    #[arg(long, value_name = "SHARE", default_value_t = 0.2, value_parser = crate::range::number(0.0, 1.0))]
    max_rejected: f64,
    /// Write --out although the model does not explain the recording.
    #[arg(long, requires = "out")]
    force: bool,
    /// Picture of measured and predicted values and of the residuals (.svg or .png).
    #[arg(long, value_name = "FILE")]
    picture: Option<PathBuf>,
    /// One JSON object instead of text.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    plan: PlanArgs,
}

impl Args {
    /// Fits, then prints the estimates.
    pub fn run(self) -> anyhow::Result<()> {
        let scene = Scene::load(&self.scene).map_err(configuration)?;
        let unknowns = Unknowns::load(&scene, &self.scene, self.actuator.as_deref())?;
        let Some(recording) = &self.recording else { return self.plan.run(unknowns, self.json) };
        let (spec, setup) = (&unknowns.spec, &unknowns.setup);
        let names = spec.input_names();
        let trace = match &self.log {
            Some(log) => SensorTrace::read_log(recording, log, &names),
            None => SensorTrace::read_named(recording, self.topic.as_deref(), &names),
        };
        let trace = trace.map_err(|errors| {
            let messages: Vec<String> = errors.iter().map(ToString::to_string).collect();
            configuration(anyhow::anyhow!("{}: {}", recording.display(), messages.join("\n")))
        })?;
        let good = trace.rows.iter().filter(|reading| reading.status == 0);
        let (named, values) = (MeasuredInputs::new(spec, &unknowns.header.inputs), SensorValues::new(spec));
        let readings: Vec<Measurement> = good
            .map(|reading| estimation::measurement(reading.t_trace_s, reading, &named, &values))
            .collect();
        check_recording(setup, &readings).map_err(configuration)?;
        let (calibration, found) = match &self.memory {
            None => (Calibration::of(unknowns, readings)?, None),
            Some(_) if setup.swing.is_some() => {
                return Err(usage(
                    "--memory: expected a model without inertia, found one with it; identify the memory with the static model",
                ));
            }
            Some(_) if !matches!(setup.inputs.get(PRESSURE), Some(InputRole::Measured { .. })) => {
                return Err(usage("--memory: expected a model with a measured pressure, found none"));
            }
            Some(out) => {
                let (calibration, found) = memory::calibrate(unknowns, &readings, out)?;
                (calibration, Some(found))
            }
        };
        let Calibration { unknowns: Unknowns { spec, setup, mut sensors, header, .. }, readings, fit } =
            calibration;
        let keys: Vec<String> = header.inputs.iter().map(InputSpec::key).collect();
        let curves = Curves::of(&setup, &readings, &fit, &mut sensors, &keys);
        let structures = curves.structures(&setup, &readings);
        let reasons = curves.reasons(&fit, &structures, self.max_rejected);
        let is_explained = reasons.is_empty();
        if let Some(out) = self.out.as_ref().filter(|_| fit.converged && (is_explained || self.force)) {
            self.save_scene(&scene, &spec.name, &setup, &fit, out)?;
        }
        if let Some(picture) = &self.picture {
            figure(&setup, &readings, &curves).save(picture)?;
        }
        let memory = found.as_ref();
        let summary = Summary::new(&setup, &fit, readings.len(), &structures, &reasons, memory);
        report::print(&summary, self.json)?;
        if !fit.converged {
            bail!(
                "the fit did not converge: the model does not explain the recording with these sensors; look at the residuals \
                 (--picture), at units and marker places, or at the priors"
            );
        }
        if !is_explained {
            return Err(unexplained(format!(
                "this model does not explain the recording: {}; look at the residuals (--picture)",
                reasons.join("; ")
            )));
        }
        Ok(())
    }

    /// The scene with the fitted values as priors. Its paths are absolute.
    fn save_scene(
        &self,
        scene: &Scene,
        name: &str,
        setup: &Setup,
        fit: &Fit,
        out: &Path,
    ) -> anyhow::Result<()> {
        let mut new = scene.clone();
        for actuator in new.actuators.iter_mut().filter(|actuator| actuator.name == name) {
            if let Some(memory) = &self.memory {
                actuator.model = std::path::absolute(memory)?;
            }
            for (unknown, estimate) in setup.unknowns.iter().zip(&fit.estimates) {
                if let Some(spec) = actuator.estimate.get_mut(&unknown.name) {
                    (spec.prior, spec.sigma) = (estimate.value, estimate.sigma);
                }
            }
        }
        let text = toml::to_string(&new).context("the scene as TOML")?;
        let head = format!(
            "# Made by softtwin calibrate from {} and {}.\n",
            self.scene.display(),
            self.recording.as_deref().unwrap_or(Path::new("")).display()
        );
        files::save(out, (head + &text).as_bytes())
    }
}

/// A recording that measures nothing that the model predicts is a mistake of the scene or of the table.
fn check_recording(setup: &Setup, readings: &[Measurement]) -> anyhow::Result<()> {
    let any = readings.iter().any(|reading| reading.rows.iter().any(|value| value.is_finite()));
    if !any {
        let names: Vec<&str> = setup.rows.iter().map(|row| row.name.as_str()).collect();
        bail!("the recording has no measured value of {}; nothing can be fitted", names.join(", "));
    }
    Ok(())
}
