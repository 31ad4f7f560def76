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

    /// How far these coefficients move it from its mean. Eight sums side by side: a single one would wait for each of its additions.
    pub(crate) fn change(&self, coefficients: &[f64]) -> f64 {
        let own = coefficients.get(self.first..).unwrap_or(&[]);
        let count = own.len().min(self.weights.len());
        let (weights, last_weights) = self.weights[..count].as_chunks::<8>();
        let (own, last_own) = own[..count].as_chunks::<8>();
        let mut sums = [0.0; 8];
        for (weights, own) in weights.iter().zip(own) {
            for k in 0..8 {
                sums[k] += weights[k] * own[k];
            }
        }
        let last: f64 = last_weights.iter().zip(last_own).map(|(weight, a)| weight * a).sum();
        sums.iter().sum::<f64>() + last
    }
}
