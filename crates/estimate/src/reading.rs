//! One reading as a least-squares problem, solved by Gauss and Newton's iteration.
//!
//! States are the unknowns `x` and the noise `e` of the measured inputs. Minimised is
//!
//! ```text
//! (x - x0)^T P^-1 (x - x0) + sum e^2 / sigma^2 + sum w (z - h(x, e))^2
//! ```
//!
//! with the prior `x0, P`, the measured values `z`, their prediction `h` and weights `w` of one over the variance.

use crate::matrix::{Cholesky, MAX_STATES, Symmetric, Vector};
use crate::setup::{InputRole, MAX_INPUTS, MAX_ROWS, Measurement, Model, Predicted, Setup};

/// Iterations after which a reading counts as not solved.
const MAX_ITERATIONS: usize = 12;
/// Halvings of a step that makes the cost larger.
const MAX_HALVINGS: usize = 6;
/// A step below this share of the standard deviations is the last: it is taken along the tangent, for another evaluation
/// would move it by its curvature's share only.
const SMALL_STEP: f64 = 0.03;

/// Which side of the onset a reading is solved on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Side {
    /// The model finds out by itself.
    Any,
    /// The actuator touches nothing, whatever the estimate of the gap.
    Free,
    /// The actuator touches the obstacle.
    Contact,
}

/// What is known before a reading.
#[derive(Clone, Debug)]
pub(crate) struct Prior {
    /// Unknowns, then zeros for the noise.
    pub(crate) states: Vector,
    /// Inverse covariance of the states.
    pub(crate) information: Symmetric,
}

/// A reading together with what was known before it.
pub(crate) struct ReadingProblem<'a> {
    pub(crate) setup: &'a Setup,
    pub(crate) measurement: &'a Measurement,
    pub(crate) prior: &'a Prior,
    pub(crate) side: Side,
    /// By row: 1 over the variance; 0 for a value that is missing or rejected.
    pub(crate) weights: [f64; MAX_ROWS],
}

/// A linearised prediction.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Linear {
    /// `z - h`, 0 for a row without weight.
    pub(crate) residual: [f64; MAX_ROWS],
    /// `dh/d(x, e)`.
    pub(crate) jacobian: [Vector; MAX_ROWS],
    /// Whether the model says that the state touches.
    pub(crate) in_contact: bool,
}

impl Linear {
    /// The prediction after a small step.
    fn move_along(&mut self, step: &Vector) {
        for (residual, row) in self.residual.iter_mut().zip(&self.jacobian) {
            *residual -= row.iter().zip(step).map(|(d, s)| d * s).sum::<f64>();
        }
    }
}

/// The minimum of a reading's problem.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Solution {
    pub(crate) states: Vector,
    pub(crate) linear: Linear,
    /// The minimised sum.
    pub(crate) cost: f64,
    /// Factor of the inverse covariance after the reading.
    pub(crate) factor: Cholesky,
}

