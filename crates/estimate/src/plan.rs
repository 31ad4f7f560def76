//! Plan of an experiment that identifies the unknowns: D-optimal choice of holds from the model's gradients.
//!
//! A hold is `n` readings at one state. Its information about the unknowns is `n J^T (R + N M)^-1 J` with the sensors' noise `R` and
//! the model's error `M`. All `N` readings of the experiment share the model's error, as in the fit, and the noise of measured
//! inputs is eliminated. The chosen set of holds has the largest determinant of prior information plus the holds' information.

use crate::batch::eliminate;
use crate::identify;
use crate::matrix::{MAX_STATES, Symmetric};
use crate::outcome::Estimate;
use crate::reading::{Prior, ReadingProblem, Side};
use crate::setup::{InputRole, MAX_INPUTS, MAX_ROWS, Measurement, Model, PASTS, Setup};

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
    let identifiability = identify::judge(&covariance, &setup.priors().1);
    let estimate = |(at, unknown): (usize, &crate::Unknown)| Estimate {
        value: unknown.prior,
        sigma: covariance.get(at, at).sqrt(),
        identifiable: identifiability.is_identifiable(at),
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
