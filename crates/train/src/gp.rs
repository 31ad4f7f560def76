//! Lengths of a Gaussian process by maximum likelihood.
//!
//! Matern 5/2 with one length a dimension, a nugget and a polynomial trend; all outputs share the correlation and one
//! process variance, so that the energetic modes decide. The concentrated negative log likelihood
//!
//! ```text
//! L(lengths, nugget) = n q ln s^2 + q ln |R|,   s^2 = tr((A - T b)^T R^-1 (A - T b)) / (n q)
//! ```
//! (`R` correlation plus nugget `n x n`, `A` data `n x q`, `T b` generalised least-squares trend) is minimised by
//! Nelder-Mead over logarithms. Prediction is then the saddle-point interpolant of `fit.rs`: the universal-kriging mean.

use crate::config::{KernelKind, Tail};
use crate::fit::Samples;
use faer::linalg::solvers::Solve;
use faer::{Mat, Side};
use rom::inputs::Point;
use rom::interpolant::Metric;

/// Samples the likelihood looks at: beyond this, an even subset fixes the lengths.
const MAX_LIKELIHOOD_SAMPLES: usize = 250;
/// Outputs the likelihood looks at, largest modes first: with one process variance the rest carry no weight.
const LIKELIHOOD_OUTPUTS: usize = 8;
/// Evaluations of the likelihood over one or two inputs; half as many more for every other one.
const EVALUATIONS: usize = 160;
/// Bounds of the logarithms: lengths over scaled inputs, then the nugget.
const LN_LENGTH: [f64; 2] = [-3.0, 3.0];
const LN_NUGGET: [f64; 2] = [-25.0, -4.0];

/// What maximum likelihood found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lengths {
    /// Factors 1 / length over scaled inputs.
    pub metric: Metric,
    /// Nugget relative to the process variance.
    pub nugget: f64,
    /// Concentrated negative log likelihood there.
    pub neg_log_likelihood: f64,
}

/// Maximum-likelihood lengths and nugget. Cost `O(200 n^3 / 3)`, n at most 250.
pub fn maximum_likelihood(samples: &Samples, tail: Tail) -> Option<Lengths> {
    let n = samples.inputs.len();
    let stride = n.div_ceil(MAX_LIKELIHOOD_SAMPLES).max(1);
    let chosen: Vec<usize> = (0..n).step_by(stride).collect();
    let outputs = samples.outputs.min(LIKELIHOOD_OUTPUTS);
    let data = Mat::from_fn(chosen.len(), outputs, |i, k| samples.values[chosen[i] * samples.outputs + k]);
    let inputs: Vec<Point> = chosen.iter().map(|&i| samples.inputs[i]).collect();
    let d = samples.dimensions;
    let objective = |theta: &[f64]| likelihood(&inputs, d, &data, tail, theta);
    let start: Vec<f64> = std::iter::repeat_n(0.0, d).chain([-16.0]).collect();
    let evaluations = EVALUATIONS + EVALUATIONS / 2 * d.saturating_sub(2);
    let (theta, value) = nelder_mead(objective, &start, evaluations);
    value.is_finite().then(|| Lengths {
        metric: metric_of(&theta[..d]),
        nugget: theta[d].exp(),
        neg_log_likelihood: value,
    })
}

/// Lengths from their logarithms.
fn metric_of(theta: &[f64]) -> Metric {
    let mut metric = Metric::IDENTITY;
    metric.scale.iter_mut().zip(theta).for_each(|(s, t)| *s = (-t).exp());
    metric
}

