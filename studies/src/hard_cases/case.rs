//! Definition of a hard case.

use super::ending::Ending;
use rom::snapshots::Database;
use train::config::TrainConfig;

/// A hard case: what to train on, what to ask, and what counts as right.
#[derive(Clone, Debug)]
pub struct HardCase {
    /// Short name.
    pub name: String,
    /// Difficulty.
    pub hard: String,
    /// Training database.
    pub database: Database,
    /// Our configuration; the paper's method uses its own.
    pub config: TrainConfig,
    /// Queries.
    pub probe: Probe,
    /// Largest error that counts as correct.
    pub bound: f64,
    /// How ours must end.
    pub expected: Ending,
}

/// Queries to a trained model.
#[derive(Clone, Debug)]
pub enum Probe {
    /// States with known truth.
    Queries(Vec<Query>),
    /// Both sides of the onset at a hundred gaps, the sag and the reach: the error is the jump.
    Switch,
    /// The same answers as a model of this database.
    SameAs(Box<Database>),
}

/// One question and its truth.
#[derive(Clone, Debug)]
pub struct Query {
    /// Pressure in the database's unit.
    pub pressure: f64,
    /// Gap in the database's unit; infinite for none.
    pub gap: f64,
    /// True snapshot, node-interleaved.
    pub truth: Vec<f32>,
    /// True force in N.
    pub force_n: f64,
}
