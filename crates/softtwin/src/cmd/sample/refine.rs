//! More states where the trained model is least sure: propose, simulate, add, retrain, compare.

use super::gain::{Gain, Quality, Trained};
use super::regime::Regime;
use crate::cmd::train as train_command;
use crate::draws::Draws;
use crate::failure::{configuration, usage};
use crate::files::{self, refusal};
use crate::progress::Progress;
use crate::{output, range};
use anyhow::Context;
use fem::Family;
use fem::cases::{self, Case};
use fem::run::{self, Event, Run, Solved, Store, fingerprint};
use fem::sample::{InfillError, infill};
use rom::inputs::Inputs;
use rom::model::{Model, RegimeModel};
use rom::snapshots::{Database, RegimeKind};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use train::datasheet::{DataSheet, RegimeSheet};

/// Places among which the next states are chosen.
const CANDIDATES: usize = 1500;

/// Largest number of states that one refinement adds.
const MAX_STATES: usize = CANDIDATES / 10;

/// Options of a refinement.
#[derive(clap::Args)]
pub struct Refinement {
    /// Instead: simulate this many more states where the model of --database is least sure, and retrain (1 to 150).
    #[arg(long, value_name = "N", conflicts_with_all = ["kind", "n", "n_gaps", "prefix", "split"], requires_all = ["database", "actuator"], group = "simulated", value_parser = range::count(1, MAX_STATES))]
    refine: Option<usize>,
    /// Actuator that is simulated, or whose parameters vary.
    #[arg(long, value_name = "FILE.toml", requires = "simulated")]
    pub(super) actuator: Option<PathBuf>,
    /// Cases a refinement solves at the same time (1 to 256).
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = range::threads)]
    threads: usize,
    /// Print the gain of a refinement as one JSON object.
    #[arg(long, requires = "refine")]
    json: bool,
}

/// Source of a refinement.
pub struct Target<'a> {
    /// Database to refine.
    pub database: &'a Path,
    /// Folder of the new database.
    pub out: &'a Path,
    /// Regime to refine.
    pub regime: Regime,
    /// Seed of the candidates.
    pub seed: u64,
}

impl Refinement {
    /// Whether one was asked for.
    pub fn is_wanted(&self) -> bool {
        self.refine.is_some()
    }

    /// Refines and prints what it gained.
    pub fn run(&self, target: &Target<'_>) -> anyhow::Result<()> {
        if target.out == target.database {
            return Err(usage("--out: expected another folder than --database; the database is not changed"));
        }
        let mut progress = Progress::new(self.json);
        let family = files::family(self.actuator.as_deref().unwrap_or(Path::new("")))?;
        let (scene, kind) = target.regime.kinds();
        progress.step("training on the database");
        let database = files::database(target.database, scene)?;
        if let Some(parameter) = database.parameters.first() {
            return Err(usage(format!(
                "--refine: expected a database over pressure and gap alone, found the parameter {}; `sample --kind sequence` with a \
                 larger --n continues a list over parameters",
                parameter.name
            )));
        }
        let before = train(&database, target.database)?;
        let proposed = self.propose(target, &database, &before, kind)?;
        if !self.json {
            output!("{} states where the model is least sure:", proposed.len())?;
            proposed.iter().try_for_each(|c| match c.gap_mm {
                Some(gap) => output!("  {}: {} MPa, gap {gap} mm", c.name, c.pressure_mpa),
                None => output!("  {}: {} MPa", c.name, c.pressure_mpa),
            })?;
        }
        progress.step("simulating them");
        let solved = self.simulate(target, &family, &proposed)?;
        run::extend(target.database, target.out, &family, &proposed, &solved).map_err(refusal)?;
        progress.step("training on the refined database");
        let refined = files::database(target.out, scene)?;
        train_command::copy_config(target.database, target.out)?;
        let after = train(&refined, target.out)?;
        let model = target.out.join(&family.actuator.name).with_extension("twin");
        files::save(&model, &after.0.to_bytes()?)?;
        files::save_data_sheet(&model, &after.1)?;
        drop(progress);
        let added: Vec<&str> = solved.iter().map(|(i, _)| proposed[*i].name.as_str()).collect();
        let quality = |trained: &Trained| Quality::of(trained, &refined, kind, &added);
        let gain =
            Gain { before: quality(&before)?, after: quality(&after)?, added: added.len(), model: &model };
        gain.print(self.json)?;
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
        target: &Target<'_>,
        database: &Database,
        (model, sheet): &Trained,
        kind: RegimeKind,
    ) -> anyhow::Result<Vec<Case>> {
        let count = self.refine.unwrap_or(0);
        let chosen = places(database, (model, sheet), kind, count, target.seed)?;
        anyhow::ensure!(!chosen.is_empty(), "no state of regime {} lies between its samples", kind.name());
        let first = database.cases.len();
        let case = |(k, place): (usize, Inputs)| {
            let gap_mm = Some(place.gap_mm()).filter(|gap| gap.is_finite());
            let name = format!("refine{:03}", first + k);
            target.regime.case(name, "train", (place.pressure_mpa(), gap_mm))
        };
        Ok(chosen.into_iter().enumerate().map(case).collect())
    }

