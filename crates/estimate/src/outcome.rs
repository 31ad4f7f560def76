//! Outcome of a reading, estimates and alarms.

use crate::setup::MAX_INPUTS;
use thiserror::Error;

/// Status of a reading.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// The estimate takes it into account.
    Used,
    /// A measured input is missing or not a number; nothing changed.
    InputMissing,
    /// Its time is not later than the previous reading's; nothing changed.
    NotLater,
    /// The search for the estimate did not converge, or the model has no finite value there; nothing changed.
    NotConverged,
    /// Too many of its values contradict the model and the estimate; nothing changed.
    NotExplained,
}

/// Outcome of one reading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Update {
    pub status: Status,
    /// True if the search ended with a small step. If false for a used reading, the predictions were used up
    /// ([`crate::MAX_PREDICTIONS`]) and the estimate is the tangent's.
    pub converged: bool,
    /// Model inputs that explain the reading best; for a measured input that changes steadily, from all its readings.
    pub inputs: [f64; MAX_INPUTS],
    /// True if the reading indicates contact.
    pub in_contact: bool,
    /// Values used.
    pub used: usize,
    /// Rejected blocks of contradictory values, one bit each.
    pub rejected: u32,
    /// Normalised innovation squared of the values used: chi-squared with `used` degrees if filter and sensors agree.
    pub nis: f64,
    /// Its range of 95 % probability.
    pub nis_band: [f64; 2],
    /// Persistent contradiction.
    pub alarm: Option<Alarm>,
}

/// Estimate of an unknown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    pub value: f64,
    /// Standard deviation.
    pub sigma: f64,
    /// True if the readings identify it.
    pub identifiable: bool,
}

/// Persistent contradiction.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
pub enum Alarm {
    /// Measured inputs (one bit each) that contradict the other sensors: the measured value is not the value in the actuator.
    #[error("a measured input contradicts the other sensors")]
    Input(u32),
    /// Blocks of measured values (one bit each) that contradict the others and the model.
    #[error("a sensor contradicts the others")]
    Sensor(u32),
    /// Identifiable unknowns (one bit each) more than 4 standard deviations from their priors.
    #[error("an estimate is far from its prior")]
    Unknown(u32),
    /// The model does not explain the readings.
    #[error("the model does not explain the readings")]
    NotExplained,
}