impl ReadingProblem<'_> {
    /// Evaluates the model at a state; none where it gives no finite answer, or lies on the other side of the onset.
    pub(crate) fn linearise(&self, states: &Vector, model: &mut impl Model) -> Option<Linear> {
        let mut at = self.setup.inputs_at(self.measurement, states);
        if let (Side::Free, Some(gap)) = (self.side, self.setup.gap) {
            at[gap] = f64::INFINITY;
        }
        let mut predicted = [Predicted::default(); MAX_ROWS];
        let rows = &self.setup.rows;
        let in_contact = model.predict(&at, &mut predicted[..rows.len()]);
        if self.side == Side::Contact && !in_contact {
            return None;
        }
        let mut out =
            Linear { residual: [0.0; MAX_ROWS], jacobian: [[0.0; MAX_STATES]; MAX_ROWS], in_contact };
        for (i, row) in rows.iter().enumerate().filter(|(i, _)| self.weights[*i] > 0.0) {
            let bias = row.bias.map_or(0.0, |bias| states[bias]);
            out.residual[i] = self.measurement.rows[i] - predicted[i].value - bias;
            out.jacobian[i] = self.by_state(&predicted[i].gradient);
            if let Some(bias) = row.bias {
                out.jacobian[i][bias] += 1.0;
            }
            let finite = out.residual[i].is_finite() && out.jacobian[i].iter().all(|d| d.is_finite());
            if !finite {
                return None;
            }
        }
        Some(out)
    }

    /// From derivatives by inputs to derivatives by states.
    fn by_state(&self, by_input: &[f64; MAX_INPUTS]) -> Vector {
        let mut out = [0.0; MAX_STATES];
        let mut noise = self.setup.unknowns.len();
        for (input, role) in self.setup.inputs.iter().enumerate() {
            // Without contact the gap is infinite and has no effect.
            let free_gap = self.side == Side::Free && self.setup.gap == Some(input);
            let derivative = if free_gap { 0.0 } else { by_input[input] };
            match *role {
                InputRole::Given(_) => {}
                InputRole::Estimated(unknown) => out[unknown] += derivative,
                InputRole::Measured { bias, .. } => {
                    if let Some(bias) = bias {
                        out[bias] -= derivative;
                    }
                    out[noise] -= derivative;
                    noise += 1;
                }
            }
        }
        out
    }

    fn cost(&self, states: &Vector, linear: &Linear) -> f64 {
        let change = difference(states, &self.prior.states);
        let before: f64 = change.iter().zip(self.prior.information.times(&change)).map(|(a, b)| a * b).sum();
        let rows = self.weights.iter().zip(&linear.residual);
        before + rows.map(|(w, r)| w * r * r).sum::<f64>()
    }

    /// Matrix and right-hand side of the normal equations with other weights than the problem's.
    pub(crate) fn equations(
        &self,
        states: &Vector,
        linear: &Linear,
        weights: &[f64; MAX_ROWS],
    ) -> (Symmetric, Vector) {
        let mut matrix = self.prior.information;
        let mut right = self.prior.information.times(&difference(&self.prior.states, states));
        for (i, weight) in weights.iter().enumerate().filter(|(_, w)| **w > 0.0) {
            matrix.add_outer(*weight, &linear.jacobian[i]);
            for (right, d) in right.iter_mut().zip(&linear.jacobian[i]) {
                *right += weight * linear.residual[i] * d;
            }
        }
        (matrix, right)
    }

    /// [`Self::equations`] with the matrix factorised; none when it is not positive definite.
    pub(crate) fn normal_equations(
        &self,
        states: &Vector,
        linear: &Linear,
        weights: &[f64; MAX_ROWS],
    ) -> Option<(Cholesky, Vector)> {
        let (matrix, right) = self.equations(states, linear, weights);
        Some((matrix.cholesky()?, right))
    }

    /// The minimum that the iteration reaches from `start`; none when it does not converge. Unknowns stay in their ranges.
    pub(crate) fn solve(&self, start: &Vector, model: &mut impl Model) -> Option<Solution> {
        let mut states = *start;
        let mut linear = self.linearise(&states, model)?;
        let mut cost = self.cost(&states, &linear);
        for _ in 0..MAX_ITERATIONS {
            let (factor, right) = self.normal_equations(&states, &linear, &self.weights)?;
            let step = factor.solve(&right);
            // In units of the standard deviations: |L^T step|^2 = step^T A step.
            let length: f64 = step.iter().zip(&right).map(|(s, r)| s * r).sum();
            if length < SMALL_STEP * SMALL_STEP {
                let before = states;
                states.iter_mut().zip(&step).for_each(|(x, s)| *x += s);
                self.keep_in_range(&mut states);
                linear.move_along(&difference(&states, &before));
                let cost = self.cost(&states, &linear);
                return Some(Solution { states, linear, cost, factor });
            }
            let (mut share, mut halvings) = (1.0, 0);
            loop {
                let mut trial = states;
                trial.iter_mut().zip(&step).for_each(|(x, s)| *x += share * s);
                self.keep_in_range(&mut trial);
                if trial == states {
                    return Some(Solution { states, linear, cost, factor }); // held at the edge of a range
                }
                let there = self.linearise(&trial, model);
                let better = there.map(|linear| (self.cost(&trial, &linear), linear));
                match better.filter(|(there, _)| *there <= cost + 1e-9 * cost.abs() + 1e-12) {
                    Some(found) => {
                        states = trial;
                        (cost, linear) = found;
                        break;
                    }
                    // A step too small to matter is not tried.
                    None if halvings < MAX_HALVINGS && share * share * length > SMALL_STEP * SMALL_STEP => {
                        share *= 0.5;
                        halvings += 1;
                    }
                    // No step along the direction helps: a minimum at the edge of a range or of the contact.
                    None => return Some(Solution { states, linear, cost, factor }),
                }
            }
        }
        None
    }

    fn keep_in_range(&self, states: &mut Vector) {
        for (x, unknown) in states.iter_mut().zip(&self.setup.unknowns) {
            *x = x.clamp(unknown.range[0], unknown.range[1]);
        }
    }
}

pub(crate) fn difference(a: &Vector, b: &Vector) -> Vector {
    std::array::from_fn(|i| a[i] - b[i])
}
