//! `softtwin calibrate`.

mod memory;
mod plan;

use crate::failure::{configuration, unexplained, usage};
use crate::picture::{Figure, Mark, Panel, Series};
use crate::unknowns::Unknowns;
use crate::{files, report};
use anyhow::{Context, bail};
use estimate::{Estimate, Filter, Fit, Measurement, Model as _, Predicted, ResidualSeries, Setup, Structure};
use memory::Calibration;
use plan::PlanArgs;
use rom::inputs::InputSpec;
use runtime::config::Scene;
use runtime::estimation::{self, SensorModel, SensorValues};
use runtime::measured::MeasuredInputs;
use runtime::source::Trace;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use train::memory::Identified;

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

/// Correlation from which two unknowns can hardly be told apart.
const ALIKE: f64 = 0.9;

impl Args {
    /// Fits, then prints the estimates.
    pub fn run(self) -> anyhow::Result<()> {
        let scene = Scene::load(&self.scene).map_err(configuration)?;
        let unknowns = Unknowns::load(&scene, &self.scene, self.actuator.as_deref())?;
        let Some(recording) = &self.recording else { return self.plan.run(unknowns, self.json) };
        let (spec, setup) = (&unknowns.spec, &unknowns.setup);
        let names = spec.input_names();
        let trace = match &self.log {
            Some(log) => Trace::read_log(recording, log, &names),
            None => Trace::read_named(recording, self.topic.as_deref(), &names),
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
            Some(_) if !memory::is_pressure_measured(setup) => {
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
        let reasons = reasons(&fit, &structures, &curves.driving_name, self.max_rejected);
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

/// Why a fit explains nothing; empty if it does.
fn reasons(fit: &Fit, structures: &[(String, Structure)], driving: &str, max_rejected: f64) -> Vec<String> {
    let values = fit.used + fit.outliers;
    let mut reasons = Vec::new();
    if fit.outliers as f64 > max_rejected * values as f64 {
        reasons.push(format!(
            "{} of {values} values contradict the fit (--max-rejected {max_rejected})",
            fit.outliers
        ));
    }
    if let Some(alarm) = fit.alarm {
        reasons.push(format!("the alarm of the filter over the motion: {alarm}"));
    }
    for (name, found) in structures.iter().filter(|(_, found)| found.is_unexplained) {
        let mut shape = vec![format!("{:.3} of {:.3} RMS is no noise", found.systematic, found.rms)];
        shape.extend(found.lag_s.map(|lag_s| format!("it lags by about {lag_s:.2} s")));
        shape.extend(found.drift_per_s.map(|drift| format!("it drifts by {drift:.2e} per s")));
        if found.loop_share.abs() > 0.01 {
            shape.push(format!(
                "rising and falling {driving} differ by {:.1} % of the range",
                100.0 * found.loop_share.abs()
            ));
        }
        reasons.push(format!("{name}: {}", shape.join(", ")));
    }
    reasons
}

/// What the command found.
#[derive(Serialize)]
struct Summary<'a> {
    readings: usize,
    readings_skipped: usize,
    values_used: usize,
    outliers: usize,
    chi2_per_dof: f64,
    converged: bool,
    is_explained: bool,
    estimates: BTreeMap<&'a str, FittedUnknown>,
    residuals: BTreeMap<&'a str, &'a Structure>,
    /// Pairs of unknowns.
    correlations: Vec<(&'a str, &'a str, f64)>,
    unexplained: &'a [String],
    #[serde(skip_serializing_if = "Option::is_none")]
    memory: Option<&'a Identified>,
    remarks: Vec<String>,
}

/// An estimate beside its prior.
#[derive(Serialize)]
struct FittedUnknown {
    #[serde(flatten)]
    estimate: Estimate,
    prior: f64,
    prior_sigma: f64,
}

impl<'a> Summary<'a> {
    fn new(
        setup: &'a Setup,
        fit: &Fit,
        readings: usize,
        structures: &'a [(String, Structure)],
        unexplained: &'a [String],
        memory: Option<&'a Identified>,
    ) -> Self {
        let both = || setup.unknowns.iter().zip(&fit.estimates);
        let estimates = both().map(|(unknown, estimate)| {
            let fitted =
                FittedUnknown { estimate: *estimate, prior: unknown.prior, prior_sigma: unknown.sigma };
            (unknown.name.as_str(), fitted)
        });
        let count = setup.unknowns.len();
        let pairs = (0..count).flat_map(|a| (a + 1..count).map(move |b| (a, b)));
        let name = |at: usize| setup.unknowns[at].name.as_str();
        let correlations: Vec<_> = pairs.map(|(a, b)| (name(a), name(b), fit.correlation(a, b))).collect();
        let mut remarks = memory.map_or_else(Vec::new, |found| found.remarks.clone());
        for (unknown, _) in both().filter(|(_, estimate)| !estimate.identifiable) {
            remarks
                .push(format!("{}: not identifiable from this recording, rests on the prior", unknown.name));
        }
        for (a, b, correlation) in correlations.iter().filter(|pair| pair.2.abs() > ALIKE) {
            remarks.push(format!("{a} and {b} can hardly be told apart: correlation {correlation:.3}"));
        }
        Self {
            readings,
            readings_skipped: fit.skipped,
            values_used: fit.used,
            outliers: fit.outliers,
            chi2_per_dof: fit.chi2_per_dof,
            converged: fit.converged,
            is_explained: unexplained.is_empty(),
            estimates: estimates.collect(),
            residuals: structures.iter().map(|(name, found)| (name.as_str(), found)).collect(),
            correlations,
            unexplained,
            memory,
            remarks,
        }
    }
}

/// Predictions for each reading, by measured quantity.
struct Curves {
    before: Vec<Vec<f64>>,
    after: Vec<Vec<f64>>,
    /// Position and key of the first input that varies.
    driving: usize,
    driving_name: String,
}

impl Curves {
    /// With the priors and with the fitted values.
    fn of(
        setup: &Setup,
        readings: &[Measurement],
        fit: &Fit,
        sensors: &mut SensorModel,
        keys: &[String],
    ) -> Self {
        let mut predict = |unknowns: &[f64]| -> Vec<Vec<f64>> {
            // A motion is that which explains the readings with these values.
            let mut motion = setup.swing.and_then(|_| Filter::new(setup.clone().held_at(unknowns)).ok());
            let one = |reading: &Measurement| {
                let mut rows = vec![Predicted::default(); setup.rows.len()];
                let inputs = match &mut motion {
                    Some(motion) => motion.update(reading, sensors).inputs,
                    None => setup.inputs(reading, unknowns),
                };
                sensors.predict(&inputs, &mut rows);
                let bias = |at: usize| setup.rows[at].bias.map_or(0.0, |bias| unknowns[bias]);
                rows.iter().enumerate().map(|(at, row)| row.value + bias(at)).collect()
            };
            readings.iter().map(one).collect()
        };
        let before: Vec<f64> = setup.unknowns.iter().map(|unknown| unknown.prior).collect();
        let after: Vec<f64> = fit.estimates.iter().map(|estimate| estimate.value).collect();
        let varies = |at: &usize| {
            readings.windows(2).any(|pair| (pair[0].inputs[*at] - pair[1].inputs[*at]).abs() > 0.0)
        };
        let driving = (0..keys.len()).find(varies).unwrap_or(0);
        let driving_name = keys.get(driving).cloned().unwrap_or_default();
        Self { before: predict(&before), after: predict(&after), driving, driving_name }
    }

    /// Structure of the residuals by measured quantity.
    fn structures(&self, setup: &Setup, readings: &[Measurement]) -> Vec<(String, Structure)> {
        let t_s: Vec<f64> = readings.iter().map(|reading| reading.t_s).collect();
        let driving: Vec<f64> = readings.iter().map(|reading| reading.inputs[self.driving]).collect();
        let of_row = |(at, row): (usize, &estimate::Row)| {
            let measured: Vec<f64> = readings.iter().map(|reading| reading.rows[at]).collect();
            let predicted: Vec<f64> = self.after.iter().map(|rows| rows[at]).collect();
            let sigma = row.variance(1.0).sqrt();
            let series = ResidualSeries {
                t_s: &t_s,
                measured: &measured,
                predicted: &predicted,
                driving: &driving,
                sigma,
            };
            Some((row.name.clone(), Structure::of(series)?))
        };
        setup.rows.iter().enumerate().filter_map(of_row).collect()
    }
}

/// Measured values, predictions before and after the fit, residuals after it; one row of panels a measured quantity.
fn figure(setup: &Setup, readings: &[Measurement], curves: &Curves) -> Figure {
    let Curves { before, after, .. } = curves;
    let begin_s = readings.first().map_or(0.0, |reading| reading.t_s);
    let mut panels = Vec::new();
    for (at, row) in setup.rows.iter().enumerate() {
        if !readings.iter().any(|reading| reading.rows[at].is_finite()) {
            continue;
        }
        let series = |name: &str, colour, mark, value: &dyn Fn(usize) -> f64| {
            let points = readings.iter().enumerate().map(|(i, reading)| (reading.t_s - begin_s, value(i)));
            Series::new(name, colour, mark, points)
        };
        let values = vec![
            series("measured", 0, Mark::Dots, &|i| readings[i].rows[at]),
            series("predicted with the priors", 1, Mark::Line, &|i| before[i][at]),
            series("predicted after the fit", 2, Mark::Line, &|i| after[i][at]),
        ];
        panels.push(Panel::new("", "time [s]", row.name.as_str(), values));
        let residuals =
            series("measured - predicted", 0, Mark::Dots, &|i| readings[i].rows[at] - after[i][at]);
        let label = format!("{}: residual", row.name);
        panels.push(Panel::new("", "time [s]", label.as_str(), vec![residuals]));
    }
    Figure { title: format!("Fit to {} readings", readings.len()), panels, columns: 2 }
}
