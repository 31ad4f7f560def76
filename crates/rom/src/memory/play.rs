//! Rate-independent loops: a Prandtl-Ishlinskii sum of play operators.

use serde::{Deserialize, Serialize};

/// Largest number of play operators of an input.
pub const MAX_PLAYS: usize = 6;

/// Play operator `y = max(u - r, min(u + r, y))` and its weight.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Play {
    /// Threshold `r`: half of the play, in the unit of the input.
    pub threshold: f64,
    /// Weight `w` in `(1 - sum w) u + sum w y`.
    pub weight: f64,
}

impl Play {
    /// State after the input went to `input` without turning: depends on turning points, not on time.
    pub fn follow(&self, state: f64, input: f64) -> f64 {
        (input - self.threshold).max((input + self.threshold).min(state))
    }
}
