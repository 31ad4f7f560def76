//! Residual of a measured quantity: measured minus predicted value, over the readings.
//!
//! With weights `exp(-t / T)` the mean `m`, the variance `v` and the number `N` of equally weighted readings give the bound of the
//! prediction's error that the readings show, for a sensor of standard deviation `sigma`:
//!
//! ```text
//! s^2 = max(0, v - sigma^2 (1 + 2 sqrt(2 / N)))                     scatter that is no noise of the sensor
//! seen = sqrt(max(0, m^2 - 4 sigma^2 / N) + s^2)                    beyond chance
//! contribution = min(|m| + sqrt(1.645^2 s^2 + 3^2 sigma^2 / N), 4 seen),   at least |residual| - 3 sigma
//! ```
//!
//! The larger one of two `T` counts: one follows a residual that changes, the other remembers it. The published half-width is the root
//! of the sum of the squares of this contribution and the model's half-width.

use rom::halfwidths::HALFWIDTH_SIGMAS;
use std::time::Duration;

/// Time constants of the contribution, s.
const SEEN_S: [f64; 2] = [0.25, 2.0];
/// Standard deviations of a mean or a reading that are chance.
const CHANCE: f64 = 2.0;
/// Standard deviations of a single reading that are chance, and of a steady mean that raises the alarm.
const RARE: f64 = 3.0;
/// Factor of what is seen beyond chance in the contribution, so that the contribution grows from 0 continuously.
const GROWTH: f64 = 4.0;
/// Standard deviations beyond which a reading is far from those before.
const STEP: f64 = 4.0;
/// Smallest number of readings that raise the alarm.
const MIN_READINGS: f64 = 5.0;

/// Residual of one reading.
#[derive(Debug, Clone, Copy)]
pub(super) struct Residual {
    /// When the reading was taken.
    pub(super) t_sensor_ns: u64,
    /// Measured minus predicted value; NaN without one of them.
    pub(super) value: f64,
    /// Half-width of the prediction by the model; NaN if it has none.
    pub(super) halfwidth: f64,
    /// Standard deviation of the sensor.
    pub(super) sigma: f64,
}

/// Result of a reading.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct ResidualVerdict {
    /// Share of the half-width that the residuals require; 0 if nothing was measured yet.
    pub(super) contribution: f64,
    /// The alarm stands.
    pub(super) mismatch: bool,
}

impl ResidualVerdict {
    /// Both results as one, with the contributions combined by `combine`.
    pub(super) fn joined(self, other: Self, combine: fn(f64, f64) -> f64) -> Self {
        let contribution = combine(self.contribution, other.contribution);
        Self { contribution, mismatch: self.mismatch || other.mismatch }
    }
}

/// Weighted sums over the readings.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    last_ns: u64,
    weight: f64,
    weight_square: f64,
    value: f64,
    square: f64,
}

impl Sums {
    fn add(&mut self, t_ns: u64, value: f64, memory_s: f64) {
        let passed_s = Duration::from_nanos(t_ns.saturating_sub(self.last_ns)).as_secs_f64();
        let kept = if self.weight > 0.0 { (-passed_s / memory_s).exp() } else { 0.0 };
        self.last_ns = t_ns;
        self.weight = kept * self.weight + 1.0;
        self.weight_square = kept * kept * self.weight_square + 1.0;
        self.value = kept * self.value + value;
        self.square = kept * self.square + value * value;
    }

    /// Number of equally weighted readings; at least 1 after a reading.
    fn count(&self) -> f64 {
        self.weight * self.weight / self.weight_square
    }

    fn mean(&self) -> f64 {
        self.value / self.weight
    }

    fn variance(&self) -> f64 {
        (self.square / self.weight - self.mean().powi(2)).max(0.0)
    }

    /// Share of the half-width for a sensor of this standard deviation; 0 without readings.
    fn contribution(&self, sigma: f64) -> f64 {
        if self.weight <= 0.0 {
            return 0.0;
        }
        let (mean, count) = (self.mean(), self.count());
        let of_mean = sigma * sigma / count;
        let noise = sigma * sigma * (1.0 + CHANCE * (2.0 / count).sqrt());
        let scatter = (self.variance() - noise).max(0.0);
        let beyond = ((mean * mean - CHANCE * CHANCE * of_mean).max(0.0) + scatter).sqrt();
        let bound = mean.abs() + (HALFWIDTH_SIGMAS * scatter.sqrt()).hypot(RARE * of_mean.sqrt());
        bound.min(GROWTH * beyond)
    }
}

