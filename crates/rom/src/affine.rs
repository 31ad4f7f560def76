//! A coordinate of a point as an affine function of the modal coefficients (Eq. 6 of the paper).

use serde::{Deserialize, Serialize};

/// `mean + sum_k weights_k c_(first + k)`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Affine {
    pub(crate) mean: f64,
    pub(crate) first: usize,
    pub(crate) weights: Vec<f64>,
}

impl Affine {
    /// The value at these coefficients.
    pub(crate) fn value(&self, coefficients: &[f64]) -> f64 {
        self.mean + self.change(coefficients)
    }

    /// How far these coefficients move it from its mean.
    pub(crate) fn change(&self, coefficients: &[f64]) -> f64 {
        let own = coefficients.get(self.first..).unwrap_or(&[]);
        self.weights.iter().zip(own).map(|(weight, a)| weight * a).sum()
    }
}
