//! Static map of the search, by least squares: polynomials of the inputs behind the memory, or terms of a model that is known.
//!
//! `y = c_0 + sum_i (a_i x_i + b_i x_i^2 + d_i x_i^3) + sum_(i<j) e_ij x_i x_j` with inputs scaled to [0, 1] and a small ridge on all
//! terms but the constant; or its linear part alone. To both comes a drift `f_r (t / T_r - 1/2)` of each run, and with several runs their shift
//! `g_r`: they belong to the run and not to the model.

use rom::dense::Dense;

/// Ridge per row.
const RIDGE: f64 = 1e-5;

/// A model of the outputs that is known but for weights: the terms of each output, the first of which is a constant.
pub trait ModelTerms {
    /// Terms of an output.
    fn count(&self) -> usize;

    /// Terms of all outputs at a row of the runs (run and row) and inputs behind the memory, appended; they are of the order of 1.
    fn push(&self, row: (usize, usize), inputs: &[f64], to: &mut Vec<f64>);
}

/// Terms of the map.
#[derive(Clone, Copy)]
pub(super) enum Terms<'a> {
    /// Constant and linear.
    Linear,
    /// Cubic in each input, and products of two.
    Cubic,
    /// Those of a model.
    Model(&'a dyn ModelTerms),
}

/// A row of the runs: its place, inputs behind the memory, and the same scaled to [0, 1].
pub(super) struct Point<'a> {
    pub row: (usize, usize),
    pub runs: usize,
    /// Fraction of the run that has passed.
    pub elapsed: f64,
    pub inputs: &'a [f64],
    pub scaled: &'a [f64],
}

impl Terms<'_> {
    pub(super) fn count(self, inputs: usize, runs: usize) -> usize {
        let of_runs = if runs > 1 { 2 * runs } else { 1 };
        match self {
            Self::Linear => 1 + inputs + of_runs,
            Self::Cubic => 1 + 3 * inputs + inputs * (inputs - 1) / 2 + of_runs,
            Self::Model(model) => model.count(),
        }
    }

    /// Terms of all outputs at a point, appended.
    pub(super) fn push(self, at: &Point<'_>, outputs: usize, to: &mut Vec<f64>) {
        if let Self::Model(model) = self {
            return model.push(at.row, at.inputs, to);
        }
        let begin = to.len();
        to.push(1.0);
        for (k, v) in at.scaled.iter().enumerate() {
            to.push(*v);
            if let Self::Cubic = self {
                to.extend([v * v, v * v * v]);
                to.extend(at.scaled.iter().take(k).map(|other| other * v));
            }
        }
        for run in 0..at.runs {
            let own = f64::from(u8::from(run == at.row.0));
            to.push(own * (at.elapsed - 0.5));
            to.extend(Some(own).filter(|_| at.runs > 1));
        }
        let end = to.len();
        (1..outputs).for_each(|_| to.extend_from_within(begin..end));
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

    /// Adds a row: the terms of output after output, and the outputs.
    pub(super) fn add(&mut self, terms: &[f64], outputs: impl Iterator<Item = f64>) {
        let rows = terms.chunks_exact(self.terms);
        for (((matrix, right, count), row), y) in self.parts.iter_mut().zip(rows).zip(outputs) {
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
