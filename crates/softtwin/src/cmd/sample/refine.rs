//! More states where the trained model is least sure: propose, simulate, add, retrain, compare.

use super::gain::{Gain, Quality};
use super::{Regime, case_at};
use crate::failure::{configuration, usage};
use crate::files::{self, refusal};
use crate::output;
use crate::progress::Progress;
use anyhow::Context;
use fem::Problem;
use fem::actuator::Actuator;
use fem::cases::{self, Case};
use fem::run::{self, Event, Run, Solved, Store, fingerprint};
use fem::sample::{InfillError, infill};
use formats::database::ObstacleKind;
use rom::config::TrainConfig;
use rom::datasheet::{DataSheet, RegimeSheet};
use rom::evaluator::Evaluator;
use rom::hull::DomainStatus;
use rom::inputs::{GAP, Inputs};
use rom::model::{Model, RegimeModel};
use rom::rng::Rng;
use rom::snapshots::{Database, RegimeKind};
use std::path::Path;
use std::sync::Arc;

/// Places among which the next states are chosen.
const CANDIDATES: usize = 1500;

/// Largest number of states that one refinement adds.
pub const MAX_STATES: usize = CANDIDATES / 10;

/// What is asked for.
pub struct Order<'a> {
    /// States to add.
    pub count: usize,
    /// Database to refine.
    pub database: &'a Path,
    /// Its actuator.
    pub actuator: &'a Path,
    /// Folder of the new database.
    pub out: &'a Path,
    /// Regime to refine.
    pub regime: Regime,
    /// Cases solved at the same time.
    pub threads: usize,
    /// Seed of the candidates.
    pub seed: u64,
    /// Report as JSON.
    pub json: bool,
}

impl Order<'_> {
    /// Does everything and says what it gained.
    pub fn run(&self) -> anyhow::Result<()> {
        if self.out == self.database {
            return Err(usage(
                "--out: expected another folder than --database; the database is kept as it is",
            ));
        }
        let mut progress = Progress::new(self.json);
        let actuator = Actuator::read(self.actuator).map_err(refusal)?;
        let mesh = actuator.read_mesh(self.actuator).map_err(refusal)?;
        let problem = Arc::new(Problem::new(mesh, actuator.problem_config()).map_err(configuration)?);
        let (scene, kind) = match self.regime {
            Regime::Free => (ObstacleKind::Plate, RegimeKind::Free),
            Regime::Contact => (ObstacleKind::Plate, RegimeKind::Contact),
            Regime::Gripper => (ObstacleKind::Block, RegimeKind::Contact),
        };
        progress.step("training on the database as it is");
        let database = files::database(self.database, scene)?;
        let before = train(&database)?;
        let proposed = self.propose(&database, &before, kind)?;
        if !self.json {
            output!("{} states where the model is least sure:", proposed.len())?;
            proposed.iter().try_for_each(|c| match c.gap_mm {
                Some(gap) => output!("  {}: {} MPa, gap {gap} mm", c.name, c.pressure_mpa),
                None => output!("  {}: {} MPa", c.name, c.pressure_mpa),
            })?;
        }
        progress.step("simulating them");
        let solved = self.simulate(&actuator, &problem, &proposed)?;
        run::extend(self.database, self.out, problem.mesh(), &proposed, &solved).map_err(refusal)?;
        progress.step("training on the refined database");
        let refined = files::database(self.out, scene)?;
        let after = train(&refined)?;
        let model = self.out.join(&actuator.name).with_extension("twin");
        files::save(&model, &after.0.to_bytes()?)?;
        let sheet = format!("{:#}\n", serde_json::to_value(&after.1)?);
        files::save(&files::data_sheet(&model), sheet.as_bytes())?;
        drop(progress);
        let added: Vec<&str> = solved.iter().map(|(i, _)| proposed[*i].name.as_str()).collect();
        let quality = |trained: &Trained| Quality::of(trained, &refined, kind, &added);
        let gain =
            Gain { before: quality(&before)?, after: quality(&after)?, added: added.len(), model: &model };
        gain.tell(self.json)?;
        if solved.len() < proposed.len() {
            anyhow::bail!(
                "{} of {} states failed and were not added",
                proposed.len() - solved.len(),
                proposed.len()
            );
        }
        Ok(())
    }

    /// Names and places of the new cases.
    fn propose(
        &self,
        database: &Database,
        (model, sheet): &Trained,
        kind: RegimeKind,
    ) -> anyhow::Result<Vec<Case>> {
        let regime = model.regime(kind).zip(sheet.regimes.iter().find(|r| r.kind == kind));
        let (regime, sheet) = regime.with_context(|| {
            format!("{} has no training cases of regime {}", self.database.display(), kind.name())
        })?;
        let samples: Vec<InfillError> = infill_errors(database, sheet, |inputs| scale(regime, inputs));
        let ranges: Vec<[f64; 2]> = sheet.inputs.iter().map(|input| [input.min, input.max]).collect();
        let constant_gap_mm = regime.inputs.range(GAP).map(|[gap, _]| gap);
        let evaluator = Evaluator::new(&model.header)?;
        let mut evaluation = evaluator.evaluation();
        let mut places = Vec::new();
        let mut rng = Rng::new(self.seed);
        for _ in 0..CANDIDATES {
            let point: Vec<f64> =
                ranges.iter().map(|[low, high]| low + (high - low) * rng.uniform()).collect();
            let gap_mm = point.get(1).copied().or(constant_gap_mm);
            evaluator.evaluate(Inputs::new(point[0], gap_mm.unwrap_or(f64::INFINITY)), &mut evaluation);
            // A state of the other regime, or beyond the samples, would not refine this one.
            if evaluation.regime == kind && evaluation.domain == DomainStatus::Inside {
                places.push((point[0], gap_mm));
            }
        }
        let inputs = |(p, gap): &(f64, Option<f64>)| Inputs::new(*p, gap.unwrap_or(f64::INFINITY));
        let scaled: Vec<_> = places.iter().map(|place| scale(regime, &inputs(place))).collect();
        let chosen = infill(self.count, &samples, &scaled);
        anyhow::ensure!(!chosen.is_empty(), "no state of regime {} lies between its samples", kind.name());
        let first = database.cases.len();
        let case = |(k, i): (usize, usize)| {
            case_at(format!("refine{:03}", first + k), self.regime, "train", places[i])
        };
        Ok(chosen.into_iter().enumerate().map(case).collect())
    }

    /// Solves the proposed cases, near those whose states a simulation left beside the database.
    fn simulate(
        &self,
        actuator: &Actuator,
        problem: &Arc<Problem>,
        proposed: &[Case],
    ) -> anyhow::Result<Vec<(usize, Arc<Solved>)>> {
        let known = self.database.join("states");
        let (folder, mut list) = if known.is_dir() {
            (known, cases::read(&self.database.join("cases.csv")).map_err(refusal)?)
        } else {
            (self.out.join("states"), Vec::new())
        };
        let old = list.len();
        list.extend_from_slice(proposed);
        let store = Store::new(&folder, fingerprint(problem))?;
        let run = Run { actuator, problem: Arc::clone(problem), store, threads: self.threads };
        let outcome = run.solve(&list, &|event| match event {
            Event::Solved(case, solved) => {
                tracing::info!(case = case.name, factorisations = solved.report.factorisations, "solved");
            }
            Event::Failed { case, reason, .. } => tracing::warn!(case = case.name, reason, "failed"),
            Event::Reused(_) => {}
        })?;
        Ok(outcome.solved.into_iter().filter_map(|(i, s)| Some((i.checked_sub(old)?, s))).collect())
    }
}

