//! `softtwin train`.

use crate::failure::{configuration, usage};
use crate::files::{self, refusal};
use crate::options::ObstacleArg;
use crate::progress::Progress;
use crate::report;
use anyhow::Context;
use fem::inertia::{InertiaError, InertialBody};
use formats::database::ObstacleKind;
use rom::snapshots::Split;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;
use train::config::TrainConfig;
use train::datasheet::{FitSheet, RegimeSheet};
use train::{TrainError, unseen_errors};

const EXAMPLES: &str = "\
Examples:
  Train with what leave-one-out chooses; also writes the data sheet finger.json and the card finger.card.json:
    softtwin train --database models/pneunet/database --out finger.twin
  The paper's method (joint uncentred POD, linear splines without tail, 4 and 6 modes), for comparison:
    softtwin train --database models/pneunet/database --paper --out paper.twin
  Your own choices, beginning with the commented defaults:
    cp config/train.toml mine.toml
    softtwin train --database models/pneunet/database --config mine.toml \\
      --out mine.twin

Only cases with split = train are used; test and check cases are for `softtwin evaluate`.";

/// Make a model of finite-element states: from the database of an actuator.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES)]
pub struct Args {
    /// Database folder (database.toml, cases.csv, snapshots.npy, mesh.vtu).
    #[arg(long, value_name = "DIR")]
    database: PathBuf,
    /// Model file to write; the data sheet goes beside it with the ending .json.
    #[arg(long, value_name = "FILE.twin", help_heading = "Output")]
    out: PathBuf,
    /// Training configuration, in place of train.toml in the database's folder; keys left out keep their defaults, observables and the
    /// limit of the pressure those of the folder.
    #[arg(long, value_name = "FILE.toml", conflicts_with = "paper")]
    config: Option<PathBuf>,
    /// Train by the paper's method instead of the defaults.
    #[arg(long)]
    paper: bool,
    /// The model's errors on held-out states, written by `softtwin evaluate --errors`: half-widths are set by these
    /// instead of leave-one-out, which over-states errors.
    #[arg(long, value_name = "FILE.csv")]
    errors: Option<PathBuf>,
    /// Actuator file of the cases: the model then moves with inertia. Columns loads.gravity_mm_s2.1, .0 or .2 of the cases are the inertial loads.
    #[arg(long, value_name = "FILE.toml")]
    inertia: Option<PathBuf>,
    /// Obstacle of the cases to train on; default: the plate, if the database has it.
    #[arg(long, value_enum)]
    obstacle: Option<ObstacleArg>,
    /// Print one JSON object instead of text.
    #[arg(long, help_heading = "Output")]
    json: bool,
}

/// The only obstacle of a database; the plate if it has several.
fn only_obstacle(database: &Path) -> ObstacleKind {
    match formats::database::obstacle_kinds(database).as_deref() {
        Ok([obstacle]) => *obstacle,
        _ => ObstacleKind::Plate,
    }
}

