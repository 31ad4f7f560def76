//! The quadratic program of a plan: its unknowns are few, its rows dense.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver, NonnegativeConeT, SolverStatus};

/// `min z' H z / 2 + g' z` subject to `rows z <= bounds`.
#[derive(Debug)]
pub(crate) struct Program {
    size: usize,
    /// Column by column.
    pub(crate) hessian: Vec<f64>,
    pub(crate) gradient: Vec<f64>,
    rows: Vec<f64>,
    bounds: Vec<f64>,
}

impl Program {
    pub(crate) fn new(size: usize) -> Self {
        let (hessian, gradient) = (vec![0.0; size * size], vec![0.0; size]);
        Self { size, hessian, gradient, rows: Vec::new(), bounds: Vec::new() }
    }

    /// Without terms and rows.
    pub(crate) fn clear(&mut self) {
        self.hessian.fill(0.0);
        self.gradient.fill(0.0);
        self.rows.clear();
        self.bounds.clear();
    }

    /// Adds half of the square of `residual + by z`.
    pub(crate) fn add_square(&mut self, by: &[f64], residual: f64) {
        for (column, of_column) in by.iter().enumerate().filter(|(_, value)| **value != 0.0) {
            self.gradient[column] += of_column * residual;
            for (row, of_row) in by.iter().enumerate() {
                self.hessian[column * self.size + row] += of_column * of_row;
            }
        }
    }

    /// Adds `row z <= bound`; rows with an infinite bound are left out.
    pub(crate) fn add_row(&mut self, bound: f64, row: impl Fn(usize) -> f64) {
        if bound < f64::INFINITY {
            self.rows.extend((0..self.size).map(row));
            self.bounds.push(bound);
        }
    }

    /// The optimum; `None` without one after `max_iterations`. Allocates.
    pub(crate) fn solve(&self, max_iterations: u32) -> Option<Vec<f64>> {
        let upper = |row: usize, column: usize| {
            if row <= column { self.hessian[column * self.size + row] } else { 0.0 }
        };
        let hessian = sparse(self.size, self.size, upper);
        let rows = sparse(self.bounds.len(), self.size, |row, column| self.rows[row * self.size + column]);
        let settings =
            DefaultSettings { verbose: false, max_iter: max_iterations, ..DefaultSettings::default() };
        let cones = [NonnegativeConeT(self.bounds.len())];
        let mut solver =
            DefaultSolver::new(&hessian, &self.gradient, &rows, &self.bounds, &cones, settings).ok()?;
        solver.solve();
        let is_solved = matches!(solver.solution.status, SolverStatus::Solved | SolverStatus::AlmostSolved);
        (is_solved && solver.solution.x.iter().all(|value| value.is_finite())).then_some(solver.solution.x)
    }
}

/// Entries other than 0, by columns.
fn sparse(rows: usize, columns: usize, value: impl Fn(usize, usize) -> f64) -> CscMatrix<f64> {
    let (mut starts, mut places, mut values) = (vec![0], Vec::new(), Vec::new());
    for column in 0..columns {
        for row in 0..rows {
            let entry = value(row, column);
            if entry != 0.0 {
                places.push(row);
                values.push(entry);
            }
        }
        starts.push(values.len());
    }
    CscMatrix::new(rows, columns, starts, places, values)
}
