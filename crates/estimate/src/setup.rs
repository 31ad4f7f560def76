//! Setup of an estimation: measured, given and estimated quantities, the model's interface; and what comes out: estimates, the outcome of a
//! reading, alarms.

use crate::matrix::{MAX_STATES, Symmetric, Vector};
use serde::Serialize;
use thiserror::Error;

/// Largest number of model inputs.
pub const MAX_INPUTS: usize = 8;
/// Pasts of a measured input: of line and play, of creep.
pub const PASTS: usize = 2;
/// Largest number of measured values that the model predicts: a force, three coordinates of eight markers, six observables.
pub const MAX_ROWS: usize = 31;

/// Standard deviation of a held unknown, as a fraction of its prior's.
const HELD: f64 = 1e-3;

/// Estimated quantity with its prior.
#[derive(Clone, Debug, PartialEq)]
pub struct Unknown {
    pub name: String,
    pub prior: f64,
    /// Standard deviation of the prior.
    pub sigma: f64,
    /// Standard deviation of its drift in a second (random walk: `drift sqrt(t)` in `t` seconds); 0: constant.
    pub drift_per_sqrt_s: f64,
    /// Range of the model; an estimate stays inside it.
    pub range: [f64; 2],
}

impl Unknown {
    /// Variance of its drift in `passed_s` seconds.
    pub(crate) fn drift_variance(&self, passed_s: f64) -> f64 {
        self.drift_per_sqrt_s * self.drift_per_sqrt_s * passed_s
    }
}

/// Source of a model input's value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum InputRole {
    Given(f64),
    /// Estimated: position in the unknowns.
    Estimated(usize),
    /// Measured: `measured = true + bias + sum of past spread + noise`.
    Measured {
        /// Standard deviation of the noise of one reading.
        sigma: f64,
        /// Position of the bias in the unknowns, if it is estimated.
        bias: Option<usize>,
        /// Standard deviation of the change of its rate in a second, if the value changes steadily: the output is then estimated
        /// from all readings. `None`: from each reading alone.
        rate_change: Option<f64>,
        /// Positions in the unknowns of the pasts of its memory, if it has one: that of line and play, that of creep; -1 and 1 are the
        /// smallest and the largest past, 0 the one that the measured value assumes.
        pasts: [Option<usize>; PASTS],
    },
}

impl InputRole {
    /// Measured minus true value without noise, at spreads of the pasts.
    pub(crate) fn offset(&self, spread: [f64; PASTS], states: &Vector) -> f64 {
        self.offsets(spread).map(|(unknown, by)| by * states[unknown]).sum()
    }

    /// Unknowns in the measured value, and its derivative with respect to each.
    pub(crate) fn offsets(&self, spread: [f64; PASTS]) -> impl Iterator<Item = (usize, f64)> + use<> {
        let (bias, pasts) = match *self {
            Self::Measured { bias, pasts, .. } => (bias, pasts),
            _ => (None, [None; PASTS]),
        };
        let pasts = pasts.into_iter().zip(spread).filter_map(|(past, spread)| Some((past?, spread)));
        bias.map(|bias| (bias, 1.0)).into_iter().chain(pasts)
    }
}

/// Measured value that the model predicts.
#[derive(Clone, Debug, PartialEq)]
pub struct MeasuredRow {
    pub name: String,
    /// Block of values that are accepted or rejected together (the coordinates of a marker), counted from 0.
    pub block: usize,
    /// Standard deviation of the sensor's noise, independent from reading to reading.
    pub sigma: f64,
    /// Standard deviation of the model's error.
    pub model_sigma: f64,
    /// Position of the sensor's bias in the unknowns, if it is estimated: `measured = predicted + bias + noise`.
    pub bias: Option<usize>,
}

impl MeasuredRow {
    /// Variance of a measured value if `readings` share the model's error and therefore do not average it out.
    pub fn variance(&self, readings: f64) -> f64 {
        self.sigma * self.sigma + readings * self.model_sigma * self.model_sigma
    }
}