/// A model and its data sheet.
pub type Trained = (Model, DataSheet);

fn train(database: &Database) -> anyhow::Result<Trained> {
    rom::train::train(database, &TrainConfig::default(), &mut |_| ()).map_err(configuration)
}

/// A state's scaled inputs; the second is 0 where the regime has one.
fn scale(regime: &RegimeModel, inputs: &Inputs) -> [f64; 2] {
    let scaled = regime.inputs.scale(inputs);
    [scaled[0], scaled[1]]
}

/// Places and leave-one-out errors of the training cases, in error bars of the model. Leaving out a corner measures
/// extrapolation, which refinement inside cannot cure: corners take the median of the others.
fn infill_errors(
    database: &Database,
    sheet: &RegimeSheet,
    scale: impl Fn(&Inputs) -> [f64; 2],
) -> Vec<InfillError> {
    let halfwidths = &sheet.halfwidths;
    let share = |error: f64, bar: f64| if bar > 0.0 { error / bar } else { 0.0 };
    let error = |e: &rom::datasheet::CaseError| {
        share(e.displacement_mm, halfwidths.displacement_mm)
            .max(share(e.stress_mpa, halfwidths.stress_mpa))
            .max(share(e.force_n, halfwidths.force_n))
    };
    let mut inner: Vec<f64> = sheet.leave_one_out.iter().filter(|e| !e.on_hull).map(error).collect();
    inner.sort_by(f64::total_cmp);
    let median = inner.get(inner.len() / 2).copied().unwrap_or(1.0);
    let place = |e: &rom::datasheet::CaseError| {
        let case = database.cases.iter().find(|c| c.name == e.case)?;
        Some(InfillError { at: scale(&case.inputs()), error: if e.on_hull { median } else { error(e) } })
    };
    sheet.leave_one_out.iter().filter_map(place).collect()
}
