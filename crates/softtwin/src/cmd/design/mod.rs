//! `softtwin design`.

mod confirm;

use super::predict::by_input;
use crate::failure::usage;
use crate::{files, output};
use anyhow::{Context, bail};
use fem::plan::Parameter;
use rom::goal::{GoalError, Goals, Objective, Solution, reach};
use rom::hull::{DomainStatus, TrainingRange};
use rom::inputs::{GAP, InputSpec, Inputs, PRESSURE};
use rom::model::ModelHeader;
use serde_json::{Value, json};
use std::path::PathBuf;
use std::time::Instant;

const EXAMPLES: &str = "\
Examples:
  The silicone's stiffness and the wall between the chambers for 0.3 N at a pressure and a gap:
    softtwin design design.twin --pressure 0.05 --gap 30 \\
      --objective force_n=0.3
      --within elastomer.law.mu_mpa=0.6:1.0 --within chambers.length_mm=2.6:3.4
  The tip at a height, and the stress below a limit; finite elements confirm the answer:
    softtwin design design.twin --gap 60 \\
      --objective y_mm@110,0,16=-20 --objective 'max_von_mises_mpa<=0.3'
      --within pressure_mpa=0.02:0.08 --within elastomer.law.mu_mpa=0.6:1.0 \\
      --actuator actuator.toml

Any input of the model may vary, pressure and gap too; `softtwin inspect` lists them. The search follows the model's gradients \
from the nominal values and then from other starts, and keeps near its start what the goal leaves open. Standard output is one \
JSON object: `missed` is what is left of each objective in its unit, `confirmed` the same by one finite-element run. Exit code 1:
the goal is not met within the bounds; the nearest inputs are printed all the same.";

/// Find values of inputs for a goal: a force, a point at a place, a stress below a limit.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES)]
pub struct Args {
    /// Model file.
    #[arg(value_name = "FILE.twin")]
    model: PathBuf,
    /// Goal: force_n=N, x_mm|y_mm|z_mm@X,Y,Z=MM for the point with these undeformed coordinates, max_von_mises_mpa<=MPA. Repeat
    /// for more.
    #[arg(long = "objective", value_name = "GOAL", required = true)]
    objectives: Vec<Objective>,
    /// Input that may vary and its bounds, by its name; within the range that the model was trained over. Repeat for others.
    #[arg(long, value_name = "NAME=LOW:HIGH", required = true, value_parser = clap::value_parser!(Parameter))]
    within: Vec<Parameter>,
    /// Cavity pressure: MPa, or with a unit (50kPa, 0.5bar, 7psi), where it does not vary.
    #[arg(long = "pressure", value_name = "MPa", allow_negative_numbers = true, value_parser = crate::range::pressure_mpa)]
    pressure_mpa: Option<f64>,
    /// Gap in mm, where it does not vary; no obstacle when left out.
    #[arg(long = "gap", value_name = "MM", allow_negative_numbers = true, value_parser = crate::range::gap_mm)]
    gap_mm: Option<f64>,
    /// Value of a parameter that does not vary; nominal when left out. Repeat for others.
    #[arg(long = "set", value_name = "NAME=VALUE", value_parser = crate::options::setting)]
    settings: Vec<(String, f64)>,
    /// Actuator whose finite elements confirm the answer (minutes).
    #[arg(long, value_name = "FILE.toml")]
    actuator: Option<PathBuf>,
    /// Accepted everywhere; the answer is one JSON object anyway.
    #[arg(long)]
    json: bool,
}

