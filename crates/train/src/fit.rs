//! Fitting an interpolant: one symmetric indefinite system, honest about its condition, with leave-one-out for free.
//!
//! ```text
//! A [w; c] = [a; 0],   A = [[K + s I, P], [P^T, 0]]
//! ```
//! `K` kernel values between centres (`n x n`), `P` tail terms at the centres (`n x q`), `s` smoothing, `a` the data
//! (`n x outputs`). Leave-one-out residuals follow (Rippa) from the augmented inverse `C = A^-1`: `e_i = w_i / C_ii`.
//! The system is solved by Bunch-Kaufman; the relative residual is checked, the 2-norm condition number reported.
//!
//! Derivatives are further rows and columns: the kernel's derivatives between centres and the tail's. A state is left out
//! together with its derivatives, the rows `G`: `e_G = C_GG^-1 w_G`, of which the first is the value's residual.

use crate::config::{KernelKind, KernelSpec, Tail};
use faer::linalg::solvers::Solve;
use faer::{Mat, Side};
use rom::dense::Dense;
use rom::inputs::{Point, square_distance};
use rom::interpolant::{Curvature, Interpolant, Metric, Slope};
use std::cmp::Ordering;
use thiserror::Error;

/// Largest relative residual (backward error) a solution may have.
const MAX_RESIDUAL: f64 = 1e-9;

/// Why an interpolant could not be fitted.
#[derive(Clone, Debug, Error, PartialEq)]
#[allow(missing_docs)] // the messages say what the values are
pub enum FitError {
    /// No sample at all.
    #[error("no samples to interpolate; at least 1 is needed")]
    Empty,
    /// Two samples at the same inputs: the system is singular.
    #[error("samples {first} and {second} have the same inputs; merge them or smooth")]
    Coincident { first: usize, second: usize },
    /// The samples do not determine the tail (too few, or collinear).
    #[error("{samples} samples do not determine a {tail} over {dimensions} inputs (too few, or collinear)")]
    TailUndetermined { samples: usize, tail: &'static str, dimensions: usize },
    /// Without one sample the others do not determine the tail: its leave-one-out error is unknown.
    #[error(
        "sample {sample} of {samples} alone determines a term of the {tail} over {dimensions} inputs, so that its leave-one-out \
         error is unknown; add samples or take a lower tail"
    )]
    TailRestsOn { sample: usize, samples: usize, tail: &'static str, dimensions: usize },
    /// Derivatives were to be fitted with a kernel that has no second ones.
    #[error("{kernel} takes no derivatives: its second ones do not exist everywhere")]
    NoDerivatives { kernel: &'static str },
    /// The factorisation did not solve the system.
    #[error(
        "{kernel}: relative residual {residual:.1e}, expected at most {MAX_RESIDUAL:.0e} (condition {condition:.1e}); \
             choose another kernel or smooth"
    )]
    Residual { kernel: &'static str, residual: f64, condition: f64 },
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
    /// Number of values for each input.
    pub outputs: usize,
    /// Known derivatives, ordered by sample.
    pub slopes: &'a [Slope],
    /// `slopes x outputs`, by scaled input.
    pub slope_values: &'a [f64],
    /// A sample that is not smoothed: the interpolant passes through it whatever the smoothing.
    pub exact: Option<usize>,
}

/// A fitted interpolant and what leaving each sample out would have cost.
#[derive(Clone, Debug)]
pub struct Fit {
    /// The interpolant.
    pub interpolant: Interpolant,
    /// `samples x outputs` leave-one-out residuals: data minus prediction without the sample.
    pub residuals: Vec<f64>,
    /// `slopes x outputs`: the same for the derivatives, left out together with their sample.
    pub slope_residuals: Vec<f64>,
}

/// Condition number of the system an interpolant solved. Cost `O(n^3)`.
pub fn condition_of(interpolant: &Interpolant, exact: Option<usize>) -> f64 {
    condition(&matrix(&system_of(interpolant, exact)))
}

