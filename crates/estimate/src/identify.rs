//! Which unknowns the readings tell.

use crate::matrix::{MAX_STATES, Symmetric, Vector};

/// A standard deviation above this share of what it would be without any reading counts as not told.
const MAX_SHARE: f64 = 1.0 / 3.0;
/// When knowing an untold unknown would bring the variance of another below this share, that one is not told either.
const MIN_OWN_VARIANCE: f64 = 0.5;

/// By unknown, whether the readings tell it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Identifiability {
    told: [bool; MAX_STATES],
}

impl Identifiability {
    /// Whether the readings tell the unknown.
    pub(crate) fn tells(&self, unknown: usize) -> bool {
        self.told[unknown]
    }
}

/// Compares a covariance with the variances that the unknowns would have without any reading.
///
/// An unknown is told when its standard deviation fell to a third, and when that does not hang on another one that is not told:
/// its variance, conditional on the untold ones, is at least half of its own. (The force of a finger on a plate tells the
/// gap once the gauge's bias is known; with the bias unknown it tells their sum.)
pub(crate) fn judge(covariance: &Symmetric, unread: &Vector) -> Identifiability {
    let count = covariance.size();
    let mut out = Identifiability::default();
    for (at, unread) in unread.iter().enumerate().take(count) {
        out.told[at] = covariance.get(at, at) <= MAX_SHARE * MAX_SHARE * unread;
    }
    // Each round may only take away, so that it ends.
    loop {
        let hanging =
            (0..count).find(|at| out.told[*at] && own_share(covariance, *at, &out.told) < MIN_OWN_VARIANCE);
        match hanging {
            Some(at) => out.told[at] = false,
            None => return out,
        }
    }
}

/// Variance of an unknown if all untold ones were known, as a share of its variance.
fn own_share(covariance: &Symmetric, at: usize, told: &[bool; MAX_STATES]) -> f64 {
    let untold = (0..covariance.size()).filter(|other| !told[*other]);
    let mut others = [0; MAX_STATES];
    let mut count = 0;
    for other in untold {
        others[count] = other;
        count += 1;
    }
    // Scaled to correlations, so that no unit matters.
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
