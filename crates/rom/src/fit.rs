//! Fitting an interpolant: one symmetric indefinite system, honest about its condition, with leave-one-out for free.
//!
//! ```text
//! A [w; c] = [a; 0],   A = [[K + s I, P], [P^T, 0]]
//! ```
//! `K` kernel values between centres (`n x n`), `P` tail terms at the centres (`n x q`), `s` smoothing, `a` the data
//! (`n x outputs`). Solved by Bunch-Kaufman; the relative residual is checked, the 2-norm condition number reported.
//! Leave-one-out residuals follow in closed form (Rippa) from the augmented inverse `C = A^-1`: `e_i = w_i / C_ii`.

use crate::config::{KernelSpec, Tail};
use crate::inputs::{Point, square_distance};
use crate::interpolant::{Interpolant, Metric};
use faer::linalg::solvers::Solve;
use faer::{Mat, Side};
use std::cmp::Ordering;
use thiserror::Error;

/// Largest relative residual (backward error) a solution may have.
const MAX_RESIDUAL: f64 = 1e-9;

/// Why an interpolant could not be fitted.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum FitError {
    /// No sample at all.
    #[error("no samples to interpolate; at least 1 is needed")]
    Empty,
    /// Two samples at the same inputs: the system is singular.
    #[error("samples {first} and {second} have the same inputs; merge them or smooth")]
    Coincident {
        /// Index of the first.
        first: usize,
        /// Index of the second.
        second: usize,
    },
    /// The samples do not determine the tail (too few, or collinear).
    #[error("{samples} samples do not determine a {tail} over {dimensions} inputs (too few, or collinear)")]
    TailUndetermined {
        /// Samples.
        samples: usize,
        /// Tail asked for.
        tail: &'static str,
        /// Inputs.
        dimensions: usize,
    },
    /// The factorisation did not solve the system.
    #[error(
        "{kernel}: relative residual {residual:.1e}, expected at most {MAX_RESIDUAL:.0e} (condition {condition:.1e}); \
             choose another kernel or smooth"
    )]
    Residual {
        /// Kernel.
        kernel: &'static str,
        /// Residual found.
        residual: f64,
        /// Condition number.
        condition: f64,
    },
}

/// Samples to interpolate: scaled inputs and `inputs.len() x outputs` values.
#[derive(Clone, Debug)]
pub struct Samples<'a> {
    /// Inputs in use.
    pub dimensions: usize,
    /// Scaled inputs.
    pub inputs: &'a [Point],
    /// `samples x outputs`, all outputs of a sample together.
    pub values: &'a [f64],
    /// Outputs.
    pub outputs: usize,
}

/// A fitted interpolant and what leaving each sample out would have cost.
#[derive(Clone, Debug)]
pub struct Fit {
    /// The interpolant.
    pub interpolant: Interpolant,
    /// `samples x outputs` leave-one-out residuals: data minus prediction without the sample.
    pub residuals: Vec<f64>,
}

/// Condition number of the system an interpolant solved. Cost `O(n^3)`.
pub(crate) fn condition_of(interpolant: &Interpolant) -> f64 {
    let spec = KernelSpec { kernel: interpolant.kernel, tail: interpolant.tail };
    let centre = |row: &[f64]| std::array::from_fn(|i| row.get(i).copied().unwrap_or(0.0));
    let centres: Vec<Point> = interpolant.centres.chunks_exact(interpolant.dimensions).map(centre).collect();
    condition(&assemble(interpolant.dimensions, &centres, spec, interpolant.smoothing))
}