impl Args {
    /// Trains and writes model and data sheet.
    pub fn run(self) -> anyhow::Result<()> {
        if self.out.extension().is_some_and(|e| e == "json") {
            return Err(usage(format!(
                "--out {}: the ending .json is the data sheet's; use .twin",
                self.out.display()
            )));
        }
        let folder = self.out.parent().filter(|folder| !folder.as_os_str().is_empty());
        if let Some(folder) = folder.filter(|folder| !folder.is_dir()) {
            let found = format!("no folder {}", folder.display());
            return Err(usage(format!(
                "--out: expected a file in an existing folder, found {found}; make it first"
            )));
        }
        let config = self.config()?;
        if let Some(errors) = &self.errors {
            unseen_errors::check(errors).map_err(refusal)?; // before the training, which takes minutes
        }
        let mut progress = Progress::new(self.json);
        progress.step("reading the database");
        let obstacle = self.obstacle.map_or_else(|| only_obstacle(&self.database), ObstacleKind::from);
        let mut database = files::database(&self.database, obstacle)?;
        let started = Instant::now();
        let body = self.inertia.as_ref().map(|path| {
            let (actuator, problem) = files::actuator(path)?;
            InertialBody::new(&database, actuator, problem).map_err(no_inertia)
        });
        let body = body.transpose()?;
        let mut vibrations = Vec::new();
        if let Some(body) = &body {
            progress.step("vibrations of the actuator");
            (database.vibrations, vibrations) = body.vibrations(&database).map_err(no_inertia)?;
        }
        let trained = train::train(&database, &config, &mut |step| progress.step(step));
        let (mut model, mut sheet) = trained.map_err(|e| match e {
            TrainError::Database(_) | TrainError::Config(_) => configuration(e),
            other => other.into(),
        })?;
        if let Some(errors) = &self.errors {
            unseen_errors::calibrate(errors, &mut model, &mut sheet).map_err(refusal)?;
        }
        if let Some(body) = &body {
            progress.step("reduced mass");
            vibrations.extend(body.add_to(&mut model, &database).map_err(no_inertia)?);
        }
        let training_s = started.elapsed().as_secs_f64();
        // The sheet of a file names the chosen candidate only; the others are the larger part of it.
        for regime in &mut sheet.regimes {
            let fits = regime.groups.iter_mut().chain(&mut regime.force);
            fits.for_each(|fit| fit.candidates.truncate(1));
        }
        progress.step("writing the model");
        let bytes = model.to_bytes()?;
        files::save(&self.out, &bytes)?;
        let data_sheet = sheet.save_beside(&self.out)?;
        let hash = bytes.last_chunk::<32>().context("the model has no hash")?;
        train::card::save(&self.out, &model, hash, None).map_err(refusal)?;
        drop(progress);
        let report = TrainReport {
            model: self.out.clone(),
            data_sheet,
            training_s,
            bytes: bytes.len(),
            cases: database.of_split(Split::Train).count(),
            database_hash: sheet.database_hash,
            sag_mm: sheet.sag_mm,
            reach_mm: sheet.reach_mm,
            vibrations,
            regimes: sheet
                .regimes
                .iter()
                .map(|regime| (regime.kind.name(), RegimeReport::new(regime)))
                .collect(),
            remarks: sheet.remarks,
        };
        report::print(&report, self.json)
    }

    fn config(&self) -> anyhow::Result<TrainConfig> {
        let own = TrainConfig::of_database(&self.database).map_err(refusal)?;
        let named = match &self.config {
            Some(path) => TrainConfig::read(path).map_err(refusal)?,
            None if self.paper => TrainConfig::paper(),
            None => return Ok(own),
        };
        // What is observed of the actuator and the limit of its pressure do not depend on how the fields are trained.
        let observables = if named.observables.is_empty() { own.observables } else { named.observables };
        Ok(TrainConfig { observables, limit: named.limit.or(own.limit), ..named })
    }
}

/// The wrong actuator is wrong usage, one that cannot be reduced a configuration error; a state that is not found is neither.
fn no_inertia(error: InertiaError) -> anyhow::Error {
    match error {
        InertiaError::NoLoad { .. } | InertiaError::OtherActuator { .. } => usage(error),
        InertiaError::Prony(_) | InertiaError::Train(_) => configuration(error),
        _ => error.into(),
    }
}

/// A trained model.
#[derive(Serialize)]
struct TrainReport {
    model: PathBuf,
    data_sheet: PathBuf,
    training_s: f64,
    bytes: usize,
    cases: usize,
    database_hash: String,
    /// Gap at which the weight alone touches, and the largest that the trained pressures close.
    sag_mm: Option<f64>,
    reach_mm: Option<f64>,
    vibrations: Vec<String>,
    regimes: BTreeMap<&'static str, RegimeReport>,
    remarks: Vec<String>,
}

#[derive(Serialize)]
struct RegimeReport {
    cases: usize,
    boundary_states: usize,
    groups: BTreeMap<String, FitReport>,
    force: Option<FitReport>,
}

#[derive(Serialize)]
struct FitReport {
    modes: usize,
    condition: f64,
    leave_one_out: f64,
    kernel: Option<String>,
}

impl RegimeReport {
    fn new(regime: &RegimeSheet) -> Self {
        let fit = |fit: &FitSheet| FitReport {
            modes: fit.modes,
            condition: fit.condition,
            leave_one_out: fit.leave_one_out,
            kernel: fit.candidates.first().map(|candidate| candidate.kernel.clone()),
        };
        Self {
            cases: regime.cases,
            boundary_states: regime.boundary_states,
            groups: regime.groups.iter().map(|group| (group.name.clone(), fit(group))).collect(),
            force: regime.force.as_ref().map(fit),
        }
    }
}