/// Fits one kernel. `metric` says how distances between inputs are taken; `smoothing` is relative to the largest absolute
/// kernel value. The condition number is left NaN: selection tries many candidates and reports only that of the chosen one
/// ([`condition_of`]). Cost `O((n + q)^3)`.
///
/// # Errors
/// [`FitError`] when the samples do not determine the interpolant or the solution fails its residual check.
pub fn fit(samples: &Samples, spec: KernelSpec, metric: Metric, smoothing: f64) -> Result<Fit, FitError> {
    let n = samples.inputs.len();
    if n == 0 {
        return Err(FitError::Empty);
    }
    let centres: Vec<Point> = samples.inputs.iter().map(|x| metric.apply(x)).collect();
    refuse_coincident(&centres, smoothing)?;
    refuse_undetermined(samples.dimensions, &centres, spec.tail)?;
    if !samples.slopes.is_empty() && !spec.kernel.takes_derivatives() {
        return Err(FitError::NoDerivatives { kernel: spec.kernel.name() });
    }
    let Samples { dimensions, slopes, exact, .. } = *samples;
    let points = Points { dimensions, centres: &centres, slopes, exact };
    let system = matrix(&assemble(points, spec.kernel, spec.tail, &metric, smoothing));
    let (size, terms) = (system.nrows(), n + samples.slopes.len());
    let rhs = Mat::from_fn(size, samples.outputs, |i, k| match i {
        i if i < n => samples.values[i * samples.outputs + k],
        i if i < terms => samples.slope_values[(i - n) * samples.outputs + k],
        _ => 0.0,
    });
    let factors = system.lblt(Side::Lower);
    let mut solution = factors.solve(&rhs);
    let correction = factors.solve(&rhs - &system * &solution);
    solution += correction; // one refinement step: residuals down to rounding even where the condition is high
    let residual = backward_error(&system, &solution, &rhs);
    let refused =
        || FitError::Residual { kernel: spec.kernel.name(), residual, condition: condition(&system) };
    if !residual.is_finite() || residual > MAX_RESIDUAL {
        return Err(refused());
    }
    let inverse = factors.solve(Mat::<f64>::identity(size, size));
    let rows = |range: std::ops::Range<usize>| -> Vec<f64> {
        range.flat_map(|i| (0..samples.outputs).map(move |k| (i, k))).map(|(i, k)| solution[(i, k)]).collect()
    };
    let weights = rows(0..terms);
    let inverse = Dense::from_fn(size, |i, j| inverse[(i, j)]);
    let (residuals, slope_residuals) =
        left_out(n, samples.outputs, samples.slopes, &weights, &inverse).ok_or_else(refused)?;
    let interpolant = Interpolant {
        kernel: spec.kernel,
        tail: spec.tail,
        dimensions: samples.dimensions,
        metric,
        tail_weights: rows(terms..size),
        weights,
        centres: centres.iter().flat_map(|c| &c[..samples.dimensions]).copied().collect(),
        outputs: samples.outputs,
        smoothing,
        condition: f64::NAN,
        residual,
        slopes: samples.slopes.to_vec(),
    };
    Ok(Fit { interpolant, residuals, slope_residuals })
}

