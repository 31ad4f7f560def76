//! Measured difference of the fields from the finite elements, in the coefficients of some modes, smooth over the inputs.
//!
//! ```text
//! a_j(x) += sum_k w_kj g(|x - c_k|)      g(d) = exp(-d^2 / 2 l^2), x scaled as in the regime
//! share(x) = max_k g(|x - c_k|)          1 at a measured state, 0 far from all of them
//! m(x)     = share q + (1 - share) d     displacement's half-width: sqrt(h^2 + m^2)
//! ```
//!
//! `q` is the half-width of the errors on parts of the recordings that were left out, `d` that of the difference itself, `h` the model's.
//! Onset and force remain those of the finite elements.

use crate::inputs::{MAX_INPUTS, Point, square_distance};
use serde::{Deserialize, Serialize};

/// Difference of one regime.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FieldDifference {
    /// Length `l` over scaled inputs.
    pub length: f64,
    /// Centres `c`.
    pub centres: Vec<Point>,
    /// Positions `j` of the coefficients in those of the regime.
    pub coefficients: Vec<usize>,
    /// Weights `w`: `centres x coefficients`, all of a centre together.
    pub weights: Vec<f64>,
    /// `q`, mm.
    pub residual_mm: f64,
    /// `d`, mm.
    pub difference_mm: f64,
}

/// Values `g` of the centres at scaled inputs.
pub fn terms<'a>(centres: &'a [Point], length: f64, x: &'a Point) -> impl Iterator<Item = f64> + 'a {
    centres.iter().map(move |c| (-0.5 * square_distance(c, x) / (length * length)).exp())
}

impl FieldDifference {
    /// True if the numbers can be evaluated in a regime with this number of coefficients.
    pub(crate) fn is_sound(&self, coefficients: usize) -> bool {
        let numbers = self.centres.as_flattened().iter().chain(&self.weights);
        let finite = numbers.chain([&self.residual_mm, &self.difference_mm]).all(|v| v.is_finite());
        finite
            && self.length > 0.0
            && self.weights.len() == self.centres.len() * self.coefficients.len()
            && self.coefficients.iter().all(|at| *at < coefficients)
    }

    /// Largest `g` at scaled inputs.
    pub fn share(&self, x: &Point) -> f64 {
        terms(&self.centres, self.length, x).fold(0.0, f64::max)
    }

    /// `m` at scaled inputs.
    pub(crate) fn half_width_mm(&self, x: &Point) -> f64 {
        let share = self.share(x);
        share * self.residual_mm + (1.0 - share) * self.difference_mm
    }

    /// Adds the difference to coefficients, and its derivatives with respect to scaled inputs to rows that are not empty. Allocates nothing.
    pub fn add(&self, x: &Point, coefficients: &mut [f64], rows: &mut [Vec<f64>; MAX_INPUTS]) {
        let weights = self.weights.chunks_exact(self.coefficients.len().max(1));
        let all = terms(&self.centres, self.length, x).zip(&self.centres).zip(weights);
        for ((g, centre), weights) in all {
            for (at, w) in self.coefficients.iter().zip(weights) {
                coefficients[*at] += g * w;
                for (axis, row) in rows.iter_mut().enumerate().filter(|(_, row)| !row.is_empty()) {
                    row[*at] += g * w * (centre[axis] - x[axis]) / (self.length * self.length);
                }
            }
        }
    }
}
