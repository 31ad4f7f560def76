//! Relaxation of a material by a Prony series: load filter of its static family, and internal variables of a quantity.
//!
//! A static family at the long-term modulus is driven by the load `P^` with `P = P^ + sum r_k h_k`, `h_k' = P^' - h_k / tau_k`: the relaxing part
//! of the stress takes `r_k h_k` of the load. `P^ / P = 1 / (1 + sum r_k tau_k s / (1 + tau_k s))` has as many real poles as terms, so that
//! the filter is a sum of creep terms with the same poles and residues.

use super::creep::Creep;
use serde::{Deserialize, Serialize};

/// Largest number of terms.
pub const MAX_PRONY: usize = 4;
/// Halvings of an interval that contains a pole.
const HALVINGS: usize = 200;

/// Term of a series.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PronyTerm {
    /// Ratio of the relaxing modulus to the long-term modulus, `w / (1 - sum w)` of weights `w` of the instantaneous modulus.
    pub ratio: f64,
    /// Relaxation time, s.
    pub time_s: f64,
}

impl PronyTerm {
    /// Checks a series.
    ///
    /// # Errors
    /// A sentence if there are more than [`MAX_PRONY`] terms, or a ratio or time is not positive and finite.
    pub fn check(terms: &[Self]) -> Result<(), String> {
        if terms.len() > MAX_PRONY {
            return Err(format!("expected at most {MAX_PRONY} Prony terms, found {}", terms.len()));
        }
        let positive = |value: f64| value > 0.0 && value.is_finite();
        match terms.iter().find(|term| !positive(term.ratio) || !positive(term.time_s)) {
            Some(PronyTerm { ratio, time_s }) => {
                Err(format!("expected Prony ratios and times above 0, found {ratio} and {time_s} s"))
            }
            None => Ok(()),
        }
    }

    /// Factors `e`, `a` of `h_1 = e h_0 + a (u_1 - u_0)` for a quantity `u` that is straight within a step.
    pub fn within(&self, step_s: f64) -> (f64, f64) {
        let x = step_s / self.time_s;
        let lost = -(-x).exp_m1();
        (1.0 - lost, if x > 0.0 { lost / x } else { 1.0 })
    }
}

/// Creep terms of the load filter of a series, by decreasing time.
///
/// # Errors
/// As [`PronyTerm::check`].
pub fn filter(terms: &[PronyTerm]) -> Result<Vec<Creep>, String> {
    PronyTerm::check(terms)?;
    let mut times: Vec<f64> = terms.iter().map(|term| term.time_s).collect();
    times.sort_by(|a, b| b.total_cmp(a));
    times.dedup();
    // Denominator at s = -x, which falls from 1 or infinity to minus infinity between two rates of the series.
    let at = |x: f64| 1.0 - terms.iter().map(|t| t.ratio * t.time_s * x / (1.0 - t.time_s * x)).sum::<f64>();
    let mut low = 0.0;
    let mut creeps = Vec::new();
    for time_s in times {
        let (mut from, mut to) = (low, 1.0 / time_s);
        low = to;
        for _ in 0..HALVINGS {
            let middle = 0.5 * (from + to);
            if at(middle) > 0.0 { from = middle } else { to = middle }
        }
        let x = 0.5 * (from + to);
        let slope: f64 = terms.iter().map(|t| t.ratio * t.time_s / (1.0 - t.time_s * x).powi(2)).sum();
        creeps.push(Creep { time_s: 1.0 / x, weight: 1.0 / (x * slope) });
    }
    Ok(creeps)
}