/// Motion of a body on the model: two unknowns that the model's step carries from reading to reading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Swing {
    /// Position of the inertial load in the unknowns; its prior is the load at rest.
    pub load: usize,
    /// Position of the velocity along the load's tangent, as a rate of the load.
    pub rate: usize,
    /// Standard deviation of the model's frequency, as a fraction of it.
    pub frequency_error: f64,
}

/// Setup of an estimation.
#[derive(Clone, Debug, PartialEq)]
pub struct Setup {
    pub unknowns: Vec<Unknown>,
    /// Role per model input, in the model's order.
    pub inputs: Vec<InputRole>,
    /// Predicted measurements, blocks in order.
    pub rows: Vec<MeasuredRow>,
    /// Position of the gap in the inputs; `None` for a model without contact.
    pub gap: Option<usize>,
    /// Correlation time of the model's error (s). Readings within it do not average the error out.
    pub model_correlation_s: f64,
    /// Time (s) without evidence after which an alarm ends.
    pub alarm_hold_s: f64,
    /// `None` for a model at equilibrium.
    pub swing: Option<Swing>,
}

#[derive(Clone, Debug, Error, PartialEq)]
#[error("{place}: expected {expected}, found {found}")]
pub struct SetupError {
    /// Place of the error.
    pub place: String,
    pub expected: String,
    pub found: String,
}

/// Errors of a setup, as they are found.
#[derive(Default)]
struct SetupErrors(Vec<SetupError>);

impl SetupErrors {
    fn expect(&mut self, fits: bool, place: &str, expected: &str, found: impl FnOnce() -> String) {
        if !fits {
            self.0.push(SetupError { place: place.into(), expected: expected.into(), found: found() });
        }
    }

    fn at_most(&mut self, most: usize, place: &str, found: usize) {
        self.expect(found <= most, place, &format!("at most {most}"), || found.to_string());
    }

    fn positive(&mut self, place: &str, expected: &str, value: f64) {
        self.expect(value.is_finite() && value > 0.0, place, expected, || value.to_string());
    }

    fn at_least_zero(&mut self, place: &str, expected: &str, value: f64) {
        self.expect(value.is_finite() && value >= 0.0, place, expected, || value.to_string());
    }

    /// A position in the unknowns, if there is one.
    fn exists(&mut self, place: &str, unknown: Option<usize>, unknowns: usize) {
        let exists = unknown.is_none_or(|unknown| unknown < unknowns);
        self.expect(exists, place, "an unknown that exists", || {
            unknown.map_or(String::new(), |unknown| unknown.to_string())
        });
    }

    fn unknown(&mut self, unknown: &Unknown) {
        let Unknown { name, prior, sigma, drift_per_sqrt_s, range: [low, high] } = unknown;
        self.positive(&format!("{name}: sigma"), "above 0", *sigma);
        self.at_least_zero(&format!("{name}: drift"), "0 or more", *drift_per_sqrt_s);
        let inside = low < high && (low..=high).contains(&prior);
        let found = || format!("{prior} in {low} to {high}");
        self.expect(inside, &format!("{name}: prior"), "a value in the model's range", found);
    }

    fn role(&mut self, place: &str, role: &InputRole, unknowns: usize) {
        match *role {
            InputRole::Given(value) => self.expect(!value.is_nan(), place, "a number", || value.to_string()),
            InputRole::Estimated(unknown) => self.exists(place, Some(unknown), unknowns),
            InputRole::Measured { sigma, bias, rate_change, pasts } => {
                self.positive(place, "a change of its rate above 0", rate_change.unwrap_or(1.0));
                self.positive(place, "a sigma above 0", sigma);
                self.exists(place, bias, unknowns);
                pasts.into_iter().for_each(|past| self.exists(place, past, unknowns));
            }
        }
    }