/// Contribution of the residuals of a measured quantity.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Seen {
    sums: [Sums; 2],
    /// The last reading was far from those before: it counts if the next one is, too. Single outliers do not.
    is_doubtful: bool,
}

impl Seen {
    /// Takes the residual of a reading, for a sensor of this standard deviation; NaN, nothing measured, leaves it unchanged.
    pub(super) fn update(&mut self, t_sensor_ns: u64, value: f64, sigma: f64) -> f64 {
        let [latest, _] = &self.sums;
        let spread = sigma.hypot(latest.variance().sqrt());
        let is_far = latest.weight > 0.0 && (value - latest.mean()).abs() > STEP * spread; // false for NaN
        let counts = !value.is_nan() && (!is_far || self.is_doubtful);
        self.is_doubtful = is_far;
        if counts {
            let each = self.sums.iter_mut().zip(SEEN_S);
            each.for_each(|(sums, memory_s)| sums.add(t_sensor_ns, value, memory_s));
        }
        let of_reading = if counts { value.abs() - RARE * sigma } else { 0.0 };
        self.sums.iter().map(|sums| sums.contribution(sigma)).fold(of_reading.max(0.0), f64::max)
    }
}

/// Residuals of a measured quantity: what they add to the half-width, and whether they contradict the model.
///
/// The alarm rises when the residual stays outside half-width and noise for longer than a given time, or when its mean over that time
/// differs from 0 by more than half-width and standard deviation of the sensor: a leak, a wrong gap, a torn chamber. Single outliers
/// and the moment of contact raise no alarm.
#[derive(Debug, Clone, Default)]
pub(super) struct ResidualWatch {
    outside_since_ns: Option<u64>,
    outside_count: f64,
    seen: Seen,
    steady: Sums,
    steady_since_ns: u64,
}

impl ResidualWatch {
    /// Takes the residual of a reading; the alarm needs a contradiction of `after_s`. Without a measured value the times restart and the
    /// contribution stays.
    pub(super) fn update(&mut self, residual: Residual, after_s: f64) -> ResidualVerdict {
        let Residual { t_sensor_ns, value, halfwidth, sigma } = residual;
        let contribution = self.seen.update(t_sensor_ns, value, sigma);
        // Without a half-width, as outside the training range, nothing contradicts the model.
        if value.is_nan() || halfwidth.is_nan() {
            (self.outside_since_ns, self.steady) = (None, Sums::default());
            return ResidualVerdict { contribution, mismatch: false };
        }
        let mismatch = self.is_outside(residual, after_s) | self.is_steady(residual, after_s);
        ResidualVerdict { contribution, mismatch }
    }

    /// Forgets all readings, for another model.
    pub(super) fn restart(&mut self) {
        *self = Self::default();
    }

    /// Every residual has been outside half-width and noise for the time.
    fn is_outside(&mut self, residual: Residual, after_s: f64) -> bool {
        let Residual { t_sensor_ns, value, halfwidth, sigma } = residual;
        if value.abs() <= halfwidth.hypot(CHANCE * sigma) {
            self.outside_since_ns = None;
            return false;
        }
        self.outside_count = self.outside_since_ns.map_or(1.0, |_| self.outside_count + 1.0);
        let since_ns = *self.outside_since_ns.get_or_insert(t_sensor_ns);
        self.outside_count >= MIN_READINGS && has_passed(since_ns, t_sensor_ns, after_s)
    }

    /// The mean of residuals that stay alike is beyond half-width and standard deviation.
    fn is_steady(&mut self, residual: Residual, after_s: f64) -> bool {
        let Residual { t_sensor_ns, value, halfwidth, sigma } = residual;
        let spread = (sigma * sigma + self.steady.variance()).sqrt();
        if self.steady.weight <= 0.0 || (value - self.steady.mean()).abs() > STEP * spread {
            (self.steady, self.steady_since_ns) = (Sums::default(), t_sensor_ns);
        }
        self.steady.add(t_sensor_ns, value, after_s.max(f64::MIN_POSITIVE));
        let count = self.steady.count();
        let allowed = halfwidth.hypot(sigma) + RARE * sigma / count.sqrt();
        count >= MIN_READINGS
            && has_passed(self.steady_since_ns, t_sensor_ns, after_s)
            && self.steady.mean().abs() > allowed
    }
}

fn has_passed(since_ns: u64, now_ns: u64, time_s: f64) -> bool {
    Duration::from_nanos(now_ns.saturating_sub(since_ns)).as_secs_f64() >= time_s
}

#[cfg(test)]
#[path = "../../tests/unit/twin_residual.rs"]
mod tests;