/// Copy for the solver of large systems.
fn matrix(system: &Dense) -> Mat<f64> {
    Mat::from_fn(system.size(), system.size(), |i, j| system[(i, j)])
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

/// Smallest difference to 1 of a sample's leverage on the tail.
const LEAST_FREEDOM: f64 = 1e-8;

/// The tail must have full column rank over the centres, or the saddle system is singular; and over the centres without any one of
/// them, or that one's leave-one-out error divides 0 by 0. Removing a centre lowers the rank where its leverage, the diagonal
/// element of `U U^T` in `P = U S V^T`, is 1.
fn refuse_undetermined(dimensions: usize, centres: &[Point], tail: Tail) -> Result<(), FitError> {
    let (q, samples) = (tail.terms(dimensions), centres.len());
    if q == 0 {
        return Ok(());
    }
    let undetermined = || FitError::TailUndetermined { samples, tail: tail.name(), dimensions };
    if samples < q {
        return Err(undetermined());
    }
    let terms: Vec<Vec<f64>> = centres.iter().map(|c| tail.values(dimensions, c)).collect();
    let svd = Mat::from_fn(samples, q, |i, j| terms[i][j]).thin_svd().map_err(|_| undetermined())?;
    let s = svd.S().column_vector();
    if s[q - 1] <= 1e-8 * s[0] {
        return Err(undetermined());
    }
    let leverage = |i: usize| (0..q).map(|j| svd.U()[(i, j)].powi(2)).sum::<f64>();
    match (0..samples).find(|i| 1.0 - leverage(*i) < LEAST_FREEDOM) {
        Some(sample) => Err(FitError::TailRestsOn { sample, samples, tail: tail.name(), dimensions }),
        None => Ok(()),
    }
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

/// Data of a system: centres (`M x`) and derivatives at them.
#[derive(Clone, Copy, Debug)]
struct Points<'a> {
    /// Inputs in use.
    dimensions: usize,
    centres: &'a [Point],
    /// Derivatives, ordered by centre.
    slopes: &'a [Slope],
    /// Centre that is not smoothed.
    exact: Option<usize>,
}

/// The system that an interpolant solved.
fn system_of(interpolant: &Interpolant, exact: Option<usize>) -> Dense {
    let centre = |row: &[f64]| std::array::from_fn(|i| row.get(i).copied().unwrap_or(0.0));
    let centres: Vec<Point> = interpolant.centres.chunks_exact(interpolant.dimensions).map(centre).collect();
    let points =
        Points { dimensions: interpolant.dimensions, centres: &centres, slopes: &interpolant.slopes, exact };
    assemble(points, interpolant.kernel, interpolant.tail, &interpolant.metric, interpolant.smoothing)
}

/// Residuals of every sample left out with its derivatives: of the values, then of the derivatives. `weights` holds
/// `(n + slopes) x outputs` values, `inverse` belongs to the whole system.
fn left_out(
    n: usize,
    outputs: usize,
    slopes: &[Slope],
    weights: &[f64],
    inverse: &Dense,
) -> Option<(Vec<f64>, Vec<f64>)> {
    let mut residuals: Vec<f64> = (weights[..n * outputs].iter().enumerate())
        .map(|(j, w)| w / inverse[(j / outputs, j / outputs)])
        .collect();
    let mut of_slopes = vec![0.0; slopes.len() * outputs];
    for group in slopes.chunk_by(|a, b| a.centre == b.centre) {
        // The slopes are one slice, so the place of the group follows from where it begins in it.
        let first = slopes.partition_point(|slope| slope.centre < group[0].centre);
        let sample = group[0].centre as usize;
        let rows: Vec<usize> =
            std::iter::once(sample).chain((0..group.len()).map(|j| n + first + j)).collect();
        let block = Dense::from_fn(rows.len(), |i, j| inverse[(rows[i], rows[j])]);
        let mut error: Vec<f64> =
            rows.iter().flat_map(|row| &weights[row * outputs..][..outputs]).copied().collect();
        block.solve(&mut error, outputs)?;
        for k in 0..outputs {
            residuals[sample * outputs + k] = error[k];
            for j in 0..group.len() {
                of_slopes[(first + j) * outputs + k] = error[(1 + j) * outputs + k];
            }
        }
    }
    Some((residuals, of_slopes))
}

/// Least smoothing of a Gaussian, and of a Matern 7/2.
const GAUSSIAN_FLOOR: f64 = 1e-14;
const MATERN_FLOOR: f64 = 1e-10;

/// The system of these points, `(n + slopes + q)` squared. `smoothing` is relative to the largest absolute kernel value.
fn assemble(points: Points, kernel: KernelKind, tail: Tail, metric: &Metric, smoothing: f64) -> Dense {
    let Points { dimensions, centres, slopes, exact } = points;
    let (n, m, q) = (centres.len(), slopes.len(), tail.terms(dimensions));
    let mut a = Dense::zeros(n + m + q);
    let mut largest = 0.0_f64;
    for j in 0..n {
        for i in j..n {
            let g = kernel.value(square_distance(&centres[i], &centres[j]));
            a[(i, j)] = g;
            a[(j, i)] = g;
            largest = largest.max(g.abs());
        }
        for (k, t) in tail.values(dimensions, &centres[j]).into_iter().enumerate() {
            a[(n + m + k, j)] = t;
            a[(j, n + m + k)] = t;
        }
    }
    // Functions that are wide for their distances are linearly dependent to rounding, and a system without a ridge then magnifies the
    // errors of the states: with a Gaussian on one of the hard cases from 0.02 to 1.5 %, with a Matern 7/2 on the reference finger
    // from 0.020 to 0.030 %. States are missed by 0.001 % for it.
    let floor = match kernel {
        KernelKind::Gaussian { .. } => GAUSSIAN_FLOOR,
        KernelKind::Matern72 { .. } => MATERN_FLOOR,
        _ => 0.0,
    };
    let smoothing = smoothing.max(floor);
    for i in (0..n).filter(|i| exact != Some(*i)) {
        a[(i, i)] += smoothing * largest;
    }
    assemble_slopes(&mut a, points, kernel, tail, metric);
    let largest = (n..n + m).map(|i| a[(i, i)].abs()).fold(0.0, f64::max);
    for i in n..n + m {
        a[(i, i)] += smoothing * largest;
    }
    a
}

/// Rows and columns of the derivatives.
fn assemble_slopes(a: &mut Dense, points: Points, kernel: KernelKind, tail: Tail, metric: &Metric) {
    let Points { dimensions, centres, slopes, .. } = points;
    let (n, m) = (centres.len(), slopes.len());
    for (b, slope) in slopes.iter().enumerate() {
        let (own, axis) = (&centres[slope.centre as usize], slope.axis as usize);
        let from = |other: &Point| -> Point { std::array::from_fn(|i| other[i] - own[i]) };
        for (i, centre) in centres.iter().enumerate() {
            let value = Curvature::at(kernel, metric, &from(centre)).row(axis).0;
            a[(i, n + b)] = value;
            a[(n + b, i)] = value;
        }
        for (c, other) in slopes.iter().enumerate().take(b + 1) {
            let curvature = Curvature::at(kernel, metric, &from(&centres[other.centre as usize]));
            let value = curvature.row(axis).1[other.axis as usize];
            a[(n + c, n + b)] = value;
            a[(n + b, n + c)] = value;
        }
        let mut term = 0;
        tail.each_term(dimensions, own, |_, slopes| {
            let value = metric.pull_back(slopes)[axis];
            a[(n + m + term, n + b)] = value;
            a[(n + b, n + m + term)] = value;
            term += 1;
        });
    }
}
