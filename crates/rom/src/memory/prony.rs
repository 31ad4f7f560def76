//! Load filter of a material whose deviatoric stress relaxes by a Prony series.
//!
//! A static family at the long-term modulus, driven by the load `P^` with `P = P^ + sum r_k h_k`, `h_k' = P^' - h_k / tau_k`: the relaxing part
//! of the stress takes `r_k h_k` of the load. With `z_k = P^ - h_k` the states are those of viscous elements, `z_k' = (P^ - z_k) / tau_k`, and
//! `P^ = (P + sum r_k z_k) / (1 + sum r_k)`. At rest `z_k = P^ = P`.

use serde::{Deserialize, Serialize};

/// Largest number of terms.
pub const MAX_PRONY: usize = 4;
/// Longest inner step as a fraction of the shortest time constant.
const INNER: f64 = 0.25;
/// Most inner steps; a longer step is nearer to rest than the error of longer inner steps.
const MAX_INNER: f64 = 64.0;

/// Term of a series.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PronyTerm {
    /// Ratio of the relaxing modulus to the long-term modulus, `w / (1 - sum w)` of weights `w` of the instantaneous modulus.
    pub ratio: f64,
    /// Relaxation time, s.
    pub time_s: f64,
}

/// Filter of one load.
#[derive(Clone, Debug, PartialEq)]
pub struct Prony {
    terms: [PronyTerm; MAX_PRONY],
    count: usize,
    states: [f64; MAX_PRONY],
    load: f64,
    filtered: f64,
}

impl Prony {
    /// Filter at rest under a load.
    ///
    /// # Errors
    /// A sentence if there are more than [`MAX_PRONY`] terms, or a ratio or time is not positive and finite.
    pub fn at_rest(terms: &[PronyTerm], load: f64) -> Result<Self, String> {
        if terms.len() > MAX_PRONY {
            return Err(format!("expected at most {MAX_PRONY} Prony terms, found {}", terms.len()));
        }
        let positive = |value: f64| value > 0.0 && value.is_finite();
        if let Some(term) = terms.iter().find(|term| !positive(term.ratio) || !positive(term.time_s)) {
            return Err(format!(
                "expected Prony ratios and times above 0, found {} and {} s",
                term.ratio, term.time_s
            ));
        }
        let mut own = [PronyTerm { ratio: 0.0, time_s: 1.0 }; MAX_PRONY];
        own[..terms.len()].copy_from_slice(terms);
        Ok(Self { terms: own, count: terms.len(), states: [load; MAX_PRONY], load, filtered: load })
    }

    /// Load `P^` of the static family.
    pub fn filtered(&self) -> f64 {
        self.filtered
    }

    /// `sum r_k h_k = P - P^`: the part of the load that the relaxing stress carries.
    pub fn relaxing(&self) -> f64 {
        self.load - self.filtered
    }

    /// Advances by `dt_s`, in which the load goes straight to `to`; returns `P^`. Unconditionally stable; exact where `P^` is straight
    /// within an inner step. A step of no duration is a jump.
    pub fn step(&mut self, to: f64, dt_s: f64) -> f64 {
        let terms = &self.terms[..self.count];
        let shortest = terms.iter().map(|term| term.time_s).fold(f64::INFINITY, f64::min);
        let count = (dt_s / (INNER * shortest)).ceil().clamp(1.0, MAX_INNER);
        let (from, inner_s) = (self.load, dt_s / count);
        for k in 1..=count as u32 {
            let load = from + (to - from) * f64::from(k) / count;
            // z_k = a_k P^ + b_k at the end of the step.
            let (mut left, mut right) = (1.0, load);
            let parts = |term: &PronyTerm| {
                let x = inner_s / term.time_s;
                // (1 - e^-x) / x, 1 at x = 0
                let mean = if x > 0.0 { -(-x).exp_m1() / x } else { 1.0 };
                (1.0 - mean, (-x).exp(), mean - (-x).exp())
            };
            for (term, state) in terms.iter().zip(&self.states) {
                let (a, decay, past) = parts(term);
                left += term.ratio * (1.0 - a);
                right += term.ratio * (decay * state + past * self.filtered);
            }
            let filtered = right / left;
            for (term, state) in terms.iter().zip(&mut self.states) {
                let (a, decay, past) = parts(term);
                *state = a * filtered + decay * *state + past * self.filtered;
            }
            self.filtered = filtered;
        }
        self.load = to;
        self.filtered
    }
}
