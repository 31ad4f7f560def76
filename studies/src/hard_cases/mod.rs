//! Hard cases by name, each answered by our method and by the paper's and compared with a known
//! truth. A case ends in a correct answer within its bound, a clear refusal, or an answer that says it should not be
//! trusted; a silent wrong number is a failure.

mod case;
mod cases;
mod command;
mod ending;
mod probe;

use cases::hard_cases;
pub use command::Args;

use case::HardCase;
use ending::{Ending, Outcome, Row};
use train::config::TrainConfig;
use train::train;

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
