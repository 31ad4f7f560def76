//! The stability suite: named hard cases, each answered by our method and by the paper's, each judged against a known
//! truth. A case ends in a correct answer within its bound, a clear refusal, or an answer that says it should not be
//! trusted; a silent wrong number is a failure.

mod cases;
mod command;
mod probe;

pub use cases::hard_cases;
pub use command::Args;

use rom::config::TrainConfig;
use rom::snapshots::Database;
use rom::train::train;
use serde::Serialize;

/// How a case ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Ending {
    /// Within the bound.
    Correct,
    /// Beyond the bound, but flagged as extrapolation or within the model's own error bars.
    Flagged,
    /// Training refused with a reason.
    Refused,
    /// Beyond the bound without a word.
    SilentlyWrong,
}

/// What one method did with a case.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Outcome {
    /// How it ended.
    pub ending: Ending,
    /// Largest condition number of the systems solved; none when refused before solving.
    pub condition: Option<f64>,
    /// Largest error: displacement, stress and force, each over its largest true value.
    pub error: Option<f64>,
    /// Reason of a refusal, or what was merged.
    pub note: String,
}

/// A hard case: what to train on, what to ask, and what counts as right.
#[derive(Clone, Debug)]
pub struct HardCase {
    /// Short name.
    pub name: String,
    /// What is hard about it.
    pub hard: String,
    /// Training database.
    pub database: Database,
    /// Our configuration; the paper's method uses its own.
    pub config: TrainConfig,
    /// What to ask.
    pub probe: Probe,
    /// Largest error that counts as correct.
    pub bound: f64,
    /// How ours must end.
    pub expected: Ending,
}

/// What to ask a trained model.
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

/// A row of the report.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// Case.
    pub case: String,
    /// What is hard.
    pub hard: String,
    /// Bound in force.
    pub bound: f64,
    /// How ours must end.
    pub expected: Ending,
    /// Ours.
    pub ours: Outcome,
    /// The paper's method on the same case.
    pub paper: Outcome,
}

impl Row {
    /// Whether ours ended as it must.
    pub fn passed(&self) -> bool {
        self.ours.ending == self.expected
    }
}

/// Runs one case with both methods.
pub fn run(case: &HardCase) -> Row {
    Row {
        case: case.name.clone(),
        hard: case.hard.clone(),
        bound: case.bound,
        expected: case.expected,
        ours: outcome(case, &case.config),
        paper: outcome(case, &TrainConfig::paper()),
    }
}

fn outcome(case: &HardCase, config: &TrainConfig) -> Outcome {
    let (model, sheet) = match train(&case.database, config, &mut |_| {}) {
        Ok(trained) => trained,
        Err(e) => {
            return Outcome { ending: Ending::Refused, condition: None, error: None, note: e.to_string() };
        }
    };
    let condition =
        model.header.regimes.iter().flat_map(|r| r.interpolants()).map(|i| i.condition).fold(0.0, f64::max);
    let found = probe::ask(&model, case, config);
    let ending = match found {
        probe::Found { error, .. } if error <= case.bound => Ending::Correct,
        probe::Found { flagged: true, .. } => Ending::Flagged,
        _ => Ending::SilentlyWrong,
    };
    Outcome { ending, condition: Some(condition), error: Some(found.error), note: sheet.remarks.join("; ") }
}
