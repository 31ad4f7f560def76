//! A measured input that changes steadily: its value from all readings.
//!
//! State: value `u` and rate `r`, a Kalman filter whose rate walks at random (in `t` seconds by `change sqrt(t)`):
//!
//! ```text
//! u' = u + dt r      covariance of what is added over dt: change^2 [[dt^3 / 3, dt^2 / 2], [dt^2 / 2, dt]]
//! r' = r
//! ```
//!
//! The unknowns are estimated from the readings themselves, so that no reading counts twice; the trend affects the outputs only.

/// Deviation, in standard deviations, beyond which a value is a step and restarts the trend.
const STEP: f64 = 4.0;

/// Last value and rate, with their covariance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct InputTrend {
    t_s: f64,
    state: [f64; 2],
    /// Variance of the value, covariance, variance of the rate.
    covariance: [f64; 3],
}

impl InputTrend {
    /// Trend from one value with its variance.
    fn new(t_s: f64, value: f64, variance: f64, change: f64) -> Self {
        Self { t_s, state: [value, 0.0], covariance: [variance, 0.0, change * change] }
    }

    /// Trend after a value with its variance; `before` is the trend of the earlier values, `change` the standard deviation of the
    /// rate's change per second.
    pub(crate) fn follow(before: Option<Self>, t_s: f64, value: f64, variance: f64, change: f64) -> Self {
        let Some(before) = before else { return Self::new(t_s, value, variance, change) };
        let Self { state: [u, r], covariance: [a, b, c], .. } = before;
        let (dt, q) = (t_s - before.t_s, change * change);
        let predicted = [u + dt * r, r];
        let [a, b, c] =
            [a + dt * (2.0 * b + dt * c) + q * dt.powi(3) / 3.0, b + dt * c + q * dt * dt / 2.0, c + q * dt];
        let (off, spread) = (value - predicted[0], a + variance);
        let is_on_the_way = off * off <= STEP * STEP * spread; // false for NaN
        if !is_on_the_way {
            return Self::new(t_s, value, variance, change);
        }
        let gain = [a / spread, b / spread];
        let state = [predicted[0] + gain[0] * off, predicted[1] + gain[1] * off];
        Self { t_s, state, covariance: [a - gain[0] * a, b - gain[0] * b, c - gain[1] * b] }
    }

    pub(crate) fn value(&self) -> f64 {
        self.state[0]
    }

    pub(crate) fn variance(&self) -> f64 {
        self.covariance[0]
    }
}
