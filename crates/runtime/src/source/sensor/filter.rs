//! Optional smoothing of the values of a sensor: median against spikes, low-pass against noise. Off by default: a filter
//! delays, and the twin's model wants the pressure of now.

use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// A filter as written in a scene file.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FilterSpec {
    /// Readings pass as they are.
    #[default]
    Off,
    /// Median of the last so many readings; odd, 3-99. Delays by half of them.
    Median(usize),
    /// First-order low-pass with this corner frequency, Hz.
    LowPassHz(f64),
}

impl FilterSpec {
    /// Everything that is wrong with it.
    pub fn problems(&self, key: &str, problems: &mut Vec<String>) {
        match *self {
            Self::Median(count) if count.is_multiple_of(2) || !(3..=99).contains(&count) => {
                problems
                    .push(format!("{key}.median: expected an odd number of readings, 3-99, found {count}"));
            }
            Self::LowPassHz(corner) if !(corner.is_finite() && corner > 0.0) => {
                problems
                    .push(format!("{key}.low-pass-hz: expected a finite frequency above 0, found {corner}"));
            }
            _ => {}
        }
    }
}

/// A filter with its memory.
///
/// Numbers that are not finite pass through and leave no trace: the twin is to see and count them, and one NaN must not
/// stay in a low-pass without end.
#[derive(Debug)]
pub enum Filter {
    /// Nothing to remember.
    Off,
    /// The newest readings.
    Median {
        /// How many.
        count: usize,
        /// Oldest first.
        recent: VecDeque<f64>,
    },
    /// The last output.
    LowPass {
        /// Time constant, s.
        tau_s: f64,
        /// When, ns, and what.
        last: Option<(u64, f64)>,
    },
}

impl Filter {
    /// An empty filter.
    pub fn new(spec: FilterSpec) -> Self {
        match spec {
            FilterSpec::Off => Self::Off,
            FilterSpec::Median(count) => Self::Median { count, recent: VecDeque::with_capacity(count) },
            FilterSpec::LowPassHz(corner) => {
                Self::LowPass { tau_s: 1.0 / (std::f64::consts::TAU * corner), last: None }
            }
        }
    }

    /// The filtered value of a reading taken at `t_ns`.
    pub fn apply(&mut self, t_ns: u64, value: f64) -> f64 {
        if !value.is_finite() {
            return value;
        }
        match self {
            Self::Off => value,
            Self::Median { count, recent } => {
                if recent.len() >= *count {
                    recent.pop_front();
                }
                recent.push_back(value);
                let mut sorted: Vec<f64> = recent.iter().copied().collect();
                sorted.sort_by(f64::total_cmp);
                sorted.get(sorted.len() / 2).copied().unwrap_or(value)
            }
            Self::LowPass { tau_s, last } => {
                let smooth = match *last {
                    None => value,
                    Some((before_ns, before)) => {
                        let step_s = t_ns.saturating_sub(before_ns) as f64 * 1e-9;
                        before + (value - before) * (1.0 - (-step_s / *tau_s).exp())
                    }
                };
                *last = Some((t_ns, smooth));
                smooth
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_median_removes_a_spike_and_keeps_a_step() {
        let mut filter = Filter::new(FilterSpec::Median(3));
        let out: Vec<f64> =
            [1.0, 1.0, 9.0, 1.0, 2.0, 2.0, 2.0].iter().map(|value| filter.apply(0, *value)).collect();
        assert_eq!(out[1..], [1.0, 1.0, 1.0, 2.0, 2.0, 2.0]);
    }

    /// The closed form of the first-order step response, whatever the rate it is sampled at.
    #[test]
    fn a_low_pass_answers_a_step_as_theory_says() {
        for step_ns in [1_000_000u64, 5_000_000, 20_000_000] {
            let mut filter = Filter::new(FilterSpec::LowPassHz(2.0));
            filter.apply(0, 0.0);
            let mut t_ns = 0;
            while t_ns < 200_000_000 {
                t_ns += step_ns;
                let expected = 1.0 - (-(t_ns as f64) * 1e-9 * std::f64::consts::TAU * 2.0).exp();
                assert!((filter.apply(t_ns, 1.0) - expected).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn nan_passes_and_leaves_no_trace() {
        for spec in [FilterSpec::Off, FilterSpec::Median(3), FilterSpec::LowPassHz(1.0)] {
            let mut filter = Filter::new(spec);
            filter.apply(0, 1.0);
            assert!(filter.apply(1, f64::NAN).is_nan() && filter.apply(2, f64::INFINITY).is_infinite());
            assert_eq!(filter.apply(3, 1.0), 1.0, "{spec:?}");
        }
    }

    proptest! {
        /// A filter never leaves the range of what it was given.
        #[test]
        fn a_filter_stays_within_its_input(values in prop::collection::vec(-1e6f64..1e6, 1..60), which in 0usize..3) {
            let spec = [FilterSpec::Off, FilterSpec::Median(5), FilterSpec::LowPassHz(3.0)][which];
            let mut filter = Filter::new(spec);
            let (low, high) = values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(*v), b.max(*v)));
            for (index, value) in (0u64..).zip(&values) {
                let out = filter.apply(index * 7_000_000, *value);
                prop_assert!(out >= low && out <= high, "{out} outside {low} .. {high}");
            }
        }
    }
}