    /// Solves the proposed cases, near those whose states a simulation left beside the database.
    fn simulate(
        &self,
        target: &Target<'_>,
        family: &Family,
        proposed: &[Case],
    ) -> anyhow::Result<Vec<(usize, Arc<Solved>)>> {
        let known = target.database.join("states");
        let (folder, mut list) = if known.is_dir() {
            (known, cases::read(&target.database.join("cases.csv")).map_err(refusal)?)
        } else {
            (target.out.join("states"), Vec::new())
        };
        let old = list.len();
        list.extend_from_slice(proposed);
        let store = Store::new(&folder, fingerprint(&family.problem))?;
        let run =
            Run { family, store, threads: self.threads, sensitivities: false, searches_behind_limits: false };
        let outcome = run.solve(&list, &|event| match event {
            Event::Solved(case, solved) => {
                tracing::info!(
                    "case {} solved in {} factorisations",
                    case.name,
                    solved.report.factorisations
                );
            }
            Event::Failed { case, reason, .. } => tracing::warn!("case {} failed: {reason}", case.name),
            Event::Started(_) | Event::Reused(_) => {}
        })?;
        Ok(outcome.solved.into_iter().filter_map(|(i, s)| Some((i.checked_sub(old)?, s))).collect())
    }
}

/// States inside the training range of a regime where the leave-one-out errors of a model ask for them, the most wanted first.
///
/// # Errors
/// The database has no training case of the regime.
pub fn places(
    database: &Database,
    (model, sheet): (&Model, &DataSheet),
    kind: RegimeKind,
    count: usize,
    seed: u64,
) -> anyhow::Result<Vec<Inputs>> {
    let regime = model.regime(kind).zip(sheet.regimes.iter().find(|r| r.kind == kind));
    let (regime, sheet) = regime
        .with_context(|| format!("{} has no training cases of regime {}", database.actuator, kind.name()))?;
    let samples = infill_errors(database, sheet, |inputs| scale(regime, inputs));
    let mut draws = Draws::new(model, kind, seed)?;
    // A state of the other regime, or beyond the samples, would not refine this one.
    let places: Vec<Inputs> = (0..CANDIDATES).filter_map(|_| draws.draw(|state| state)).collect();
    let scaled: Vec<_> = places.iter().map(|place| scale(regime, place)).collect();
    Ok(infill(count, &samples, &scaled).into_iter().map(|i| places[i]).collect())
}

fn train(database: &Database, folder: &Path) -> anyhow::Result<Trained> {
    train::train(database, &train_command::config_of(folder)?, &mut |_| ()).map_err(configuration)
}

/// A state's scaled inputs; the second is 0 where the regime has one.
fn scale(regime: &RegimeModel, inputs: &Inputs) -> [f64; 2] {
    let scaled = regime.inputs.scale(inputs);
    [scaled[0], scaled[1]]
}

/// Places and leave-one-out errors of the training cases, in half-widths of the model. Leaving out a corner measures
/// extrapolation, which refinement inside cannot cure: corners take the median of the others.
fn infill_errors(
    database: &Database,
    sheet: &RegimeSheet,
    scale: impl Fn(&Inputs) -> [f64; 2],
) -> Vec<InfillError> {
    let halfwidths = &sheet.halfwidths;
    let share = |error: f64, bar: f64| if bar > 0.0 { error / bar } else { 0.0 };
    let error = |e: &train::datasheet::CaseError| {
        share(e.displacement_mm, halfwidths.displacement_mm)
            .max(share(e.stress_mpa, halfwidths.stress_mpa))
            .max(share(e.force_n, halfwidths.force_n))
    };
    let mut inner: Vec<f64> = sheet.leave_one_out.iter().filter(|e| !e.on_hull).map(error).collect();
    inner.sort_by(f64::total_cmp);
    let median = inner.get(inner.len() / 2).copied().unwrap_or(1.0);
    let place = |e: &train::datasheet::CaseError| {
        let case = database.cases.iter().find(|c| c.name == e.case)?;
        Some(InfillError { at: scale(&case.inputs()), error: if e.on_hull { median } else { error(e) } })
    };
    sheet.leave_one_out.iter().filter_map(place).collect()
}
