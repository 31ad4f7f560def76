//! First-order lag with a time of filling and one of emptying, exact for straight inputs.

use serde::{Deserialize, Serialize};

/// Pneumatic line and valve: the lag `c' = (u - c) / tau`, with `tau` of filling where `u > c` and of emptying where `u < c`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Line {
    /// Time constant of filling, s.
    pub fill_s: f64,
    /// Time constant of emptying, s.
    pub empty_s: f64,
}

/// Instant within a step at which the lag's output turns, because the input crosses it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Turn {
    /// Time from the beginning of the step, s.
    pub after_s: f64,
    /// Output there.
    pub value: f64,
}

impl Line {
    /// Output after a step of `dt_s`, in which the input goes straight from `from` to `to`, and the output's turning point within
    /// it. Exact.
    pub(crate) fn step(&self, output: f64, from: f64, to: f64, dt_s: f64) -> (f64, Option<Turn>) {
        let slope = (to - from) / dt_s;
        let excess = output - from;
        let empties = excess > 0.0 || (excess == 0.0 && slope < 0.0);
        let (first_s, second_s) =
            if empties { (self.empty_s, self.fill_s) } else { (self.fill_s, self.empty_s) };
        let end = excess * (-dt_s / first_s).exp() + slope * first_s * (-dt_s / first_s).exp_m1();
        if excess == 0.0 || end * excess >= 0.0 {
            return (to + end, None);
        }
        // The excess e(s) = -m tau + (e_0 + m tau) exp(-s / tau) is 0 at s.
        let after_s = (first_s * (excess / (slope * first_s)).ln_1p()).clamp(0.0, dt_s);
        let turn = Turn { after_s, value: from + slope * after_s };
        (to + slope * second_s * (-(dt_s - after_s) / second_s).exp_m1(), Some(turn))
    }
}
