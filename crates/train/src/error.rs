//! Errors of training.

use crate::fit::FitError;
use crate::pod::PodError;
use thiserror::Error;

/// Why a model could not be trained.
#[derive(Clone, Debug, Error, PartialEq)]
#[allow(missing_docs)] // the messages say what the values are
pub enum TrainError {
    /// The database has problems; all of them.
    #[error("the database cannot be trained on:\n  {}", .0.join("\n  "))]
    Database(Vec<String>),
    /// The configuration has problems; all of them.
    #[error("the training configuration cannot be used:\n  {}", .0.join("\n  "))]
    Config(Vec<String>),
    /// The decomposition of a group failed.
    #[error("POD of group {group}, regime {regime}: {source}")]
    Pod { group: String, regime: String, source: PodError },
    /// No candidate kernel could be fitted.
    #[error("no kernel could be fitted to {what}, regime {regime}; the last refusal: {source}")]
    Fit { what: String, regime: String, source: FitError },
    /// Both regimes have cases, but the onset pressure between them cannot be derived.
    #[error(
        "the onset pressure cannot be derived: {0}; add coordinate fields, or train one regime by leaving the other's cases out"
    )]
    Onset(#[from] OnsetError),
}

/// Why the onset pressure cannot be derived from the free model.
#[derive(Clone, Debug, Error, PartialEq)]
#[allow(missing_docs)] // the messages say what the values are
pub enum OnsetError {
    /// A coordinate is missing.
    #[error("no field is the coordinate along axis {axis}")]
    NoCoordinate { axis: u8 },
    /// The pressure moves the actuator away from the obstacle.
    #[error(
        "expected a `pressure_mpa` that moves the actuator towards the obstacle, found one that lifts it by {by_mm:.3} mm; give the \
         surface of the cavity that lowers it the name `cavity`"
    )]
    Lifts { by_mm: f64 },
    /// Pressure hardly changes the depth over the obstacle.
    #[error("the free model reaches only {count} depth(s) over the obstacle (x {x_mm:?} mm, z {z_mm:?} mm)")]
    TooFewDepths { count: usize, x_mm: [f64; 2], z_mm: [f64; 2] },
}