impl Args {
    /// Searches, confirms where asked to, prints one JSON object.
    pub fn run(self) -> anyhow::Result<()> {
        let mut model = files::model(&self.model)?;
        files::set_parameters(&mut model, &self.settings)?;
        let specs = &model.header.inputs;
        let within = self.bounds(specs)?;
        let start = self.start(specs, &within)?;
        let goals = Goals::new(&model, &self.objectives, &within);
        let mut goals = goals.map_err(|error| match error {
            GoalError::Model(error) => error.into(),
            error => usage(format!("--objective: {error}")),
        })?;
        let begin = Instant::now();
        let found = reach(&within, start, &mut |inputs| goals.residuals(inputs));
        let seconds = begin.elapsed().as_secs_f64();
        let found = found
            .context("the model has no answer at any start; does it have the regime of these states?")?;
        let values = goals.values(found.inputs).context("the model has no answer at the inputs found")?;
        let evaluation = goals.evaluation(found.inputs);
        let (distance, refusal) = (evaluation.domain_distance, evaluation.flags.refusal);
        let why = goals.outside();
        if refusal.is_some() || distance > TrainingRange::ASKED {
            bail!(
                "the nearest inputs found are too far outside the training range to design with (at most {:.0} % of it): {}",
                100.0 * TrainingRange::ASKED,
                why.unwrap_or_default()
            );
        }
        if let Some(why) = why {
            tracing::warn!("outside the training range, so the answer has no half-widths: {why}");
        }
        let predicted: Vec<f64> = values.iter().map(|(value, _)| *value).collect();
        let mut answer = self.answer(&model.header, &mut goals, &found, &predicted);
        answer["seconds"] = json!(seconds);
        if let Some(actuator) = &self.actuator {
            let inputs = goals.evaluation(found.inputs).inputs;
            let confirmed = confirm::confirm(&model, actuator, &self.objectives, &inputs)?;
            answer["confirmed"] = self.by_objective(&confirmed);
        }
        output::json(&answer)?;
        if !found.is_met() {
            bail!(
                "the goal is not met within the bounds; `missed` says by how much at the nearest inputs found"
            );
        }
        Ok(())
    }

    /// Positions and bounds of what varies.
    fn bounds(&self, specs: &[InputSpec]) -> anyhow::Result<Vec<(usize, [f64; 2])>> {
        let mut within: Vec<(usize, [f64; 2])> = Vec::new();
        for Parameter { name, range } in &self.within {
            let Some(input) = specs.iter().position(|spec| spec.key() == *name) else {
                let known: Vec<String> = specs.iter().map(InputSpec::key).collect();
                return Err(usage(format!(
                    "--within {name}: expected an input of the model: {}",
                    known.join(", ")
                )));
            };
            let given = match input {
                PRESSURE => self.pressure_mpa.is_some(),
                GAP => self.gap_mm.is_some(),
                _ => self.settings.iter().any(|(other, _)| other == name),
            };
            if given || within.iter().any(|(other, _)| *other == input) {
                return Err(usage(format!(
                    "--within {name}: the input is given twice; let it vary or give its value"
                )));
            }
            let [low, high] = specs[input].range;
            if range[0] < low || range[1] > high {
                return Err(usage(format!(
                    "--within {name}={}:{}: expected bounds within {low}:{high}, where the model was trained",
                    range[0], range[1]
                )));
            }
            within.push((input, *range));
        }
        Ok(within)
    }

    /// Nominal values, the middle of the bounds for pressure and gap.
    fn start(&self, specs: &[InputSpec], within: &[(usize, [f64; 2])]) -> anyhow::Result<Inputs> {
        let middle = |input: usize| {
            within.iter().find(|(other, _)| *other == input).map(|(_, [low, high])| 0.5 * (low + high))
        };
        let pressure_mpa = self.pressure_mpa.or_else(|| middle(PRESSURE));
        let Some(pressure_mpa) = pressure_mpa else {
            return Err(usage("expected --pressure, or --within pressure_mpa=LOW:HIGH"));
        };
        let gap_mm = self.gap_mm.or_else(|| middle(GAP)).unwrap_or(f64::INFINITY);
        let nominal = |inputs: Inputs, (at, spec): (usize, &InputSpec)| match spec.value {
            Some(value) => inputs.with(at, value),
            None => inputs,
        };
        Ok(specs.iter().enumerate().fold(Inputs::new(pressure_mpa, gap_mm), nominal))
    }

    fn answer(&self, header: &ModelHeader, goals: &mut Goals, found: &Solution, predicted: &[f64]) -> Value {
        let evaluation = goals.evaluation(found.inputs);
        json!({
            "met": found.is_met(),
            "inputs": by_input(header, evaluation.inputs.values()),
            "predicted": self.by_objective(predicted),
            "in_domain": evaluation.domain == DomainStatus::Inside,
            "domain_distance": evaluation.domain_distance,
            "half_widths": evaluation.halfwidths,
            "evaluations": found.evaluations,
        })
    }

    fn by_objective(&self, values: &[f64]) -> Value {
        let one = |(objective, value): (&Objective, &f64)| {
            let (name, target, unit) = objective.target();
            json!({
                "objective": name, "target": target, "unit": unit, "value": value, "missed": objective.missed(*value),
            })
        };
        self.objectives.iter().zip(values).map(one).collect()
    }
}
