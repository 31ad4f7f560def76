//! Static map of the search: polynomials of the inputs behind the memory, by least squares.
//!
//! `y = c_0 + sum_i (a_i x_i + b_i x_i^2 + d_i x_i^3) + sum_(i<j) e_ij x_i x_j` with inputs scaled to [0, 1] and a small ridge on all
//! terms but the constant; or its linear part alone.

use rom::dense::Dense;

/// Ridge per row.
const RIDGE: f64 = 1e-5;

/// Terms of the map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Terms {
    /// Constant and linear.
    Linear,
    /// Cubic in each input, and products of two.
    Cubic,
}

impl Terms {
    pub(super) fn count(self, inputs: usize) -> usize {
        match self {
            Self::Linear => 1 + inputs,
            Self::Cubic => 1 + 3 * inputs + inputs * (inputs - 1) / 2,
        }
    }

    /// Terms at a point, appended.
    pub(super) fn push(self, x: impl Iterator<Item = f64> + Clone, to: &mut Vec<f64>) {
        to.push(1.0);
        match self {
            Self::Linear => to.extend(x),
            Self::Cubic => {
                for (at, v) in x.clone().enumerate() {
                    to.extend([v, v * v, v * v * v]);
                    to.extend(x.clone().take(at).map(|other| other * v));
                }
            }
        }
    }
}

/// Normal equations of rows of terms and their outputs; outputs that are NaN are left out of theirs.
#[derive(Clone, Debug)]
pub(super) struct Normal {
    terms: usize,
    outputs: usize,
    /// Matrix, right side and number of rows of each output: each may miss other rows.
    parts: Vec<(Vec<f64>, Vec<f64>, f64)>,
}

impl Normal {
    pub(super) fn new(terms: usize, outputs: usize) -> Self {
        Self { terms, outputs, parts: vec![(vec![0.0; terms * terms], vec![0.0; terms], 0.0); outputs] }
    }

    pub(super) fn add(&mut self, row: &[f64], outputs: impl Iterator<Item = f64>) {
        for ((matrix, right, count), y) in self.parts.iter_mut().zip(outputs) {
            if y.is_finite() {
                *count += 1.0;
                for (i, v) in row.iter().enumerate() {
                    right[i] += v * y;
                    // The lower triangle.
                    matrix[i * self.terms..=i * self.terms + i]
                        .iter_mut()
                        .zip(row)
                        .for_each(|(sum, w)| *sum += v * w);
                }
            }
        }
    }

    /// Weights, output after output; `None` where there is no finite solution.
    pub(super) fn solve(&self) -> Option<Vec<f64>> {
        let mut weights = Vec::with_capacity(self.terms * self.outputs);
        for (matrix, right, count) in &self.parts {
            let entry = |i: usize, j: usize| {
                let (high, low) = (i.max(j), i.min(j));
                let ridge = if i == j && i > 0 { RIDGE * count } else { 0.0 };
                matrix[high * self.terms + low] + ridge
            };
            let mut solution = right.clone();
            Dense::from_fn(self.terms, entry).solve(&mut solution, 1)?;
            weights.extend(solution);
        }
        weights.iter().all(|w| w.is_finite()).then_some(weights)
    }
}
