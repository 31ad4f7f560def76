//! One database, both methods, and what every section asks of them.

use anyhow::Context;
use rom::hull::DomainStatus;
use rom::model::Model;
use rom::snapshots::{Database, RegimeKind, Split};
use std::path::{Path, PathBuf};
use train::config::{KernelKind, KernelSpec, ModeChoice, RegimeConfig, Tail, TrainConfig};
use train::datasheet::DataSheet;
use train::evaluate::{EvaluationReport, evaluate};

/// Both regimes, in the order of the paper.
pub const REGIMES: [RegimeKind; 2] = [RegimeKind::Free, RegimeKind::Contact];

/// A database with a model of each method.
pub struct Study {
    pub database: Database,
    pub paper: Model,
    pub ours: Model,
    /// Training settings of our model.
    pub config: TrainConfig,
    /// Whether that is from a data sheet beside the database.
    has_sheet: bool,
}

impl Study {
    /// Ours is trained as the model beside the folder was, by its data sheet; without one by the default.
    pub fn new(database: Database, folder: &Path) -> anyhow::Result<Self> {
        let sheet = super::folder::beside(folder, "json").filter(|sheet| sheet.exists());
        let read = |path: &PathBuf| -> anyhow::Result<TrainConfig> {
            let sheet: DataSheet = serde_json::from_slice(&std::fs::read(path)?)?;
            Ok(sheet.config)
        };
        let config = match &sheet {
            Some(path) => read(path).with_context(|| path.display().to_string())?,
            None => TrainConfig::default(),
        };
        // Repeating every POD for a data sheet is left out.
        let paper = train(&database, &paper(super::published::MODES))?;
        let ours = train(&database, &config)?;
        Ok(Self { database, paper, ours, config, has_sheet: sheet.is_some() })
    }

    /// Cases that satisfy a condition.
    pub fn cases(&self, keep: impl Fn(&rom::snapshots::Case) -> bool) -> Vec<usize> {
        (0..self.database.cases.len()).filter(|i| keep(&self.database.cases[*i])).collect()
    }

    pub fn evaluate(&self, model: &Model, cases: &[usize]) -> anyhow::Result<EvaluationReport> {
        Ok(evaluate(model, &self.database, cases)?)
    }

    /// Held-out cases inside our model's training range.
    pub fn held_out(&self) -> anyhow::Result<Vec<usize>> {
        let held_out = self.cases(|c| c.split != Split::Train);
        let report = self.evaluate(&self.ours, &held_out)?;
        let inside =
            |(i, c): (&usize, &train::evaluate::CaseReport)| (c.domain == DomainStatus::Inside).then_some(*i);
        Ok(held_out.iter().zip(&report.cases).filter_map(inside).collect())
    }

    pub fn heading(&self, database: &Path, repeats: u64) -> String {
        let count = |split| self.database.of_split(split).count();
        let hash = wire::layout::hex(&self.ours.header.database_hash[..8]);
        format!(
            "# Accuracy and speed\n\nMade by `softtwin-studies report --database {} --repeats {repeats}`; do not edit.\n\n\
             Database `{}`: {} training, {} test and {} check cases, {} nodes, blake3 `{hash}...`.\n\n\
             *Paper*: published figures. *Paper's method*: its algorithm (joint uncentred POD, linear splines without tail, {} \
             and {} modes) on this database. *Ours*: `softtwin train` on the same cases, {}. *Normalised*: largest error over \
             nodes, per largest value of the field in that case; the paper's relative errors (Eq. 16) are close to it where \
             the field is large.\n",
            database.display(),
            self.database.actuator,
            count(Split::Train),
            count(Split::Test),
            count(Split::Check),
            self.database.node_count,
            super::published::MODES[0],
            super::published::MODES[1],
            if self.has_sheet { "configured as the model of the database" } else { "by its default" },
        )
    }
}

/// Trains quietly.
pub fn train(database: &Database, config: &TrainConfig) -> anyhow::Result<Model> {
    Ok(train::train(database, config, &mut |_| {})?.0)
}

/// Mean squared error on the test cases of a regime.
pub fn test_mse(model: &Model, database: &Database, regime: RegimeKind) -> anyhow::Result<f64> {
    let wanted = |i: &usize| database.cases[*i].regime == regime;
    let cases: Vec<usize> = database.of_split(Split::Test).filter(wanted).collect();
    let report = evaluate(model, database, &cases)?;
    Ok(report.cases.iter().map(|c| c.mse).sum::<f64>() / cases.len() as f64)
}

/// The paper's method with the given numbers of modes for free and contact.
pub fn paper(modes: [usize; 2]) -> TrainConfig {
    let mut config = TrainConfig::paper();
    config.free.modes = ModeChoice::Fixed(modes[0]);
    config.contact.modes = ModeChoice::Fixed(modes[1]);
    config
}

/// Our method with one kernel and a given choice of modes: for curves over modes and cases.
pub fn ours_with(modes: ModeChoice, kernel: KernelKind, tail: Tail) -> TrainConfig {
    let regime = RegimeConfig {
        modes,
        kernels: vec![KernelSpec { kernel, tail }],
        anisotropy: vec![0.5],
        shear: vec![0.0],
        smoothing: vec![0.0],
        ..RegimeConfig::default()
    };
    TrainConfig { free: regime.clone(), contact: regime, ..TrainConfig::default() }
}

/// A number for a table.
pub fn percent(share: f64) -> String {
    let value = share * 100.0;
    if value.abs() >= 10.0 { format!("{value:.1}") } else { format!("{value:.3}") }
}
