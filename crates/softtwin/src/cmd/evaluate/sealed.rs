//! Sealed evaluation: test states, drawn at random in a model's training range, simulated, evaluated once and not stored.

use super::Args;
use crate::cmd::simulate::batch;
use crate::draws::Draws;
use crate::failure::usage;
use crate::files;
use fem::cases::Case;
use formats::database::ObstacleKind;
use rom::inputs::{Inputs, PARAMETERS};
use rom::model::Model;
use rom::snapshots::RegimeKind;
use std::path::Path;
use train::evaluate::evaluate;

/// One of this number of states is free: there is one input then.
const FREE_SHARE: usize = 10;
/// Draws per list: a training range of 1 % of its bounding box is still found.
const TRIES: usize = 100_000;

impl Args {
    /// Draws, simulates, evaluates, removes.
    pub(super) fn sealed(&self, model: &Model, count: usize) -> anyhow::Result<()> {
        if model.header.inputs.len() > PARAMETERS {
            return Err(usage(
                "--sealed: expected a model of pressure and gap, found further inputs; draw a list with `softtwin sample \
                 --parameter`, `softtwin simulate` it and evaluate on that folder",
            ));
        }
        let default = self.model.with_file_name("actuator.toml");
        let actuator = self.actuator.as_deref().unwrap_or(&default);
        if !actuator.is_file() {
            return Err(usage(format!(
                "--sealed: expected the model's actuator, found no {}; give it by --actuator",
                actuator.display()
            )));
        }
        let (seed, obstacle) = (self.seed.unwrap_or(1), ObstacleKind::from(self.obstacle));
        let free = if model.regime(RegimeKind::Free).is_some() { count / FREE_SHARE } else { 0 };
        let mut cases = random_states(model, RegimeKind::Contact, count - free, seed, obstacle)?;
        if free > 0 {
            cases.extend(random_states(model, RegimeKind::Free, free, seed, obstacle)?);
        }
        // A killed run continues where it was: the folder is named by what is asked for.
        let hash = wire::layout::hex(&files::model_and_hash(&self.model)?.1[..8]);
        let name = format!("softtwin-sealed-{hash}-{seed}-{count}");
        let folder = wire::own_folder(&std::env::temp_dir(), &name)?;
        self.solve(model, &cases, &folder, actuator)?;
        let database = files::database(&folder, obstacle)?;
        let all: Vec<usize> = (0..database.cases.len()).collect();
        let report = evaluate(model, &database, &all)?;
        std::fs::remove_dir_all(&folder)?;
        self.show(model, &report)
    }

    /// Simulates a list into a folder, on the model's own mesh.
    fn solve(&self, model: &Model, cases: &[Case], folder: &Path, actuator: &Path) -> anyhow::Result<()> {
        let family = files::family(actuator)?;
        let nodes = family.problem.mesh().nodes_mm.len();
        if nodes != model.header.node_count {
            return Err(usage(format!(
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
fn random_states(
    model: &Model,
    kind: RegimeKind,
    count: usize,
    seed: u64,
    obstacle: ObstacleKind,
) -> anyhow::Result<Vec<Case>> {
    // What is simulated is what is written: rounded as a list of cases would round it.
    let rounded = |value: f64, per: f64| (value * per).round() / per;
    let written = |at: Inputs| Inputs::new(rounded(at.pressure_mpa(), 1e6), rounded(at.gap_mm(), 1e4));
    let mut draws = Draws::new(model, kind, seed)?;
    let states: Vec<Inputs> = (0..TRIES).filter_map(|_| draws.draw(written)).take(count).collect();
    if states.len() < count {
        let kind = kind.name();
        anyhow::bail!(
            "only {} of {count} random states are inside the training range of regime {kind}",
            states.len()
        );
    }
    let regime = match (kind, obstacle) {
        (RegimeKind::Contact, ObstacleKind::Block) => "gripper",
        (kind, _) => kind.name(),
    };
    let case = |(k, state): (usize, Inputs)| Case {
        name: format!("fresh{seed}-{regime}{k:03}"),
        regime: regime.into(),
        split: "check".into(),
        pressure_mpa: state.pressure_mpa(),
        volume_mm3: None,
        gap_mm: (kind == RegimeKind::Contact).then(|| state.gap_mm()),
        settings: Vec::new(),
    };
    Ok(states.into_iter().enumerate().map(case).collect())
}