fn likelihood(inputs: &[Point], d: usize, data: &Mat<f64>, tail: Tail, theta: &[f64]) -> f64 {
    let within = |v: f64, b: [f64; 2]| (b[0]..=b[1]).contains(&v);
    if !theta[..d].iter().all(|t| within(*t, LN_LENGTH)) || !within(theta[d], LN_NUGGET) {
        return f64::INFINITY;
    }
    let scale = metric_of(&theta[..d]).scale;
    let (n, q) = (inputs.len(), data.ncols());
    let mut r = Mat::zeros(n, n); // the lower half is all a Cholesky factorisation reads
    for j in 0..n {
        for i in j..n {
            let along = |k: usize| (inputs[i][k] - inputs[j][k]) * scale[k];
            let square = (0..d).map(|k| along(k) * along(k)).sum();
            r[(i, j)] = KernelKind::Matern52.value(square);
        }
        r[(j, j)] += theta[d].exp();
    }
    let Ok(llt) = r.llt(Side::Lower) else { return f64::INFINITY };
    let ln_det: f64 = 2.0 * (0..n).map(|i| llt.L()[(i, i)].ln()).sum::<f64>();
    let terms: Vec<Vec<f64>> = inputs.iter().map(|x| tail.values(d, x)).collect();
    let p = Mat::from_fn(n, tail.terms(d), |i, j| terms[i][j]);
    let trend = if p.ncols() > 0 {
        let (rp, ra) = (llt.solve(&p), llt.solve(data));
        let normal = p.transpose() * &rp;
        let Ok(normal) = normal.llt(Side::Lower) else { return f64::INFINITY };
        &p * normal.solve(p.transpose() * ra)
    } else {
        Mat::zeros(n, q)
    };
    let rest = data - trend;
    let solved = llt.solve(&rest);
    let square: f64 = (0..q).map(|k| rest.col(k).transpose() * solved.col(k)).sum();
    let variance = square / (n * q) as f64;
    if variance > 0.0 { (n * q) as f64 * variance.ln() + q as f64 * ln_det } else { f64::INFINITY }
}

/// Nelder-Mead with standard coefficients: derivative-free, enough for a few parameters.
fn nelder_mead(f: impl Fn(&[f64]) -> f64, start: &[f64], evaluations: usize) -> (Vec<f64>, f64) {
    let n = start.len();
    let mut simplex: Vec<(Vec<f64>, f64)> = vec![(start.to_vec(), f(start))];
    for i in 0..n {
        let mut x = start.to_vec();
        x[i] += 1.0;
        let v = f(&x);
        simplex.push((x, v));
    }
    let mut used = n + 1;
    while used < evaluations {
        simplex.sort_by(|a, b| a.1.total_cmp(&b.1));
        if (simplex[n].1 - simplex[0].1).abs() < 1e-3 {
            break;
        }
        let centroid: Vec<f64> =
            (0..n).map(|i| simplex[..n].iter().map(|s| s.0[i]).sum::<f64>() / n as f64).collect();
        let along = |t: f64| -> (Vec<f64>, f64) {
            let x: Vec<f64> = centroid.iter().zip(&simplex[n].0).map(|(c, w)| c + t * (w - c)).collect();
            let v = f(&x);
            (x, v)
        };
        let reflected = along(-1.0);
        used += 1;
        let candidate = if reflected.1 < simplex[0].1 {
            used += 1;
            let expanded = along(-2.0);
            if expanded.1 < reflected.1 { expanded } else { reflected }
        } else if reflected.1 < simplex[n - 1].1 {
            reflected
        } else {
            used += 1;
            along(if reflected.1 < simplex[n].1 { -0.5 } else { 0.5 })
        };
        if candidate.1 < simplex[n].1 {
            simplex[n] = candidate;
        } else {
            used += n;
            shrink(&mut simplex, &f);
        }
    }
    simplex.sort_by(|a, b| a.1.total_cmp(&b.1));
    simplex.swap_remove(0)
}

fn shrink(simplex: &mut [(Vec<f64>, f64)], f: impl Fn(&[f64]) -> f64) {
    let best = simplex[0].0.clone();
    for (x, v) in simplex.iter_mut().skip(1) {
        for (x, b) in x.iter_mut().zip(&best) {
            *x = b + 0.5 * (*x - b);
        }
        *v = f(x);
    }
}
