//! Which states of an actuator to solve: the pressures that suit it, the states of a whole model, designs over parameters, and further
//! states where a trained model is least sure.

mod designs;
mod lists;
mod pressures;
mod refine;
mod states;

pub use designs::{List, Onset, Sampling};
pub use lists::{ListRegime, Parameter, check_corners};
pub use pressures::{Pressures, find};
pub use refine::{add_states, solve_and_refine};
pub use states::{Budget, Counts, Plan, TOGETHER, landing_cases};

use crate::run::RunError;
use formats::FormatError;
use rom::model::ModelError;
use train::TrainError;
use train::draws::DrawsError;

/// Why states could not be chosen.
#[derive(Debug, thiserror::Error)]
pub enum PlanError {
    /// The actuator or what was asked for cannot be used as it is; the message says what to change.
    #[error("{0}")]
    Refused(String),
    /// A list of cases has no state at rest.
    #[error("the state at rest is missing")]
    Gravity,
    /// The pressure hardly moves the actuator.
    #[error("only {found} pressures could be solved ({reason})")]
    FewPressures {
        /// Pressures above 0.
        found: usize,
        /// Why there are no more.
        reason: String,
    },
    /// A plate below the actuator cannot be reached.
    #[error(
        "pressure moves its underside by {moved_mm:.2} mm only, so no plate can be reached; check sheet and support"
    )]
    NoReach {
        /// Distance by which it comes down.
        moved_mm: f64,
    },
    /// A database does not tell what was asked of it.
    #[error("{0}")]
    Database(String),
    /// States could not be solved.
    #[error(transparent)]
    Run(#[from] RunError),
    /// A file could not be read or written.
    #[error(transparent)]
    Files(#[from] FormatError),
    /// A database could not be trained on.
    #[error(transparent)]
    Train(#[from] TrainError),
    /// No further states could be drawn.
    #[error(transparent)]
    Draws(#[from] DrawsError),
    /// The model of a database cannot predict.
    #[error(transparent)]
    Predict(#[from] ModelError),
}

/// What a search is doing, for progress lines.
#[derive(Debug)]
pub enum Notice {
    /// Work that takes a while begins.
    Begins(String),
    /// A result.
    Found(String),
}
