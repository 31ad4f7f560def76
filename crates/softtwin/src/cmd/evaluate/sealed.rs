//! Sealed evaluation: test states, drawn at random in a model's training range, simulated, evaluated once and not stored.

use super::Args;
use crate::cmd::simulate::batch;
use crate::failure::usage;
use crate::files;
use fem::Family;
use fem::cases::Case;
use formats::database::ObstacleKind;
use rom::inputs::{Inputs, PARAMETERS};
use rom::model::Model;
use rom::snapshots::RegimeKind;
use std::fs::{File, TryLockError};
use std::io::ErrorKind;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use train::draws::Draws;
use train::evaluate::evaluate;

/// Beginning of the names of the folders in which states are computed.
const PREFIX: &str = "softtwin-sealed-";
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
        let family = family_of(model, actuator)?;
        // A killed run continues where it was: the folder is named by what is asked for.
        let hash = wire::layout::hex(&files::model_and_hash(&self.model)?.1[..8]);
        let folder = WorkFolder::new(&std::env::temp_dir(), &format!("{PREFIX}{hash}-{seed}-{count}"))?;
        self.solve(&family, &cases, &folder.path)?;
        let database = files::database(&folder.path, obstacle)?;
        let all: Vec<usize> = (0..database.cases.len()).collect();
        let report = evaluate(model, &database, &all)?;
        self.show(model, &report)
    }

    fn solve(&self, family: &Family, cases: &[Case], folder: &Path) -> anyhow::Result<()> {
        let threads = self.threads;
        let options = batch::Options { threads, sensitivities: false, settings: Vec::new() };
        let outcome = batch::solve(family, cases, folder, &options).map_err(files::not_planned)?;
        for (index, reason) in &outcome.failed {
            tracing::warn!("state {} could not be simulated: {reason}", cases[*index].name);
        }
        Ok(())
    }
}

/// The actuator that is simulated; it must have the model's mesh.
fn family_of(model: &Model, actuator: &Path) -> anyhow::Result<Family> {
    let family = files::family(actuator)?;
    let nodes = family.problem.mesh().nodes_mm.len();
    if nodes != model.header.node_count {
        return Err(usage(format!(
            "--actuator {}: its mesh has {nodes} nodes, expected the model's {}; the model was trained on another mesh",
            actuator.display(),
            model.header.node_count
        )));
    }
    Ok(family)
}

/// The folder in which the states are computed. It is removed when the command ends, also by an error. A killed run leaves it
/// behind: the same command continues there, and any other sealed evaluation of this user removes it.
struct WorkFolder {
    path: PathBuf,
    /// Locked while the folder is in use, so that no other process takes it for a leftover. The system unlocks it when this
    /// process ends, however it ends.
    _lock: File,
}

impl WorkFolder {
    fn new(parent: &Path, name: &str) -> anyhow::Result<Self> {
        loop {
            let path = wire::own_folder(parent, name)?;
            // Another process may take the folder for a leftover before it is locked here. Then it is made anew.
            let lock = match File::open(&path) {
                Err(error) if error.kind() == ErrorKind::NotFound => continue,
                opened => opened?,
            };
            match lock.try_lock() {
                Err(TryLockError::WouldBlock) => {
                    return Err(usage(format!(
                        "--sealed: expected an evaluation that no other process is doing, found {} in use; wait for the \
                         other process or give another --seed",
                        path.display()
                    )));
                }
                locked => locked?,
            }
            let made = lock.metadata()?;
            if std::fs::metadata(&path).is_ok_and(|found| found.ino() == made.ino()) {
                remove_leftovers(parent, &path, made.uid());
                return Ok(Self { path, _lock: lock });
            }
        }
    }
}

impl Drop for WorkFolder {
    fn drop(&mut self) {
        // The lock is released after this.
        if let Err(error) = std::fs::remove_dir_all(&self.path) {
            tracing::warn!("{} could not be removed: {error}", self.path.display());
        }
    }
}

/// Removes the folders of this user that killed sealed evaluations left. What cannot be removed is left to the next.
fn remove_leftovers(parent: &Path, own: &Path, user: u32) {
    for entry in std::fs::read_dir(parent).into_iter().flatten().flatten() {
        let path = entry.path();
        // The metadata are those of the entry: a link is no folder.
        let is_ours = entry.metadata().is_ok_and(|found| found.is_dir() && found.uid() == user);
        if path == own || !is_ours || !entry.file_name().as_encoded_bytes().starts_with(PREFIX.as_bytes()) {
            continue;
        }
        if let Ok(lock) = File::open(&path)
            && lock.try_lock().is_ok()
        {
            let _ = std::fs::remove_dir_all(&path);
        }
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