/// Fits one kernel. `metric` says how distances between inputs are taken; `smoothing` is relative to the largest absolute
/// kernel value. The condition number is left NaN: selection tries many candidates and reports only that of the chosen one
/// ([`condition_of`]). Cost `O((n + q)^3)`.
///
/// # Errors
/// [`FitError`] when the samples do not determine the interpolant or the solution fails its residual check.
pub(crate) fn fit(
    samples: &Samples,
    spec: KernelSpec,
    metric: Metric,
    smoothing: f64,
) -> Result<Fit, FitError> {
    let n = samples.inputs.len();
    if n == 0 {
        return Err(FitError::Empty);
    }
    let centres: Vec<Point> = samples.inputs.iter().map(|x| metric.apply(x)).collect();
    refuse_coincident(&centres, smoothing)?;
    refuse_undetermined(samples.dimensions, &centres, spec.tail)?;
    let system = assemble(samples.dimensions, &centres, spec, smoothing);
    let size = system.nrows();
    let rhs = Mat::from_fn(size, samples.outputs, |i, k| {
        if i < n { samples.values[i * samples.outputs + k] } else { 0.0 }
    });
    let factors = system.lblt(Side::Lower);
    let mut solution = factors.solve(&rhs);
    let correction = factors.solve(&rhs - &system * &solution);
    solution += correction; // one refinement step: residuals down to rounding even where the condition is high
    let residual = backward_error(&system, &solution, &rhs);
    if !residual.is_finite() || residual > MAX_RESIDUAL {
        return Err(FitError::Residual {
            kernel: spec.kernel.name(),
            residual,
            condition: condition(&system),
        });
    }
    let inverse = factors.solve(Mat::<f64>::identity(size, size));
    let rows = |range: std::ops::Range<usize>| -> Vec<f64> {
        range.flat_map(|i| (0..samples.outputs).map(move |k| (i, k))).map(|(i, k)| solution[(i, k)]).collect()
    };
    let weights = rows(0..n);
    let residuals = weights
        .iter()
        .enumerate()
        .map(|(j, w)| w / inverse[(j / samples.outputs, j / samples.outputs)])
        .collect();
    let interpolant = Interpolant {
        kernel: spec.kernel,
        tail: spec.tail,
        dimensions: samples.dimensions,
        metric,
        tail_weights: rows(n..size),
        weights,
        centres: centres.iter().flat_map(|c| &c[..samples.dimensions]).copied().collect(),
        outputs: samples.outputs,
        smoothing,
        condition: f64::NAN,
        residual,
        slopes: Vec::new(),
    };
    Ok(Fit { interpolant, residuals })
}

fn refuse_coincident(centres: &[Point], smoothing: f64) -> Result<(), FitError> {
    if smoothing > 0.0 {
        return Ok(());
    }
    let mut order: Vec<usize> = (0..centres.len()).collect();
    let compare = |a: &Point, b: &Point| {
        a.iter().zip(b).map(|(a, b)| a.total_cmp(b)).find(|o| o.is_ne()).unwrap_or(Ordering::Equal)
    };
    order.sort_by(|&a, &b| compare(&centres[a], &centres[b]));
    match order.windows(2).find(|w| centres[w[0]] == centres[w[1]]) {
        Some(w) => Err(FitError::Coincident { first: w[0].min(w[1]), second: w[0].max(w[1]) }),
        None => Ok(()),
    }
}

/// The tail must have full column rank over the centres, or the saddle system is singular.
fn refuse_undetermined(dimensions: usize, centres: &[Point], tail: Tail) -> Result<(), FitError> {
    let q = tail.terms(dimensions);
    if q == 0 {
        return Ok(());
    }
    let terms: Vec<Vec<f64>> = centres.iter().map(|c| tail.values(dimensions, c)).collect();
    let p = Mat::from_fn(centres.len(), q, |i, j| terms[i][j]);
    let determined = centres.len() >= q && p.singular_values().is_ok_and(|s| s[q - 1] > 1e-8 * s[0]);
    if determined {
        return Ok(());
    }
    Err(FitError::TailUndetermined { samples: centres.len(), tail: tail.name(), dimensions })
}

fn assemble(dimensions: usize, centres: &[Point], spec: KernelSpec, smoothing: f64) -> Mat<f64> {
    let (n, q) = (centres.len(), spec.tail.terms(dimensions));
    let mut a = Mat::zeros(n + q, n + q);
    let mut largest = 0.0_f64;
    for j in 0..n {
        for i in j..n {
            let g = spec.kernel.radial(square_distance(&centres[i], &centres[j])).0;
            a[(i, j)] = g;
            a[(j, i)] = g;
            largest = largest.max(g.abs());
        }
        for (k, t) in spec.tail.values(dimensions, &centres[j]).into_iter().enumerate() {
            a[(n + k, j)] = t;
            a[(j, n + k)] = t;
        }
    }
    let ridge = smoothing * largest;
    for i in 0..n {
        a[(i, i)] += ridge;
    }
    a
}

/// `max |A x - b| / (|A| |x| + |b|)`, in maximum norms.
fn backward_error(a: &Mat<f64>, x: &Mat<f64>, b: &Mat<f64>) -> f64 {
    let r = b - a * x;
    let scale = a.norm_max() * a.nrows() as f64 * x.norm_max() + b.norm_max();
    if scale > 0.0 { r.norm_max() / scale } else { r.norm_max() }
}

/// 2-norm condition number of a symmetric matrix, infinite when singular to rounding.
fn condition(a: &Mat<f64>) -> f64 {
    let Ok(eigenvalues) = a.self_adjoint_eigenvalues(Side::Lower) else { return f64::INFINITY };
    let (low, high) =
        eigenvalues.iter().fold((f64::INFINITY, 0.0_f64), |(l, h), e| (l.min(e.abs()), h.max(e.abs())));
    if low > 0.0 { high / low } else { f64::INFINITY }
}
