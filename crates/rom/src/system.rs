//! The linear system that an interpolant solves, and what leaving a sample out would cost, in closed form.
//!
//! ```text
//! A [w; c] = [a; 0],   A = [[K + s I, P], [P^T, 0]]
//! ```
//! `K` kernel values between centres (`n x n`), `P` tail terms at the centres (`n x q`), `s` smoothing, `a` the data
//! (`n x outputs`). Leave-one-out residuals follow (Rippa) from the augmented inverse `C = A^-1`: `e_i = w_i / C_ii`.
//!
//! Derivatives are further rows and columns: the kernel's derivatives between centres and the tail's. A state is left out
//! together with its derivatives, the rows `G`: `e_G = C_GG^-1 w_G`, of which the first is the value's residual.

use crate::dense::Dense;
use crate::inputs::{Point, square_distance};
use crate::interpolant::{Curvature, Interpolant, Metric, Slope};
use crate::radial::{KernelKind, Tail};

/// What a system is made of: centres (`M x`) and derivatives at them.
#[derive(Clone, Copy, Debug)]
pub struct Points<'a> {
    /// Inputs in use.
    pub dimensions: usize,
    /// Centres.
    pub centres: &'a [Point],
    /// Derivatives, ordered by centre.
    pub slopes: &'a [Slope],
}

/// The system that an interpolant solved.
pub fn system_of(interpolant: &Interpolant) -> Dense {
    let centre = |row: &[f64]| std::array::from_fn(|i| row.get(i).copied().unwrap_or(0.0));
    let centres: Vec<Point> = interpolant.centres.chunks_exact(interpolant.dimensions).map(centre).collect();
    let points =
        Points { dimensions: interpolant.dimensions, centres: &centres, slopes: &interpolant.slopes };
    assemble(points, interpolant.kernel, interpolant.tail, &interpolant.metric, interpolant.smoothing)
}

/// Leave-one-out residuals of interpolants that share their kernel, each `samples x outputs`; none where the system is singular.
/// Cost `O(n^3)` once.
pub(crate) fn left_out_of(interpolants: &[&Interpolant]) -> Option<Vec<Vec<f64>>> {
    let Some(first) = interpolants.first() else { return Some(Vec::new()) };
    let inverse = system_of(first).inverse()?;
    let residuals = |fit: &&Interpolant| {
        Some(left_out(fit.centre_count(), fit.outputs, &fit.slopes, &fit.weights, &inverse)?.0)
    };
    interpolants.iter().map(residuals).collect()
}

/// Residuals of every sample left out with its derivatives: of the values, then of the derivatives. `weights` holds
/// `(n + slopes) x outputs` values, `inverse` belongs to the whole system.
pub fn left_out(
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

/// The system of these points, `(n + slopes + q)` squared. `smoothing` is relative to the largest absolute kernel value.
pub fn assemble(points: Points, kernel: KernelKind, tail: Tail, metric: &Metric, smoothing: f64) -> Dense {
    let Points { dimensions, centres, slopes } = points;
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
    let ridge = smoothing * largest;
    for i in 0..n {
        a[(i, i)] += ridge;
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
    let Points { dimensions, centres, slopes } = points;
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