    /// `block` is that of the row before.
    fn row(&mut self, row: &MeasuredRow, block: usize, unknowns: usize) {
        let place = row.name.as_str();
        self.positive(place, "a sigma above 0", row.sigma);
        self.at_least_zero(place, "a model sigma of 0 or more", row.model_sigma);
        self.exists(place, row.bias, unknowns);
        let follows = row.block == block || row.block == block + 1;
        self.expect(follows, place, "blocks that count up from 0", || row.block.to_string());
    }
}

impl Setup {
    /// Checks the setup.
    ///
    /// # Errors
    /// All errors; never empty.
    pub fn check(&self) -> Result<(), Vec<SetupError>> {
        let mut errors = SetupErrors::default();
        let states = self.unknowns.len() + self.measured_inputs().count();
        errors.at_most(MAX_STATES, "unknowns and measured inputs", states);
        errors.at_most(MAX_INPUTS, "inputs", self.inputs.len());
        errors.at_most(MAX_ROWS, "measurements", self.rows.len());
        errors.at_least_zero("model_correlation_s", "0 or more", self.model_correlation_s);
        errors.at_least_zero("alarm_hold_s", "0 or more", self.alarm_hold_s);
        self.unknowns.iter().for_each(|unknown| errors.unknown(unknown));
        for (input, role) in self.inputs.iter().enumerate() {
            errors.role(&format!("input {input}"), role, self.unknowns.len());
        }
        let mut block = 0;
        for row in &self.rows {
            errors.row(row, block, self.unknowns.len());
            block = row.block;
        }
        if let Some(swing) = &self.swing {
            let last = [self.unknowns.len().wrapping_sub(2), self.unknowns.len().wrapping_sub(1)];
            let fits = self.load_input().is_some() && [swing.load, swing.rate] == last;
            errors.expect(fits, "swing", "an estimated load and its rate as the last unknowns", || {
                format!("{swing:?}")
            });
            errors.at_least_zero("swing: frequency error", "0 or more", swing.frequency_error);
        }
        let has_gap = self.gap.is_none_or(|gap| gap < self.inputs.len());
        errors.expect(has_gap, "gap", "an input", || format!("{:?}", self.gap));
        if errors.0.is_empty() { Ok(()) } else { Err(errors.0) }
    }

    /// Model inputs of a reading whose measured inputs have no noise, only the biases among `unknowns`.
    pub fn inputs(&self, measurement: &Measurement, unknowns: &[f64]) -> [f64; MAX_INPUTS] {
        let mut states = [0.0; MAX_STATES];
        states.iter_mut().zip(unknowns).for_each(|(to, from)| *to = *from);
        self.inputs_at(measurement, &states)
    }

    /// Model inputs of a state (unknowns, then the noise of the measured inputs).
    pub(crate) fn inputs_at(&self, measurement: &Measurement, states: &Vector) -> [f64; MAX_INPUTS] {
        let mut out = [f64::NAN; MAX_INPUTS];
        let (mut noise, mut by_noise) = (self.unknowns.len(), 0.0);
        for (input, role) in self.inputs.iter().enumerate() {
            out[input] = match *role {
                InputRole::Given(value) => value,
                InputRole::Estimated(unknown) => states[unknown],
                role @ InputRole::Measured { .. } => {
                    noise += 1;
                    by_noise += measurement.load_by_input[input] * states[noise - 1];
                    measurement.inputs[input]
                        - role.offset(measurement.spread[input], states)
                        - states[noise - 1]
                }
            };
        }
        if let Some(load) = self.load_input() {
            out[load] -= by_noise;
        }
        out
    }

    /// Prior means and variances of the unknowns.
    pub(crate) fn priors(&self) -> (Vector, Vector) {
        let (mut means, mut variances) = ([0.0; MAX_STATES], [0.0; MAX_STATES]);
        for (index, unknown) in self.unknowns.iter().enumerate() {
            means[index] = unknown.prior;
            variances[index] = unknown.sigma * unknown.sigma;
        }
        (means, variances)
    }

    /// Information of the priors: the inverse of their variances.
    pub(crate) fn prior_information(&self) -> Symmetric {
        let mut out = Symmetric::diagonal(&[0.0; MAX_STATES][..self.unknowns.len()]);
        for (index, unknown) in self.unknowns.iter().enumerate() {
            out.add_diagonal(index, 1.0 / (unknown.sigma * unknown.sigma));
        }
        out
    }

