//! What the filter says of a reading and of the unknowns.

use crate::setup::MAX_INPUTS;

/// What became of a reading.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// The estimate takes it into account.
    Used,
    /// A measured input is missing or not a number; nothing changed.
    InputMissing,
    /// Its time is not after that of the reading before; nothing changed.
    NotLater,
    /// The search for the estimate did not end, or the model gives no value there; nothing changed.
    NotConverged,
    /// Too many of its values contradict the model and the estimate; nothing changed.
    NotExplained,
}

/// The outcome of one reading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Update {
    /// What became of it.
    pub status: Status,
    /// Whether the search ended with a small step. Otherwise, of a reading that is used, the predictions ended before
    /// ([`crate::MAX_PREDICTIONS`]), and the estimate is the tangent's.
    pub converged: bool,
    /// Model inputs that explain the reading best; a measured one that changes steadily is by all its readings.
    pub inputs: [f64; MAX_INPUTS],
    /// Whether the actuator touches, as far as the reading tells.
    pub in_contact: bool,
    /// Values used.
    pub used: usize,
    /// By block: bit set when its values were rejected as contradictory.
    pub rejected: u32,
    /// Normalised innovation squared of the values used: chi-squared with `used` degrees where filter and sensors agree.
    pub nis: f64,
    /// Its range of 95 % probability.
    pub nis_band: [f64; 2],
    /// What does not fit, lasting.
    pub alarm: Option<Alarm>,
}

/// An unknown's estimate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Value.
    pub value: f64,
    /// Standard deviation.
    pub sigma: f64,
    /// Whether the readings tell it.
    pub identifiable: bool,
}

/// What does not fit, lasting.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Alarm {
    /// These measured inputs contradict the other sensors: bit by input. The value read is not the value in the actuator.
    Input(u32),
    /// These blocks of measured values contradict the others and the model: bit by block.
    Sensor(u32),
    /// These unknowns are told by the readings and lie beyond 4 standard deviations of what was known before: bit by unknown.
    Unknown(u32),
    /// The model does not explain the readings.
    NotExplained,
}
