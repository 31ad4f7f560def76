//! One reading as a least-squares problem (`search.rs` solves it).
//!
//! States are the unknowns `x` and the noise `e` of the measured inputs. The solution minimises
//!
//! ```text
//! (x - x0)^T P^-1 (x - x0) + sum e^2 / sigma^2 + sum w (z - h(x, e))^2
//! ```
//!
//! with the prior `x0, P`, the measured values `z`, their prediction `h` and weights `w` of one over the variance.

use crate::matrix::{Cholesky, MAX_STATES, Symmetric, Vector};
use crate::setup::{InputRole, MAX_INPUTS, MAX_ROWS, Measurement, Model, Predicted, Row, Setup};

/// Side of the onset on which a reading is solved.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Side {
    /// The model decides.
    Any,
    /// The actuator touches nothing, whatever the estimate of the gap.
    Free,
    /// The actuator touches the obstacle.
    Contact,
}

/// Prior of the states of one reading.
#[derive(Clone, Debug)]
pub(crate) struct Prior {
    /// Unknowns, then zeros for the noise.
    pub(crate) states: Vector,
    /// Inverse covariance of the states.
    pub(crate) information: Symmetric,
}

/// Reading with its prior.
pub(crate) struct ReadingProblem<'a> {
    pub(crate) setup: &'a Setup,
    pub(crate) measurement: &'a Measurement,
    pub(crate) prior: &'a Prior,
    pub(crate) side: Side,
    /// Inverse variance per row; 0 for a missing or rejected value.
    pub(crate) weights: [f64; MAX_ROWS],
}

/// Linearised prediction.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Linear {
    /// `z - h`, 0 for a missing value.
    pub(crate) residual: [f64; MAX_ROWS],
    /// `dh/d(x, e)`.
    pub(crate) jacobian: [Vector; MAX_ROWS],
    /// True if the model predicts contact.
    pub(crate) in_contact: bool,
}

impl Linear {
    /// `r_d = J_e d - J_x S`: residuals by a difference `d` of the first measured input from the value that acts, with errors `S` of the
    /// `count` unknowns.
    pub(crate) fn of_memory(&self, count: usize, difference: f64, errors: &Vector) -> [f64; MAX_ROWS] {
        self.jacobian.map(|row| {
            let of_unknowns: f64 = row[..count].iter().zip(errors).map(|(d, s)| d * s).sum();
            row[count] * difference - of_unknowns
        })
    }

    /// `J^T W r`: right-hand side of the normal equations for residuals.
    pub(crate) fn right_of(&self, weights: &[f64; MAX_ROWS], residuals: &[f64; MAX_ROWS]) -> Vector {
        let mut right = [0.0; MAX_STATES];
        let rows = self.jacobian.iter().zip(residuals).zip(weights);
        for ((row, residual), weight) in rows.filter(|(_, weight)| **weight > 0.0) {
            right.iter_mut().zip(row).for_each(|(right, d)| *right += weight * residual * d);
        }
        right
    }

    /// Moves the prediction along its tangent.
    pub(crate) fn move_along(&mut self, step: &Vector) {
        for (residual, row) in self.residual.iter_mut().zip(&self.jacobian) {
            *residual -= row.iter().zip(step).map(|(d, s)| d * s).sum::<f64>();
        }
    }
}

/// Last prediction of a model on one side of the onset.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Seen {
    inputs: [f64; MAX_INPUTS],
    predicted: [Predicted; MAX_ROWS],
    in_contact: bool,
}

impl Seen {
    /// True if the measured inputs are within `sigmas` standard deviations of the prediction's.
    pub(crate) fn measured_within(&self, sigmas: f64, setup: &Setup, inputs: &[f64; MAX_INPUTS]) -> bool {
        let mut ways =
            setup.measured_inputs().map(|(input, sigma)| (inputs[input] - self.inputs[input]) / sigma);
        ways.all(|way| way.abs() <= sigmas)
    }