    /// Positions and standard deviations of the measured inputs, in order; the noise of each is a further state.
    pub fn measured_inputs(&self) -> impl Iterator<Item = (usize, f64)> {
        self.inputs.iter().enumerate().filter_map(|(input, role)| match role {
            InputRole::Measured { sigma, .. } => Some((input, *sigma)),
            _ => None,
        })
    }

    /// Inverse variances of the noise of the measured inputs, in order, and their number.
    pub(crate) fn noise_information(&self) -> (Vector, usize) {
        let (mut out, mut count) = ([0.0; MAX_STATES], 0);
        for (out, (_, sigma)) in out.iter_mut().zip(self.measured_inputs()) {
            *out = 1.0 / (sigma * sigma);
            count += 1;
        }
        (out, count)
    }

    /// True if a reading has every measured input.
    pub(crate) fn is_complete(&self, measurement: &Measurement) -> bool {
        self.measured_inputs().all(|(input, _)| measurement.inputs[input].is_finite())
    }

    /// The same with the motion at rest: its unknowns, the last ones, are left out.
    #[must_use]
    pub fn at_rest(mut self) -> Self {
        if let (Some(swing), Some(input)) = (self.swing, self.load_input()) {
            self.inputs[input] = InputRole::Given(self.unknowns[swing.load].prior);
            self.unknowns.truncate(swing.load.min(swing.rate));
        }
        self.swing = None;
        self
    }

    /// The same with unknowns that do not change over time.
    #[must_use]
    pub(crate) fn without_drift(mut self) -> Self {
        self.unknowns.iter_mut().for_each(|unknown| unknown.drift_per_sqrt_s = 0.0);
        self
    }

    /// The same with all unknowns but those of a motion at these values.
    #[must_use]
    pub fn held_at(mut self, values: &[f64]) -> Self {
        let moving: Vec<bool> = (0..self.unknowns.len()).map(|at| self.is_moving(at)).collect();
        for ((unknown, value), _) in
            self.unknowns.iter_mut().zip(values).zip(moving).filter(|(_, is_moving)| !is_moving)
        {
            unknown.prior = value.clamp(unknown.range[0], unknown.range[1]);
            unknown.sigma *= HELD;
        }
        self
    }

    /// True for an unknown that changes with the motion.
    pub(crate) fn is_moving(&self, unknown: usize) -> bool {
        self.swing.is_some_and(|swing| unknown == swing.load || unknown == swing.rate)
    }

    /// Position of the inertial load in the inputs.
    pub(crate) fn load_input(&self) -> Option<usize> {
        let load = self.swing?.load;
        self.inputs.iter().position(|role| *role == InputRole::Estimated(load))
    }

    /// States with all noise of inputs and motion at 0.
    pub(crate) fn without_noise(&self, states: &Vector) -> Vector {
        let mut states = *states;
        states[self.unknowns.len()..].fill(0.0);
        states
    }

    /// Unknown of the gap, if it is estimated.
    pub(crate) fn gap_unknown(&self) -> Option<usize> {
        match self.inputs[self.gap?] {
            InputRole::Estimated(unknown) => Some(unknown),
            _ => None,
        }
    }
}

/// Reading: all values measured at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measurement {
    /// Time (s), from any origin.
    pub t_s: f64,
    /// Measured value per model input; NaN if absent.
    pub inputs: [f64; MAX_INPUTS],
    /// Largest errors of each of them by the pasts of its memory; 0 without memory.
    pub spread: [[f64; PASTS]; MAX_INPUTS],
    /// Derivative of a swing's load with respect to each measured input at a fixed position of the body; the filter sets it.
    pub(crate) load_by_input: [f64; MAX_INPUTS],
    /// Measured value per row of the setup; NaN if absent.
    pub rows: [f64; MAX_ROWS],
}

