//! Choosing kernel, tail, metric, smoothing and modes by leave-one-out in closed form.
//!
//! With orthonormal modes the error of leaving case `i` out, at `l` modes, is
//! `e_i(l)^2 = sum_{k<l} E_ik^2 + sum_{k>=l} A_ik^2`: interpolation residuals (Rippa) of the kept modes plus the energy
//! of the dropped ones. The score is its root mean square over the cases inside the domain: leaving out a corner of the
//! domain measures extrapolation, which no kernel choice should be judged by. Test cases are never seen here.

use crate::config::{KernelKind, KernelSpec, ModeChoice, RegimeConfig};
use crate::fit::{Fit, FitError, Samples, condition_of, fit_candidate};
use crate::gp::maximum_likelihood;
use serde::{Deserialize, Serialize};

/// What was tried and how it fared.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Candidate {
    /// Kernel and tail in words.
    pub kernel: String,
    /// Factors on the scaled inputs.
    pub metric: [f64; 2],
    /// Smoothing on the diagonal.
    pub smoothing: f64,
    /// Modes it would keep.
    pub modes: usize,
    /// Leave-one-out score, in the data's own norm; none when the fit was refused.
    pub error: Option<f64>,
    /// Why the fit was refused.
    pub refused: Option<String>,
}

/// The winner and the others, best first.
#[derive(Clone, Debug)]
pub struct Choice {
    /// The fit of the first `modes` outputs.
    pub fit: Fit,
    /// Modes kept.
    pub modes: usize,
    /// All candidates, best first.
    pub candidates: Vec<Candidate>,
}

/// What selection judges by.
pub struct Task<'a> {
    /// Inputs and coefficients of all modes that may be kept.
    pub samples: Samples<'a>,
    /// Per sample: energy in the modes that cannot be kept.
    pub dropped: &'a [f64],
    /// Per sample: weight of its error in the score; 0 leaves it out of the score (not out of the fit).
    pub score: &'a [f64],
    /// How many modes.
    pub modes: ModeChoice,
    /// Modes the energy criterion asks for.
    pub modes_for_energy: usize,
}

/// Tries every candidate of `config` and keeps the best. Cost `O(candidates x n^3)`.
///
/// # Errors
/// The last refusal when no candidate could be fitted.
pub fn choose(task: &Task, config: &RegimeConfig) -> Result<Choice, FitError> {
    let mut best: Option<(f64, usize, Fit)> = None;
    let mut refusal = FitError::Empty;
    let mut candidates = Vec::new();
    for spec in &config.kernels {
        for (metric, smoothing) in variants(task, *spec, config) {
            let mut row = Candidate {
                kernel: format!("{}, {}", spec.kernel.name(), spec.tail.name()),
                metric,
                smoothing,
                modes: 0,
                error: None,
                refused: None,
            };
            match fit_candidate(&task.samples, *spec, metric, smoothing) {
                Ok(fit) => {
                    let (modes, error) = judge(task, &fit.residuals);
                    (row.modes, row.error) = (modes, Some(error));
                    if best.as_ref().is_none_or(|(e, ..)| error < *e) {
                        best = Some((error, modes, fit));
                    }
                }
                Err(e) => {
                    row.refused = Some(e.to_string());
                    refusal = e;
                }
            }
            candidates.push(row);
        }
    }
    candidates.sort_by(|a, b| a.error.unwrap_or(f64::INFINITY).total_cmp(&b.error.unwrap_or(f64::INFINITY)));
    let (_, modes, fit) = best.ok_or(refusal)?;
    let mut fit = keep_outputs(fit, modes);
    fit.interpolant.condition = condition_of(&fit.interpolant);
    Ok(Choice { fit, modes, candidates })
}

/// Metric and smoothing variants of a kernel: fitted lengths for a process, the configured factors otherwise.
fn variants(task: &Task, spec: KernelSpec, config: &RegimeConfig) -> Vec<([f64; 2], f64)> {
    if spec.kernel == KernelKind::Matern52 {
        return maximum_likelihood(&task.samples, spec.tail)
            .map(|l| (l.metric, l.nugget))
            .into_iter()
            .collect();
    }
    let factors = if task.samples.dimensions > 1 { config.anisotropy.as_slice() } else { &[1.0] };
    factors.iter().flat_map(|f| config.smoothing.iter().map(move |s| ([1.0, *f], *s))).collect()
}

/// Modes to keep and the score with them.
fn judge(task: &Task, residuals: &[f64]) -> (usize, f64) {
    let limit = task.samples.outputs;
    let errors: Vec<f64> = error_by_modes(task, residuals);
    let modes = match task.modes {
        ModeChoice::Fixed(modes) => modes.min(limit),
        ModeChoice::Energy(_) => task.modes_for_energy.min(limit),
        ModeChoice::LeaveOneOut(factor) => {
            let least = errors.iter().copied().fold(f64::INFINITY, f64::min);
            errors.iter().position(|e| *e <= factor * least).unwrap_or(limit)
        }
    };
    (modes, errors[modes])
}

/// Score for 0, 1, ... all modes.
fn error_by_modes(task: &Task, residuals: &[f64]) -> Vec<f64> {
    let outputs = task.samples.outputs;
    let total: f64 = task.score.iter().map(|w| w * w).sum();
    let mut squares = vec![0.0; outputs + 1];
    for (i, weight) in task.score.iter().enumerate().filter(|(_, w)| **w > 0.0) {
        let row = i * outputs..(i + 1) * outputs;
        let (data, residual) = (&task.samples.values[row.clone()], &residuals[row]);
        let mut square = task.dropped[i] + data.iter().map(|a| a * a).sum::<f64>();
        squares[0] += weight * weight * square;
        for k in 0..outputs {
            square += residual[k] * residual[k] - data[k] * data[k];
            squares[k + 1] += weight * weight * square.max(0.0);
        }
    }
    squares.iter().map(|s| (s / total).sqrt()).collect()
}

fn keep_outputs(mut fit: Fit, keep: usize) -> Fit {
    let outputs = fit.interpolant.outputs;
    let cut = |values: &[f64]| -> Vec<f64> {
        if outputs == 0 {
            Vec::new()
        } else {
            values.chunks_exact(outputs).flat_map(|row| row[..keep].to_vec()).collect()
        }
    };
    fit.interpolant.weights = cut(&fit.interpolant.weights);
    fit.interpolant.tail_weights = cut(&fit.interpolant.tail_weights);
    fit.residuals = cut(&fit.residuals);
    fit.interpolant.outputs = keep;
    fit
}
