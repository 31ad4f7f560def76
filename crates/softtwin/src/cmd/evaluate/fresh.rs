//! States that no training saw: drawn at random inside a model's domain and simulated on the spot.

use super::Args;
use crate::cmd::simulate::batch;
use crate::draws::Draws;
use crate::files;
use fem::cases::Case;
use formats::database::ObstacleKind;
use rom::inputs::Inputs;
use rom::model::Model;
use rom::snapshots::RegimeKind;
use std::path::Path;

/// Draws within the box of a domain that may fall outside it: a domain of a hundredth of its box is still found.
const TRIES: usize = 100_000;

impl Args {
    /// Simulates `count` random contact states into the database folder. States already there are not solved again.
    pub(super) fn simulate(&self, model: &Model, count: usize) -> anyhow::Result<()> {
        let path = self.actuator.as_deref().unwrap_or(Path::new(""));
        let family = files::family(path)?;
        let nodes = family.problem.mesh().nodes_mm.len();
        if nodes != model.header.node_count {
            return Err(crate::failure::usage(format!(
                "--actuator {}: its mesh has {nodes} nodes, expected the model's {}; the model was trained on another mesh",
                path.display(),
                model.header.node_count
            )));
        }
        let cases = random_states(model, count, self.seed, ObstacleKind::from(self.scene))?;
        let threads = self.threads;
        let options = batch::Options { threads, sensitivities: false, shard: None, settings: Vec::new() };
        let outcome = batch::solve(&family, &cases, &self.database, &options)?;
        for (index, reason) in &outcome.failed {
            tracing::warn!("state {} could not be simulated: {reason}", cases[*index].name);
        }
        Ok(())
    }
}

/// Random states inside the contact domain, evenly over pressure and gap.
fn random_states(model: &Model, count: usize, seed: u64, scene: ObstacleKind) -> anyhow::Result<Vec<Case>> {
    // What is simulated is what is written: rounded as a list of cases would round it.
    let rounded = |value: f64, per: f64| (value * per).round() / per;
    let written = |at: Inputs| Inputs::new(rounded(at.pressure_mpa(), 1e6), rounded(at.gap_mm(), 1e4));
    let mut draws = Draws::new(model, RegimeKind::Contact, seed)?;
    let states: Vec<Inputs> = (0..TRIES).filter_map(|_| draws.draw(written)).take(count).collect();
    if states.len() < count {
        anyhow::bail!("only {} of {count} random states fell inside the contact domain", states.len());
    }
    let regime = if scene == ObstacleKind::Block { "gripper" } else { "contact" };
    let case = |(k, state): (usize, Inputs)| Case {
        name: format!("fresh{seed}-{k:03}"),
        regime: regime.into(),
        split: "check".into(),
        pressure_mpa: state.pressure_mpa(),
        gap_mm: Some(state.gap_mm()),
        settings: Vec::new(),
    };
    Ok(states.into_iter().enumerate().map(case).collect())
}
