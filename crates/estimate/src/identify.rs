//! Identifiability of the unknowns.

use crate::matrix::{MAX_STATES, Symmetric, Vector};

/// Largest ratio of the standard deviation of an identifiable unknown to that without any reading.
pub(crate) const MAX_SIGMA_RATIO: f64 = 1.0 / 3.0;
/// An unknown is unidentifiable too if fixing the unidentifiable ones reduces its variance below this fraction.
const MIN_CONDITIONAL_VARIANCE: f64 = 0.5;

/// Identifiability per unknown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Identifiability {
    identifiable: [bool; MAX_STATES],
}

impl Identifiability {
    /// True if the readings identify the unknown.
    pub(crate) fn is_identifiable(&self, unknown: usize) -> bool {
        self.identifiable[unknown]
    }
}

/// Compares a covariance with the variances without any reading.
///
/// An unknown is identifiable if the readings reduce its standard deviation to a third, and if fixing the unidentifiable ones
/// would leave at least half of its variance. Example: the force of a finger on a plate identifies the gap if the gauge's bias is
/// known; otherwise it identifies their sum.
pub(crate) fn judge(covariance: &Symmetric, unread: &Vector) -> Identifiability {
    let count = covariance.size();
    let mut out = Identifiability::default();
    for (at, unread) in unread.iter().enumerate().take(count) {
        out.identifiable[at] = covariance.get(at, at) <= MAX_SIGMA_RATIO * MAX_SIGMA_RATIO * unread;
    }
    // Each iteration removes one unknown, so the loop ends.
    loop {
        let dependent = (0..count).find(|at| {
            out.identifiable[*at]
                && conditional_variance(covariance, *at, &out.identifiable) < MIN_CONDITIONAL_VARIANCE
        });
        match dependent {
            Some(at) => out.identifiable[at] = false,
            None => return out,
        }
    }
}

/// Variance of an unknown for fixed unidentifiable ones, as a fraction of its variance.
fn conditional_variance(covariance: &Symmetric, at: usize, identifiable: &[bool; MAX_STATES]) -> f64 {
    let unidentifiable = (0..covariance.size()).filter(|other| !identifiable[*other]);
    let mut others = [0; MAX_STATES];
    let mut count = 0;
    for other in unidentifiable {
        others[count] = other;
        count += 1;
    }
    // Correlations are independent of units.
    let mut block = Symmetric::diagonal(&[0.0; MAX_STATES][..count]);
    let mut with = [0.0; MAX_STATES];
    for i in 0..count {
        for j in 0..count {
            block.set(i, j, covariance.correlation(others[i], others[j]));
        }
        block.add_diagonal(i, 1e-9); // fully correlated unknowns have a singular block
        with[i] = covariance.correlation(at, others[i]);
    }
    let Some(factor) = block.cholesky() else { return 0.0 };
    let explained: f64 = with.iter().zip(factor.solve(&with)).map(|(a, b)| a * b).sum();
    1.0 - explained
}
