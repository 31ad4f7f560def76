//! A measured input that changes steadily: its value by all readings up to now, not by the last one alone.
//!
//! State: value `u` and rate `r`, a Kalman filter whose rate walks at random (in `t` seconds by `change sqrt(t)`):
//! ```text
//! u' = u + dt r      covariance of what is added over dt: change^2 [[dt^3 / 3, dt^2 / 2], [dt^2 / 2, dt]]
//! r' = r
//! ```
//! The unknowns are estimated from the readings themselves, so that none counts twice; the trend is only of what comes out.

/// A value that many standard deviations off is a step: what was before does not count any more.
const STEP: f64 = 4.0;

/// The last value and rate, with their covariance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Trend {
    t_s: f64,
    state: [f64; 2],
    /// Of the value, of both, of the rate.
    covariance: [f64; 3],
}

impl Trend {
    /// From one value with its variance.
    fn new(t_s: f64, value: f64, variance: f64, change: f64) -> Self {
        Self { t_s, state: [value, 0.0], covariance: [variance, 0.0, change * change] }
    }

    /// Takes a value with its variance into account; `change` is the standard deviation of the rate's change in a second. `before` is
    /// what earlier values said.
    pub(crate) fn follow(before: Option<Self>, t_s: f64, value: f64, variance: f64, change: f64) -> Self {
        let Some(before) = before else { return Self::new(t_s, value, variance, change) };
        let Self { state: [u, r], covariance: [a, b, c], .. } = before;
        let (dt, q) = (t_s - before.t_s, change * change);
        let predicted = [u + dt * r, r];
        let [a, b, c] =
            [a + dt * (2.0 * b + dt * c) + q * dt.powi(3) / 3.0, b + dt * c + q * dt * dt / 2.0, c + q * dt];
        let (off, spread) = (value - predicted[0], a + variance);
        let is_on_the_way = off * off <= STEP * STEP * spread; // not where either is no number
        if !is_on_the_way {
            return Self::new(t_s, value, variance, change);
        }
        let gain = [a / spread, b / spread];
        let state = [predicted[0] + gain[0] * off, predicted[1] + gain[1] * off];
        Self { t_s, state, covariance: [a - gain[0] * a, b - gain[0] * b, c - gain[1] * b] }
    }

    /// The value.
    pub(crate) fn value(&self) -> f64 {
        self.state[0]
    }

    /// Its variance.
    pub(crate) fn variance(&self) -> f64 {
        self.covariance[0]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Noise of standard deviation 1 from a linear congruence: the sum of twelve uniform numbers.
    fn noise(seed: &mut u64) -> f64 {
        let mut uniform = || {
            *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (*seed >> 11) as f64 / (1_u64 << 53) as f64
        };
        (0..12).map(|_| uniform()).sum::<f64>() - 6.0
    }

    /// Errors of the value in its own standard deviations at the end of ramps, and the standard deviation.
    fn ramps(rate: f64) -> (Vec<f64>, f64) {
        let (mut seed, mut off, mut sigma) = (7, Vec::new(), 0.0);
        for _ in 0..200 {
            let mut trend = None;
            for k in 0..400 {
                let t_s = f64::from(k) / 200.0;
                let value = rate * t_s + 5e-4 * noise(&mut seed);
                trend = Some(Trend::follow(trend, t_s, value, 5e-4 * 5e-4, 0.005));
            }
            let trend = trend.expect("values");
            sigma = trend.variance().sqrt();
            off.push((trend.value() - rate * 399.0 / 200.0) / sigma);
        }
        (off, sigma)
    }

    #[test]
    fn noise_averages_out_on_a_ramp_without_lag() {
        for rate in [0.0, 0.01, -0.02] {
            let (off, sigma) = ramps(rate);
            assert!(sigma < 0.35 * 5e-4, "{sigma}");
            let mean = off.iter().sum::<f64>() / 200.0;
            // A constant rate is the best case of a rate that walks.
            let square = off.iter().map(|off| off * off).sum::<f64>() / 200.0;
            assert!(mean.abs() < 0.25 && (0.5..1.2).contains(&square), "{rate}: {mean} {square}");
        }
    }

    #[test]
    fn a_step_counts_at_once_and_a_single_wild_value_is_gone_at_the_next() {
        let at =
            |k: usize, value: f64, trend| Some(Trend::follow(trend, k as f64 / 200.0, value, 2.5e-7, 0.005));
        let mut trend = (0..100).fold(None, |trend, k| at(k, 0.02, trend));
        trend = at(100, 0.05, trend);
        assert_eq!(trend.map(|trend| trend.value()), Some(0.05));
        trend = at(101, 0.02, trend);
        assert_eq!(trend.map(|trend| trend.value()), Some(0.02));
    }

    #[test]
    fn no_number_never_stays() {
        let wild = Trend::follow(None, 0.0, f64::NAN, 1.0, 0.1);
        assert_eq!(Trend::follow(Some(wild), 1.0, 3.0, 1.0, 0.1).value(), 3.0);
    }
}
