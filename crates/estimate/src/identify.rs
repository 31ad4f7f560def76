//! Which unknowns the readings identify, and the plan of an experiment that identifies them: a D-optimal choice of holds from the model's
//! gradients.
//!
//! A hold is `n` readings at one state. Its information about the unknowns is `n J^T (R + N M)^-1 J` with the sensors' noise `R` and
//! the model's error `M`. All `N` readings of the experiment share the model's error, as in the fit, and the noise of measured
//! inputs is eliminated. The chosen set of holds has the largest determinant of prior information plus the holds' information.

use crate::matrix::{MAX_STATES, Symmetric, Vector, eliminate};
use crate::reading::{Prior, ReadingProblem, Side};
use crate::setup::{Estimate, InputRole, MAX_INPUTS, MAX_ROWS, Measurement, Model, PASTS, Setup};

/// Largest ratio of the standard deviation of an identifiable unknown to that without any reading.
pub(crate) const MAX_SIGMA_RATIO: f64 = 1.0 / 3.0;
/// An unknown is unidentifiable too if fixing the unidentifiable ones reduces its variance below this fraction.
const MIN_CONDITIONAL_VARIANCE: f64 = 0.5;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Identifiability {
    identifiable: [bool; MAX_STATES],
}

impl Identifiability {
    /// True if the readings identify the unknown.
    pub(crate) fn is_identifiable(&self, unknown: usize) -> bool {
        self.identifiable[unknown]
    }
}

/// Compares a covariance with the variances without any reading.
///
/// An unknown is identifiable if the readings reduce its standard deviation to a third, and if fixing the unidentifiable ones
/// would leave at least half of its variance. Example: the force of a finger on a plate identifies the gap if the gauge's bias is
/// known; otherwise it identifies their sum.
pub(crate) fn judge(covariance: &Symmetric, unread: &Vector) -> Identifiability {
    let count = covariance.size();
    let mut out = Identifiability::default();
    for (index, unread) in unread.iter().enumerate().take(count) {
        out.identifiable[index] = covariance.get(index, index) <= MAX_SIGMA_RATIO * MAX_SIGMA_RATIO * unread;
    }
    // Each iteration removes one unknown, so the loop ends.
    loop {
        let dependent = (0..count).find(|at| {
            out.identifiable[*at]
                && conditional_variance(covariance, *at, &out.identifiable) < MIN_CONDITIONAL_VARIANCE
        });
        match dependent {
            Some(at) => out.identifiable[at] = false,
            None => return out,
        }
    }
}

/// Variance of an unknown for fixed unidentifiable ones, as a fraction of its variance.
fn conditional_variance(covariance: &Symmetric, unknown: usize, identifiable: &[bool; MAX_STATES]) -> f64 {
    let unidentifiable = (0..covariance.size()).filter(|other| !identifiable[*other]);
    let mut others = [0; MAX_STATES];
    let mut count = 0;
    for other in unidentifiable {
        others[count] = other;
        count += 1;
    }
    // Correlations are independent of units.
    let mut block = Symmetric::diagonal(&[0.0; MAX_STATES][..count]);
    let mut with = [0.0; MAX_STATES];
    for i in 0..count {
        for j in 0..count {
            block.set(i, j, covariance.correlation(others[i], others[j]));
        }
        block.add_diagonal(i, 1e-9); // fully correlated unknowns have a singular block
        with[i] = covariance.correlation(unknown, others[i]);
    }
    let Some(factor) = block.cholesky() else { return 0.0 };
    let explained: f64 = with.iter().zip(factor.solve(&with)).map(|(a, b)| a * b).sum();
    1.0 - explained
}

// ---- plan of an experiment ----

/// Predicted result of a fit to a set of holds.
#[derive(Clone, Debug, PartialEq)]
pub struct ExpectedFit {
    /// Predicted estimates: prior values with the standard deviations after the holds.
    pub estimates: Vec<Estimate>,
    /// Number of directions of the unknowns (in prior standard deviations) in which the holds have more information than the prior.
    pub rank: usize,
    /// Ratio of the largest to the smallest information over all directions; infinite if one has none.
    pub condition: f64,
    covariance: Symmetric,
}

impl ExpectedFit {
    /// Correlation of two unknowns' errors.
    pub fn correlation(&self, a: usize, b: usize) -> f64 {
        self.covariance.correlation(a, b)
    }
}

