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
#[path = "../../../tests/unit/source_sensor_filter.rs"]
mod tests;