    /// Largest distance of an estimated or measured input from the prediction's, in standard deviations `spread` (unknowns first,
    /// then measured inputs).
    pub(crate) fn way_to(&self, inputs: &[f64; MAX_INPUTS], setup: &Setup, spread: &Vector) -> f64 {
        let mut measured = spread[setup.unknowns.len()..].iter();
        let mut longest: f64 = 0.0;
        for (input, role) in setup.inputs.iter().enumerate() {
            let sigma = match *role {
                InputRole::Given(_) => continue,
                InputRole::Estimated(unknown) => spread[unknown],
                InputRole::Measured { .. } => measured.next().copied().unwrap_or(f64::NAN),
            };
            let way = (inputs[input] - self.inputs[input]).abs() / sigma;
            // The difference of two infinite gaps (no obstacle) is NaN: the distance is 0.
            let way = if inputs[input] == self.inputs[input] { 0.0 } else { way };
            longest = if way.is_nan() { f64::INFINITY } else { longest.max(way) };
        }
        longest
    }

    /// Prediction at `inputs`, continued along the tangent.
    pub(crate) fn moved_to(&self, inputs: &[f64; MAX_INPUTS]) -> Self {
        let mut way = *inputs;
        way.iter_mut().zip(&self.inputs).for_each(|(to, from)| *to -= from);
        // Inputs that the model does not have are NaN, and so is the difference of two infinite gaps.
        way.iter_mut().filter(|way| way.is_nan()).for_each(|way| *way = 0.0);
        let mut out = Self { inputs: *inputs, ..*self };
        for predicted in &mut out.predicted {
            predicted.value += predicted.gradient.iter().zip(way).map(|(by, way)| by * way).sum::<f64>();
        }
        out
    }
}

