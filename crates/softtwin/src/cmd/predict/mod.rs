//! `softtwin predict`: one state, or the motion along a trace.

mod answer;
mod grasp;

pub use answer::by_input;

use crate::failure::usage;
use crate::{files, report};
use answer::{Prediction, measured};
use anyhow::Context;
use formats::export::{ExportBody, Moment, StateFormat};
use formats::table::to_text;
use grasp::GraspArgs;
use rom::branch::pressure_field;
use rom::inputs::Inputs;
use rom::model::{Model, Selection};
use rom::model_state::ModelState;
use rom::observable::Observables;
use rom::snapshots::FieldSpec;
use std::path::{Path, PathBuf};
use train::trace::{InputTrace, predict_series};

const EXAMPLES: &str = "\
Examples:
  One state as an array, nodes x fields (x, y, z, displacement, von Mises), float32:
    softtwin predict finger.twin --pressure 0.05 --gap 40 \\
      --out state.npy
  For ParaView, with the inside of the body (the model itself knows its surface only):
    softtwin predict finger.twin --pressure 0.05 --gap 40 \\
      --mesh mesh.vtu --out state.vtu
  A softer batch of silicone, with a model that was trained over its stiffness:
    softtwin predict design.twin --pressure 0.05 --gap 40 \\
      --set elastomer.law.mu_mpa=0.7
  No obstacle; only the answer on standard output:
    softtwin predict finger.twin --pressure 0.05
  Along a trace (t_s, pressure_mpa; gap_mm and other inputs if given), with the columns of `softtwin simulate --trace`:
    softtwin predict finger.twin --trace swing.csv --out series.csv
  Does a gripper hold its object at this pressure, and from which pressure on? Or another object:
    softtwin predict config/scenes/gripper.toml --pressure 79kPa
    softtwin predict config/scenes/gripper.toml --pressure 50kPa \\
      --friction 0.3 --mass-g 30

`inputs` shows the value of every input that was used, `dforce` the force's derivative by \
each in N per unit. `in_domain` is false outside the training states: the answer is then an extrapolation without half-widths \
(null), and a line on standard error says which input is outside and by how much. Far outside, or where the shape cannot be one of the \
body, there is no answer: exit code 1. An object is held when n mu F >= s m g, with the smallest of the n finger forces as F; a running twin \
publishes the same as softtwin/<scene>/grasp. `outputs` has the values of a model of measurements (softtwin learn) with their half-widths.";

const NO_PRESSURE: &str = "--pressure: expected a pressure, found none";

/// Predict a state, a motion or a grasp: force, regime, onset and, with --out, all fields.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES)]
pub struct Args {
    /// Model (.twin), or a scene with a gripper (.toml).
    #[arg(value_name = "FILE")]
    model: PathBuf,
    /// Cavity pressure: MPa, or with a unit (50kPa, 0.5bar, 7psi), at least 0; not for a model that was not trained over pressures.
    #[arg(long = "pressure", value_name = "MPA", allow_negative_numbers = true, conflicts_with = "trace", value_parser = crate::range::pressure_mpa)]
    pressure_mpa: Option<f64>,
    /// Gap from the underside of the undeformed base to the obstacle in mm; no obstacle when left out. Not for a model that was not trained over
    /// gaps.
    #[arg(long = "gap", value_name = "MM", allow_negative_numbers = true, conflicts_with = "trace", value_parser = crate::range::gap_mm)]
    gap_mm: Option<f64>,
    /// Inputs over time: t_s, pressure_mpa; gap_mm and other inputs of the model, if given. A model with inertia begins at rest under
    /// the first row.
    #[arg(long, value_name = "FILE.csv", requires = "out", conflicts_with = "mesh")]
    trace: Option<PathBuf>,
    /// Largest time between two rows of the series in ms (0.001 to 1000).
    #[arg(long, value_name = "MS", default_value_t = 2.0, requires = "trace", value_parser = crate::range::number(0.001, 1000.0))]
    step_ms: f64,
    /// Value of a parameter of the model by its name; nominal when left out. Repeat for others.
    #[arg(long = "set", value_name = "NAME=VALUE", value_parser = crate::options::setting)]
    settings: Vec<(String, f64)>,
    /// File for the fields: .npy, .csv, .vtu, .dat (Tecplot ASCII) or .xdmf. With --trace: the series, .csv.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Undeformed mesh (.vtu, .msh, .inp) whose cells the output shall have; the model's surface when left out.
    #[arg(long, value_name = "FILE", requires = "out")]
    mesh: Option<PathBuf>,
    /// One JSON object instead of text.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    grasp: GraspArgs,
}

