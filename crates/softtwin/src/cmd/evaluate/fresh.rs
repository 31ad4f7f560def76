//! New states: drawn at random inside a model's training range and simulated.

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

/// Draws per state: a training range of 1 % of its bounding box is still found.
const TRIES: usize = 100_000;

impl Args {
    /// Simulates `count` random contact states into a folder. States already there are not solved again.
    pub(super) fn simulate(&self, model: &Model, count: usize, folder: &Path) -> anyhow::Result<()> {
        let seed = self.seed.unwrap_or(1);
        let cases = random_states(model, RegimeKind::Contact, count, seed, ObstacleKind::from(self.scene))?;
        self.solve(model, &cases, folder, self.actuator.as_deref().unwrap_or(Path::new("")))
    }

    /// Simulates a list into a folder, on the model's own mesh.
    pub(super) fn solve(
        &self,
        model: &Model,
        cases: &[Case],
        folder: &Path,
        actuator: &Path,
    ) -> anyhow::Result<()> {
        let family = files::family(actuator)?;
        let nodes = family.problem.mesh().nodes_mm.len();
        if nodes != model.header.node_count {
            return Err(crate::failure::usage(format!(
                "--actuator {}: its mesh has {nodes} nodes, expected the model's {}; the model was trained on another mesh",
                actuator.display(),
                model.header.node_count
            )));
        }
        let threads = self.threads;
        let options = batch::Options { threads, sensitivities: false, settings: Vec::new() };
        let outcome = batch::solve(&family, cases, folder, &options)?;
        for (index, reason) in &outcome.failed {
            tracing::warn!("state {} could not be simulated: {reason}", cases[*index].name);
        }
        Ok(())
    }
}

/// Random states inside the training range of a regime, uniform in pressure and gap.
pub(super) fn random_states(
    model: &Model,
    kind: RegimeKind,
    count: usize,
    seed: u64,
    scene: ObstacleKind,
) -> anyhow::Result<Vec<Case>> {
    // What is simulated is what is written: rounded as a list of cases would round it.
    let rounded = |value: f64, per: f64| (value * per).round() / per;
    let written = |at: Inputs| Inputs::new(rounded(at.pressure_mpa(), 1e6), rounded(at.gap_mm(), 1e4));
    let mut draws = Draws::new(model, kind, seed)?;
    let states: Vec<Inputs> = (0..TRIES).filter_map(|_| draws.draw(written)).take(count).collect();
    if states.len() < count {
        let kind = kind.name();
        anyhow::bail!("only {} of {count} random states fell inside the {kind} domain", states.len());
    }
    let regime = match (kind, scene) {
        (RegimeKind::Contact, ObstacleKind::Block) => "gripper",
        (kind, _) => kind.name(),
    };
    let case = |(k, state): (usize, Inputs)| Case {
        name: format!("fresh{seed}-{regime}{k:03}"),
        regime: regime.into(),
        split: "check".into(),
        pressure_mpa: state.pressure_mpa(),
        gap_mm: (kind == RegimeKind::Contact).then(|| state.gap_mm()),
        settings: Vec::new(),
    };
    Ok(states.into_iter().enumerate().map(case).collect())
}
