//! States that no training saw: drawn at random inside a model's domain and simulated on the spot.

use super::Args;
use crate::cmd::simulate::{batch, open};
use anyhow::Context;
use fem::cases::Case;
use formats::database::ObstacleKind;
use rom::evaluator::Evaluator;
use rom::hull::DomainStatus;
use rom::inputs::{GAP, Inputs, PRESSURE};
use rom::model::Model;
use rom::rng::Rng;
use rom::snapshots::RegimeKind;

/// Draws within the box of a domain that may fall outside it: a domain of a hundredth of its box is still found.
const TRIES: usize = 100_000;

impl Args {
    /// Simulates `count` random contact states into the database folder. States already there are not solved again.
    pub(super) fn simulate(&self, model: &Model, count: usize) -> anyhow::Result<()> {
        let (actuator, problem) = open(&self.actuator)?;
        let nodes = problem.mesh().nodes_mm.len();
        if nodes != model.header.node_count {
            return Err(crate::failure::usage(format!(
                "--actuator {}: its mesh has {nodes} nodes, expected the model's {}; the model was trained on another mesh",
                self.actuator.display(),
                model.header.node_count
            )));
        }
        let cases = random_states(model, count, self.seed, ObstacleKind::from(self.scene))?;
        let outcome = batch::solve(&actuator, problem, &cases, &self.database, self.threads)?;
        for (index, reason) in &outcome.failed {
            tracing::warn!("state {} could not be simulated: {reason}", cases[*index].name);
        }
        Ok(())
    }
}

/// Random states inside the contact domain, evenly over pressure and gap.
fn random_states(model: &Model, count: usize, seed: u64, scene: ObstacleKind) -> anyhow::Result<Vec<Case>> {
    let contact =
        model.regime(RegimeKind::Contact).context("the model has no contact regime to draw from")?;
    let evaluator = Evaluator::new(&model.header)?;
    let mut evaluation = evaluator.evaluation();
    let mut random = Rng::new(seed);
    let mut cases = Vec::new();
    for _ in 0..TRIES {
        // An input that all samples shared takes no random number: the states of a seed stay the same.
        let mut within = |input| match contact.inputs.range(input) {
            Some([low, high]) if low < high => Some(low + (high - low) * random.uniform()),
            constant => constant.map(|[value, _]| value),
        };
        let pressure = within(PRESSURE).context("the contact regime takes no pressure")?;
        let gap = within(GAP).context("no gap")?;
        // What is simulated is what is written: rounded as a list of cases would round it.
        let [pressure_mpa, gap_mm] = [(pressure, 1e6), (gap, 1e4)].map(|(v, per)| (v * per).round() / per);
        evaluator.evaluate(Inputs::new(pressure_mpa, gap_mm), &mut evaluation);
        if evaluation.regime == RegimeKind::Contact && evaluation.domain == DomainStatus::Inside {
            let name = format!("fresh{seed}-{:03}", cases.len());
            let regime = if scene == ObstacleKind::Block { "gripper" } else { "contact" }.into();
            let split = "check".into();
            cases.push(Case { name, regime, split, pressure_mpa, gap_mm: Some(gap_mm) });
        }
        if cases.len() == count {
            return Ok(cases);
        }
    }
    anyhow::bail!("only {} of {count} random states fell inside the contact domain", cases.len())
}