impl ReadingProblem<'_> {
    /// Rows with a measured value, and their positions.
    pub(crate) fn present(&self) -> impl Iterator<Item = (usize, &Row)> {
        let rows = self.setup.rows.iter().enumerate();
        rows.filter(|(i, _)| self.measurement.rows[*i].is_finite())
    }

    /// Sets the weights of all measured values except those of `blocks`.
    pub(crate) fn leave_out(&mut self, blocks: u32) {
        let mut weights = [0.0; MAX_ROWS];
        for (i, row) in self.present().filter(|(_, row)| blocks & (1 << row.block) == 0) {
            weights[i] = 1.0 / row.variance(1.0);
        }
        self.weights = weights;
    }

    /// Largest number of rejected blocks: half of them. If more contradict, the model does not explain the reading.
    pub(crate) fn most_rejected(&self) -> u32 {
        let blocks = self.present().fold(0_u32, |bits, (_, row)| bits | 1 << row.block);
        (blocks.count_ones() / 2).max(1)
    }

    /// Model inputs at a state, on the problem's side of the onset.
    pub(crate) fn inputs_at(&self, states: &Vector) -> [f64; MAX_INPUTS] {
        let mut at = self.setup.inputs_at(self.measurement, states);
        if let (Side::Free, Some(gap)) = (self.side, self.setup.gap) {
            at[gap] = f64::INFINITY;
        }
        at
    }

    /// Prediction at a state; `None` if the state lies on the other side of the onset.
    pub(crate) fn predict(&self, states: &Vector, model: &mut impl Model) -> Option<Seen> {
        let inputs = self.inputs_at(states);
        let mut out = Seen { inputs, predicted: [Predicted::default(); MAX_ROWS], in_contact: false };
        let predicted = &mut out.predicted[..self.setup.rows.len()];
        match self.side {
            Side::Free => model.predict_free(&inputs, predicted),
            Side::Any | Side::Contact => out.in_contact = model.predict(&inputs, predicted),
        }
        (self.side != Side::Contact || out.in_contact).then_some(out)
    }

    /// Linearised prediction at a state; `None` if it is not finite or lies on the other side of the onset.
    pub(crate) fn linearise(&self, states: &Vector, model: &mut impl Model) -> Option<Linear> {
        self.linear_of(&self.predict(states, model)?, states)
    }

    /// Residuals and Jacobian of a prediction; `None` if it is not finite.
    pub(crate) fn linear_of(&self, seen: &Seen, states: &Vector) -> Option<Linear> {
        let mut out = Linear {
            residual: [0.0; MAX_ROWS],
            jacobian: [[0.0; MAX_STATES]; MAX_ROWS],
            in_contact: seen.in_contact,
        };
        for (i, row) in self.present() {
            let bias = row.bias.map_or(0.0, |bias| states[bias]);
            out.residual[i] = self.measurement.rows[i] - seen.predicted[i].value - bias;
        }
        self.by_states(seen, &mut out.jacobian);
        // The sum is finite if and only if all terms are (predictions are too small to overflow).
        let sums = out.residual.iter().zip(&out.jacobian).map(|(r, by)| r + by.iter().sum::<f64>());
        sums.sum::<f64>().is_finite().then_some(out)
    }

    /// Converts derivatives with respect to inputs into derivatives with respect to states.
    fn by_states(&self, seen: &Seen, out: &mut [Vector; MAX_ROWS]) {
        let mut noise = self.setup.unknowns.len();
        for (input, role) in self.setup.inputs.iter().enumerate() {
            let own = match *role {
                InputRole::Given(_) => continue,
                InputRole::Estimated(unknown) => (unknown, 1.0),
                InputRole::Measured { .. } => {
                    noise += 1;
                    (noise - 1, -1.0)
                }
            };
            let offsets = role.offsets(self.measurement.spread[input]);
            let states = offsets.map(|(unknown, by)| (unknown, -by)).chain([own]);
            let by_input = self.measurement.load_by_input[input];
            if let (true, Some(load)) = (by_input != 0.0, self.setup.load_input()) {
                // Noise does not move the body.
                for (i, _) in self.present() {
                    out[i][own.0] -= by_input * seen.predicted[i].gradient[load];
                }
            }
            // Without contact the gap is infinite and has no effect.
            if self.side == Side::Free && self.setup.gap == Some(input) {
                continue;
            }
            for (state, sign) in states {
                for (i, _) in self.present() {
                    out[i][state] += sign * seen.predicted[i].gradient[input];
                }
            }
        }
        for (i, row) in self.present() {
            if let Some(bias) = row.bias {
                out[i][bias] += 1.0;
            }
        }
    }

    /// Sum that is minimised.
    pub(crate) fn cost(&self, states: &Vector, linear: &Linear) -> f64 {
        let change = difference(states, &self.prior.states);
        let before: f64 = change.iter().zip(self.prior.information.times(&change)).map(|(a, b)| a * b).sum();
        let rows = self.weights.iter().zip(&linear.residual);
        before + rows.map(|(w, r)| w * r * r).sum::<f64>()
    }

    /// Matrix and right-hand side of the normal equations with the given weights.
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

    /// Step to the minimum with the unknowns kept in their ranges, and the factor of the whole matrix; `None` if the matrix is not
    /// positive definite.
    pub(crate) fn step(
        &self,
        states: &Vector,
        matrix: &Symmetric,
        right: &Vector,
    ) -> Option<(Vector, Cholesky)> {
        let factor = matrix.cholesky()?;
        let mut step = factor.solve(right);
        let mut held: [Option<f64>; MAX_STATES] = [None; MAX_STATES];
        // Each iteration fixes one more unknown at an end of its range, so the loop ends.
        loop {
            let outside = self.setup.unknowns.iter().enumerate().find_map(|(at, unknown)| {
                let there = states[at] + step[at];
                let end = there.clamp(unknown.range[0], unknown.range[1]);
                (held[at].is_none() && end != there).then_some((at, end - states[at]))
            });
            let Some((at, way)) = outside else { return Some((step, factor)) };
            held[at] = Some(way);
            step = matrix.solve_with(&held, right)?;
        }
    }

    pub(crate) fn keep_in_range(&self, states: &mut Vector) {
        for (x, unknown) in states.iter_mut().zip(&self.setup.unknowns) {
            *x = x.clamp(unknown.range[0], unknown.range[1]);
        }
    }
}

pub(crate) fn difference(a: &Vector, b: &Vector) -> Vector {
    std::array::from_fn(|i| a[i] - b[i])
}
