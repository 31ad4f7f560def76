//! More states where the trained model is least sure: propose, simulate, add, retrain, compare.

use crate::failure::{configuration, usage};
use crate::files::{self, not_planned, refusal};
use crate::progress::Progress;
use crate::{range, report};
use anyhow::ensure;
use fem::cases::Case;
use fem::plan::{ListRegime, add_states};
use fem::run::Event;
use formats::file;
use rom::inputs::Inputs;
use rom::model::Model;
use rom::snapshots::{Database, RegimeKind};
use serde::Serialize;
use std::path::{Path, PathBuf};
use train::config::{OWN_CONFIG, TrainConfig};
use train::datasheet::DataSheet;
use train::refinement::{CANDIDATES, RefinementErrors, places};

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
    pub regime: ListRegime,
    /// Seed of the candidates.
    pub seed: u64,
}

/// What a refinement gained: mean errors before and after, of the displacement (mm), the stress (MPa) and the force (N).
#[derive(Serialize)]
struct RefinementReport {
    model: PathBuf,
    added: usize,
    before: RefinementErrors,
    after: RefinementErrors,
}

type Trained = (Model, DataSheet);

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
        for case in &proposed {
            let gap = case.gap_mm.map_or(String::new(), |gap| format!(", gap {gap} mm"));
            tracing::info!("least sure at {}: {} MPa{gap}", case.name, case.pressure_mpa);
        }
        progress.step("simulating the states where the model is least sure");
        let notify = |event: Event<'_>| match event {
            Event::Solved(case, solved) => {
                let factorisations = solved.report.factorisations;
                tracing::info!("case {} solved in {factorisations} factorisations", case.name);
            }
            Event::Failed { case, reason, .. } => tracing::warn!("case {} failed: {reason}", case.name),
            Event::Started(_) | Event::Reused(_) => {}
        };
        let added = add_states((target.database, target.out), &family, &proposed, self.threads, &notify);
        let added = added.map_err(not_planned)?;
        progress.step("training on the refined database");
        let refined = files::database(target.out, scene)?;
        let own = target.database.join(OWN_CONFIG);
        if own.is_file() {
            files::save(&target.out.join(OWN_CONFIG), &file::read_bytes(&own, file::MAX_TEXT_BYTES)?)?;
        }
        let after = train(&refined, target.out)?;
        let model = target.out.join(&family.actuator.name).with_extension("twin");
        files::save(&model, &after.0.to_bytes()?)?;
        after.1.save_beside(&model)?;
        drop(progress);
        let names: Vec<&str> = added.iter().map(String::as_str).collect();
        let errors = |(model, sheet): &Trained| RefinementErrors::new((model, sheet), &refined, kind, &names);
        let (before, after) = (errors(&before)?, errors(&after)?);
        report::print(&RefinementReport { model, added: added.len(), before, after }, self.json)?;
        let failed = proposed.len() - added.len();
        ensure!(failed == 0, "{failed} of {} states failed and were not added", proposed.len());
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
        let chosen = places(database, (model, sheet), kind, self.refine.unwrap_or(0), target.seed)?;
        ensure!(!chosen.is_empty(), "no state of regime {} lies between its samples", kind.name());
        let first = database.cases.len();
        let case = |(k, place): (usize, Inputs)| {
            let gap_mm = Some(place.gap_mm()).filter(|gap| gap.is_finite());
            let name = format!("refine{:03}", first + k);
            target.regime.case(name, "train", (place.pressure_mpa(), gap_mm))
        };
        Ok(chosen.into_iter().enumerate().map(case).collect())
    }
}

fn train(database: &Database, folder: &Path) -> anyhow::Result<Trained> {
    let config = TrainConfig::of_database(folder).map_err(refusal)?;
    train::train(database, &config, &mut |_| ()).map_err(configuration)
}
