//! Measured difference of the fields from the finite elements, in the coefficients of some modes, smooth over the inputs.
//!
//! ```text
//! a_j(x) += sum_k w_kj g(|x - c_k|)      g(d) = (1 - d/R)^4 (4 d/R + 1) below R, 0 beyond (Wendland, twice differentiable)
//! share(x) = max_k g(|x - c_k|)          1 at a measured state, 0 farther than R from all of them; x scaled as in the regime
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
    /// Distance `R` over scaled inputs from which on the difference is 0.
    pub reach: f64,
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
pub fn terms<'a>(centres: &'a [Point], reach: f64, x: &'a Point) -> impl Iterator<Item = f64> + 'a {
    with_slopes(centres, reach, x).map(|(g, _)| g)
}

/// Values `g` and `s` of the centres, with the gradient `dg/dx = s (c - x)`.
pub(crate) fn with_slopes<'a>(
    centres: &'a [Point],
    reach: f64,
    x: &'a Point,
) -> impl Iterator<Item = (f64, f64)> + 'a {
    centres.iter().map(move |c| {
        let d = square_distance(c, x).sqrt() / reach;
        let cube = (1.0 - d).max(0.0).powi(3);
        (cube * (1.0 - d) * (4.0 * d + 1.0), 20.0 * cube / (reach * reach))
    })
}

impl FieldDifference {
    /// True if the numbers can be evaluated in a regime with this number of coefficients.
    pub(crate) fn is_sound(&self, coefficients: usize) -> bool {
        let numbers = self.centres.as_flattened().iter().chain(&self.weights);
        let finite = numbers.chain([&self.residual_mm, &self.difference_mm]).all(|v| v.is_finite());
        finite
            && self.reach > 0.0
            && self.weights.len() == self.centres.len() * self.coefficients.len()
            && self.coefficients.iter().all(|at| *at < coefficients)
    }

    /// Largest `g` at scaled inputs.
    pub fn share(&self, x: &Point) -> f64 {
        terms(&self.centres, self.reach, x).fold(0.0, f64::max)
    }

    /// `m` at scaled inputs.
    pub(crate) fn half_width_mm(&self, x: &Point) -> f64 {
        let share = self.share(x);
        share * self.residual_mm + (1.0 - share) * self.difference_mm
    }

    /// Adds the difference to coefficients, and its derivatives with respect to scaled inputs to rows that are not empty. Allocates nothing.
    pub fn add(&self, x: &Point, coefficients: &mut [f64], rows: &mut [Vec<f64>; MAX_INPUTS]) {
        let weights = self.weights.chunks_exact(self.coefficients.len().max(1));
        let all = with_slopes(&self.centres, self.reach, x).zip(&self.centres).zip(weights);
        for (((g, slope), centre), weights) in all {
            for (index, w) in self.coefficients.iter().zip(weights) {
                coefficients[*index] += g * w;
                for (axis, row) in rows.iter_mut().enumerate().filter(|(_, row)| !row.is_empty()) {
                    row[*index] += slope * w * (centre[axis] - x[axis]);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn difference_and_its_derivative_end_without_a_jump_at_the_reach_and_are_exactly_zero_beyond() {
        let point = |v: f64| -> Point { std::array::from_fn(|axis| if axis == 0 { v } else { 0.0 }) };
        let difference = FieldDifference {
            reach: 0.3,
            centres: vec![point(0.1), point(0.4)],
            coefficients: vec![1],
            weights: vec![2.0, -0.7],
            residual_mm: 0.1,
            difference_mm: 1.0,
        };
        let found = |x: f64| {
            let (mut coefficients, mut rows) = ([0.0; 2], <[Vec<f64>; MAX_INPUTS]>::default());
            rows[0] = vec![0.0; 2];
            difference.add(&point(x), &mut coefficients, &mut rows);
            assert_eq!((coefficients[0], rows[0][0]), (0.0, 0.0));
            (coefficients[1], rows[0][1])
        };
        for x in [-0.15, 0.1, 0.25, 0.399, 0.41, 0.65] {
            let by = (found(x + 1e-6).0 - found(x - 1e-6).0) / 2e-6;
            assert!((found(x).1 - by).abs() < 1e-6, "{x}: {} {by}", found(x).1);
        }
        let (value, slope) = found(0.6999);
        assert!(value.abs() < 1e-10 && slope.abs() < 1e-7 && value != 0.0, "{value} {slope}");
        for x in [-0.201, 0.701, 2.0] {
            assert_eq!(found(x), (0.0, 0.0), "{x}");
            assert_eq!((difference.share(&point(x)), difference.half_width_mm(&point(x))), (0.0, 1.0));
        }
    }
}