impl Args {
    /// Predicts and prints what the model says.
    pub fn run(self) -> anyhow::Result<()> {
        if self.model.extension().is_some_and(|ending| ending == "toml") {
            let pressure_mpa = self.pressure_mpa.ok_or_else(|| usage(NO_PRESSURE))?;
            return self.grasp.run(&self.model, pressure_mpa, self.gap_mm, self.json);
        }
        if let (Some(trace), Some(out)) = (&self.trace, &self.out) {
            let mut model = files::model(&self.model)?;
            files::set_parameters(&mut model, &self.settings)?;
            return self.along(&model, trace, out);
        }
        if let Some(out) = &self.out {
            StateFormat::of(out).map_err(usage)?; // before the work, not after it
        }
        let mut model = files::model(&self.model)?;
        let needs = model.header.needs();
        for (option, is_given, is_taken) in [
            ("--pressure", self.pressure_mpa.is_some(), needs.pressure),
            ("--gap", self.gap_mm.is_some(), needs.gap),
        ] {
            if is_given && !is_taken {
                let keys: Vec<String> = model.header.taken_inputs().map(|(_, input)| input.key()).collect();
                let known = keys.join(", ");
                return Err(usage(format!("{option}: expected an input of the model ({known}), found none")));
            }
        }
        if self.pressure_mpa.is_none() && needs.pressure {
            return Err(usage(NO_PRESSURE));
        }
        let gap_mm = self.gap_mm.unwrap_or(f64::INFINITY);
        let input = Inputs::new(self.pressure_mpa.unwrap_or(f64::NAN), gap_mm);
        files::set_parameters(&mut model, &self.settings)?;
        let mut state = ModelState::new(&model, &Selection::default())?;
        let peaks = state.update(input);
        let regime = state.evaluation().regime;
        if model.regime(regime).is_none() {
            let (found, wanted) = (model.header.regime_names().join(", "), regime.name());
            return Err(usage(format!("this state belongs to regime {wanted}; the model has only {found}")));
        }
        let observables = Observables::of(&model)?;
        let peaks = files::answered(&state, peaks, true)?;
        if self.out.is_some() {
            self.write(&model, &state)?;
        }
        let mut found = Prediction::new(&model.header, state.evaluation(), &peaks, &observables);
        found.outputs = model.is_measured().then(|| measured(&model, &state));
        if let Some(field) = pressure_field(&model.header) {
            found.pressure_mpa = Some(f64::from(state.fields()[field * model.header.node_count]));
        }
        report::print(&found, self.json)
    }

    /// Predicts along a trace, writes the series and reports.
    fn along(&self, model: &Model, trace: &Path, out: &Path) -> anyhow::Result<()> {
        let trace = InputTrace::read(trace, model).map_err(files::not_followed)?;
        let step_ns = (1e6 * self.step_ms) as u64;
        let found = predict_series(model, &trace, step_ns).map_err(files::not_followed)?;
        let cell = |value: &f64| if value.is_finite() { value.to_string() } else { String::new() };
        let rows = found.rows.iter().map(|row| row.iter().map(cell));
        let columns: Vec<&str> = found.columns.iter().map(String::as_str).collect();
        files::save(out, to_text(&columns, rows).as_bytes())?;
        if let Some(first) = &found.first_outside {
            tracing::warn!(
                "{} of {} instants are outside the training range and have no half-widths; the first at {first}",
                found.summary.outside_training_range,
                found.summary.rows
            );
        }
        report::print(&found.summary, self.json)
    }

    fn write(&self, model: &Model, state: &ModelState) -> anyhow::Result<()> {
        let Some(out) = &self.out else { return Ok(()) };
        let fields: Vec<FieldSpec> = model.header.fields.iter().map(|f| f.spec.clone()).collect();
        let body = ExportBody::of_model(model).with_mesh(self.mesh.as_deref()).map_err(files::refusal)?;
        body.series(&fields, 1)
            .write_state(out, &Moment::of_model(model, state, &Observables::of(model)?, 0.0))
            .context("the fields were not written")
    }
}