impl Measurement {
    /// Reading without any value.
    pub fn at(t_s: f64) -> Self {
        Self {
            t_s,
            inputs: [f64::NAN; MAX_INPUTS],
            spread: [[0.0; PASTS]; MAX_INPUTS],
            load_by_input: [0.0; MAX_INPUTS],
            rows: [f64::NAN; MAX_ROWS],
        }
    }
}

/// Predicted value with its derivative with respect to each model input.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Predicted {
    /// Value, in the row's unit.
    pub value: f64,
    /// Derivatives, per unit of the input.
    pub gradient: [f64; MAX_INPUTS],
}

/// Motion at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionState {
    /// Time (s).
    pub t_s: f64,
    /// Inputs, with the moving load; an infinite gap where no obstacle is known.
    pub inputs: [f64; MAX_INPUTS],
    /// Velocity along the tangent of the load, as a rate of the load.
    pub rate: f64,
}

/// Motion after a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionEnd {
    pub load: f64,
    /// Velocity along its tangent, as a rate of the load.
    pub rate: f64,
    /// The body landed or left within the step.
    pub has_changed: bool,
}

/// Model as the estimator uses it.
pub trait Model {
    /// Predicts the rows of the setup at a state. Returns true if the state touches the obstacle. Values are not finite if the
    /// model has no prediction there.
    fn predict(&mut self, inputs: &[f64; MAX_INPUTS], out: &mut [Predicted]) -> bool;

    /// [`Self::predict`] without an obstacle: the gap among the inputs is infinite.
    fn predict_free(&mut self, inputs: &[f64; MAX_INPUTS], out: &mut [Predicted]) {
        self.predict(inputs, out);
    }

    /// Largest gap (mm) at which the actuator touches with the other inputs; `None` if no gap does.
    fn onset_gap_mm(&mut self, inputs: &[f64; MAX_INPUTS]) -> Option<f64>;

    /// Approximate depth of a state's gap inside the contact (mm), from the last [`Self::predict`], with an error of at most a
    /// factor of 2. `None` if a prediction would be needed.
    fn inside_contact_mm(&self, _inputs: &[f64; MAX_INPUTS]) -> Option<f64> {
        None
    }

    /// Motion from a state near the last one of [`Self::settle`] to a time with these inputs, whose load is that at rest or any. `None` if no
    /// motion leads there: the body is at rest then.
    fn step(&mut self, _from: &MotionState, _t_s: f64, _inputs: &[f64; MAX_INPUTS]) -> Option<MotionEnd> {
        None
    }

    /// Adopts the state at the end of the last [`Self::step`] as the one from which the next begins.
    fn settle(&mut self, _at: &MotionState, _in_contact: bool) {}
}

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
    pub used: usize,
    /// Rejection blocks of contradictory values, one bit each.
    pub rejected: u32,
    /// Normalised innovation squared of the values used: chi-squared with `used` degrees if filter and sensors agree.
    pub nis: f64,
    /// Its range of 95 % probability.
    pub nis_band: [f64; 2],
    /// Set while readings have contradicted the filter for a while.
    pub alarm: Option<Alarm>,
}

/// Estimate of an unknown.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Estimate {
    pub value: f64,
    pub sigma: f64,
    /// True if the readings identify it.
    pub identifiable: bool,
}

/// What readings have contradicted for longer than noise explains.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
pub enum Alarm {
    /// Measured inputs (one bit each) that contradict the other sensors: the measured value is not the value in the actuator.
    #[error("a measured input contradicts the other sensors")]
    Input(u32),
    /// Blocks of measured values (one bit each) that contradict the others and the model.
    #[error("a sensor contradicts the others")]
    Sensor(u32),
    /// Identifiable unknowns (one bit each) more than 4 standard deviations from their priors, or unknowns that were found elsewhere after
    /// measured values had been rejected.
    #[error("an estimate is far from its prior, or has moved")]
    Unknown(u32),
    /// The model does not explain the readings.
    #[error("the model does not explain the readings")]
    NotExplained,
}
