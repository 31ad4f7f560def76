//! Factorised tangent with the rotation of the slots' normals: a sparse symmetric matrix plus a few columns.
//!
//! `K = K0 + U V^T` with the sparse `K0` of the assembly and two columns of `U` and `V` per touching slot. By the formula of
//! Sherman, Morrison and Woodbury `K^-1 r = x - W S^-1 V^T x` with `x = K0^-1 r`, `W = K0^-1 U` and `S = 1 + V^T W`: exact,
//! for one more solve per column.

use crate::algebra::Vec3;
use crate::krylov;
use crate::linear::CONSTRAINED;
use crate::linear::{Factor, LinearError};
use crate::problem::Problem;
use crate::system::System;
use faer::Mat;
use faer::linalg::solvers::{PartialPivLu, Solve};

/// Iterations with an older factor, after which a new one costs less.
const LINEAR_ITERATIONS: usize = 14;

/// Entries of a sparse column: unknown and value.
type Column = Vec<(usize, f64)>;

/// Workspace and factors of one thread.
pub(crate) struct Tangent {
    factor: Factor,
    unknowns: usize,
    /// `W`, one column behind the other.
    turned: Vec<f64>,
    /// Columns of `V`.
    turns: Vec<Column>,
    small: Option<PartialPivLu<f64>>,
    /// True if the determinant of `S` is negative.
    odd: bool,
}

impl Tangent {
    /// Allocates the factor.
    ///
    /// # Errors
    /// [`LinearError::Memory`].
    pub(crate) fn new(problem: &Problem) -> Result<Self, LinearError> {
        let factor = Factor::new(problem.analysis.clone())?;
        let unknowns = problem.pattern.unknowns();
        Ok(Self { factor, unknowns, turned: Vec::new(), turns: Vec::new(), small: None, odd: false })
    }

    /// Factorises the tangent that `system` assembled.
    pub(crate) fn factorise(&mut self, problem: &Problem, system: &System) -> Result<(), LinearError> {
        self.factor.factorise(&problem.pattern, &system.tangent)?;
        let pairs = || system.turning.iter().flat_map(|slot| [0, 1].map(|k| (slot, k)));
        let columns = 2 * system.turning.len();
        self.turns = pairs().map(|(slot, k)| column(problem, &slot.turn, k)).collect();
        self.turned.clear();
        self.turned.resize(columns * self.unknowns, 0.0);
        for ((slot, k), out) in pairs().zip(self.turned.chunks_exact_mut(self.unknowns)) {
            column(problem, &slot.force, k).into_iter().for_each(|(i, v)| out[i] += v);
        }
        (self.small, self.odd) = (None, false);
        if columns > 0 {
            self.factor.solve(&mut self.turned);
            let turned: Vec<&[f64]> = self.turned.chunks_exact(self.unknowns).collect();
            let unit = |i: usize, j: usize| if i == j { 1.0 } else { 0.0 };
            let small =
                Mat::from_fn(columns, columns, |i, j| unit(i, j) + product(&self.turns[i], turned[j]));
            self.odd = small.determinant() < 0.0;
            self.small = Some(small.partial_piv_lu());
        }
        Ok(())
    }

    /// Solves in place with the tangent that `system` assembled: to the relative residual `tolerance` with the last factor as
    /// preconditioner; without a tolerance, or if that takes too long, with a new factor. Returns true if it factorised.
    pub(crate) fn solve_assembled(
        &mut self,
        problem: &Problem,
        system: &System,
        side: &mut Vec<f64>,
        tolerance: Option<f64>,
    ) -> Result<bool, LinearError> {
        if let Some(tolerance) = tolerance {
            let apply = |v: &[f64]| {
                let mut out = problem.pattern.multiply(&system.tangent, v);
                add_turning(problem, system, v, &mut out);
                out
            };
            let limits = (tolerance, LINEAR_ITERATIONS);
            if let Some(solution) = krylov::solve(side, limits, apply, |v| self.solve(v)) {
                *side = solution;
                return Ok(false);
            }
        }
        self.factorise(problem, system)?;
        self.solve(side);
        Ok(true)
    }

    /// Solves in place for any number of right-hand sides, one behind the other.
    pub(crate) fn solve(&mut self, sides: &mut [f64]) {
        self.factor.solve(sides);
        let Some(small) = &self.small else { return };
        for x in sides.chunks_exact_mut(self.unknowns) {
            let turns = Mat::from_fn(self.turns.len(), 1, |i, _| product(&self.turns[i], x));
            let weights = small.solve(&turns);
            for (k, turned) in self.turned.chunks_exact(self.unknowns).enumerate() {
                x.iter_mut().zip(turned).for_each(|(x, w)| *x -= weights[(k, 0)] * w);
            }
        }
    }

    /// Number of negative eigenvalues. The sign of the determinant decides on the part of the slots' rotation, which changes the
    /// number by one at most.
    pub(crate) fn negative_eigenvalues(&self) -> usize {
        let sparse = self.factor.negative_pivots();
        match (sparse, self.odd) {
            (0, true) => 1,
            (_, true) => sparse - 1,
            _ => sparse,
        }
    }

    /// True if the sparse part was positive definite.
    pub(crate) fn positive_definite(&self) -> bool {
        self.factor.positive_definite()
    }
}

/// Adds the part of `K v` from the rotation of the slots' normals that `system` assembled.
fn add_turning(problem: &Problem, system: &System, v: &[f64], out: &mut [f64]) {
    for (slot, k) in system.turning.iter().flat_map(|slot| [0, 1].map(|k| (slot, k))) {
        let turn = product(&column(problem, &slot.turn, k), v);
        column(problem, &slot.force, k).into_iter().for_each(|(i, force)| out[i] += force * turn);
    }
}

fn product(column: &Column, x: &[f64]) -> f64 {
    column.iter().map(|(i, v)| v * x[*i]).sum()
}

fn column(problem: &Problem, entries: &[(u32, [Vec3; 2])], k: usize) -> Column {
    let free = entries.iter().map(|(n, both)| (problem.free[*n as usize], both[k]));
    let free = free.filter(|(block, _)| *block != CONSTRAINED);
    free.flat_map(|(block, v)| (0..3).map(move |c| (3 * block as usize + c, v[c]))).collect()
}