/// Information about the unknowns from `readings` readings at a state with these true inputs and the measured values of the bits
/// `blocks`. `sharing` readings of the whole experiment share the model's error; biases have their prior values. `None` if the
/// prediction is not finite.
pub fn information(
    setup: &Setup,
    inputs: &[f64; MAX_INPUTS],
    readings: usize,
    sharing: usize,
    blocks: u32,
    model: &mut impl Model,
) -> Option<Symmetric> {
    let (count, readings) = (setup.unknowns.len(), readings.max(1) as f64);
    let (mut noise, measured) = setup.noise_information();
    noise.iter_mut().for_each(|weight| *weight *= readings);
    let information = Symmetric::diagonal(&[0.0; MAX_STATES][..count]).extended(&noise[..measured]);
    let mut prior = Prior { states: [0.0; MAX_STATES], information };
    prior.states.iter_mut().zip(&setup.unknowns).for_each(|(x, unknown)| *x = unknown.prior);
    let mut measurement = Measurement::at(0.0);
    for (input, role) in setup.inputs.iter().enumerate() {
        match *role {
            InputRole::Given(_) => {}
            InputRole::Estimated(unknown) => prior.states[unknown] = inputs[input],
            InputRole::Measured { .. } => {
                measurement.inputs[input] = inputs[input] + role.offset([0.0; PASTS], &prior.states);
            }
        }
    }
    let mut weights = [0.0; MAX_ROWS];
    for (i, row) in setup.rows.iter().enumerate().filter(|(_, row)| blocks & (1 << row.block) != 0) {
        measurement.rows[i] = 0.0;
        weights[i] = readings / row.variance(sharing.max(1) as f64);
    }
    let problem =
        ReadingProblem { setup, measurement: &measurement, prior: &prior, side: Side::Any, weights };
    let linear = problem.linearise(&prior.states, model)?;
    let (matrix, right) = problem.equations(&prior.states, &linear, &weights);
    let mut out = Symmetric::diagonal(&[0.0; MAX_STATES][..count]);
    eliminate(&matrix, &right, count, &mut out, &mut [0.0; MAX_STATES])?;
    Some(out)
}

/// Positions, in order, of the `count` holds that have the largest determinant together with the priors. They are chosen one
/// after the other, then exchanged while the determinant grows; each is chosen at most once.
pub fn choose(setup: &Setup, holds: &[Symmetric], count: usize) -> Vec<usize> {
    let value = |chosen: &[usize]| {
        let matrix = sum(setup, holds, chosen);
        matrix.cholesky().map_or(f64::NEG_INFINITY, |factor| factor.ln_determinant())
    };
    let best = |chosen: &[usize]| {
        let free = (0..holds.len()).filter(|hold| !chosen.contains(hold));
        let with = |hold: usize| (value(&[chosen, &[hold]].concat()), hold);
        free.map(with).max_by(|a, b| a.0.total_cmp(&b.0))
    };
    let mut chosen = Vec::new();
    while chosen.len() < count.min(holds.len()) {
        chosen.extend(best(&chosen).map(|(_, hold)| hold));
    }
    // Each exchange increases the determinant, so the loop ends.
    let mut changed = true;
    while changed {
        changed = false;
        for at in 0..chosen.len() {
            let mut rest = chosen.clone();
            rest.remove(at);
            if let Some((_, hold)) = best(&rest).filter(|(with, _)| *with > value(&chosen) + 1e-9) {
                chosen[at] = hold;
                changed = true;
            }
        }
    }
    chosen.sort_unstable();
    chosen
}

/// Predicted fit to the chosen holds; `None` if the information matrix is singular by rounding.
pub fn expected_fit(setup: &Setup, holds: &[Symmetric], chosen: &[usize]) -> Option<ExpectedFit> {
    let covariance = sum(setup, holds, chosen).cholesky()?.inverse();
    let identifiability = judge(&covariance, &setup.priors().1);
    let estimate = |(index, unknown): (usize, &crate::Unknown)| Estimate {
        value: unknown.prior,
        sigma: covariance.get(index, index).sqrt(),
        identifiable: identifiability.is_identifiable(index),
    };
    // In prior standard deviations, independent of units.
    let mut scaled = Symmetric::diagonal(&[0.0; MAX_STATES][..setup.unknowns.len()]);
    for (i, a) in setup.unknowns.iter().enumerate() {
        for (j, b) in setup.unknowns.iter().enumerate() {
            let information: f64 = chosen.iter().map(|hold| holds[*hold].get(i, j)).sum();
            scaled.set(i, j, information * a.sigma * b.sigma);
        }
    }
    let own = scaled.eigenvalues();
    let values = own.iter().take(setup.unknowns.len());
    let (least, most) = values.clone().fold((f64::INFINITY, 0.0_f64), |(a, b), v| (a.min(*v), b.max(*v)));
    Some(ExpectedFit {
        estimates: setup.unknowns.iter().enumerate().map(estimate).collect(),
        rank: values.filter(|value| **value > 1.0).count(),
        condition: if least > 1e-12 * most { most / least } else { f64::INFINITY },
        covariance,
    })
}

/// Information of the priors and the chosen holds.
fn sum(setup: &Setup, holds: &[Symmetric], chosen: &[usize]) -> Symmetric {
    let mut out = setup.prior_information();
    chosen.iter().for_each(|hold| out.add(&holds[*hold]));
    out
}
