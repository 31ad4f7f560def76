//! Creep: a slow part of the response.

use serde::{Deserialize, Serialize};

/// Largest number of creep terms of an input.
pub const MAX_CREEPS: usize = 4;

/// Slow state `z' = (u - z) / tau` and its weight in `(1 - sum w) u + sum w z`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Creep {
    /// Time constant, s.
    pub time_s: f64,
    /// Weight: share of the response that comes late.
    pub weight: f64,
}

impl Creep {
    /// State after a step of `dt_s`, in which the input goes straight from `from` to `to`. Exact.
    pub(super) fn step(&self, state: f64, from: f64, to: f64, dt_s: f64) -> f64 {
        let slope = (to - from) / dt_s;
        let decay = (-dt_s / self.time_s).exp();
        to + (state - from) * decay + slope * self.time_s * (-dt_s / self.time_s).exp_m1()
    }
}
