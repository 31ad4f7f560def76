//! One reading as a least-squares problem, and the search for the states that explain it.
//!
//! States are the unknowns `x` and the noise `e` of the measured inputs. The solution minimises
//!
//! ```text
//! (x - x0)^T P^-1 (x - x0) + sum e^2 / sigma^2 + sum w (z - h(x, e))^2
//! ```
//!
//! with the prior `x0, P`, the measured values `z`, their prediction `h` and weights `w` of one over the variance.
//!
//! A prediction costs far more than the algebra of a step. A search therefore starts at the minimum of the last prediction on its
//! side of the onset, continued along its tangent; usually one prediction there confirms it. Blocks of values that contradict the rest
//! are rejected by the residuals that a step would leave. The rejection starts again with each prediction.

use crate::matrix::{Cholesky, MAX_STATES, Symmetric, Vector, chi_squared_quantile};
use crate::setup::{InputRole, MAX_INPUTS, MAX_ROWS, MeasuredRow, Measurement, Model, Predicted, Setup};

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
pub(crate) struct Prediction {
    inputs: [f64; MAX_INPUTS],
    predicted: [Predicted; MAX_ROWS],
    in_contact: bool,
}

impl Prediction {
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
    pub(crate) fn present(&self) -> impl Iterator<Item = (usize, &MeasuredRow)> {
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
        let mut inputs = self.setup.inputs_at(self.measurement, states);
        if let (Side::Free, Some(gap)) = (self.side, self.setup.gap) {
            inputs[gap] = f64::INFINITY;
        }
        inputs
    }

    /// Prediction at a state; `None` if the state lies on the other side of the onset.
    pub(crate) fn predict(&self, states: &Vector, model: &mut impl Model) -> Option<Prediction> {
        let inputs = self.inputs_at(states);
        let mut out = Prediction { inputs, predicted: [Predicted::default(); MAX_ROWS], in_contact: false };
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
    pub(crate) fn linear_of(&self, seen: &Prediction, states: &Vector) -> Option<Linear> {
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
    fn by_states(&self, seen: &Prediction, out: &mut [Vector; MAX_ROWS]) {
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
            let outside = self.setup.unknowns.iter().enumerate().find_map(|(index, unknown)| {
                let there = states[index] + step[index];
                let end = there.clamp(unknown.range[0], unknown.range[1]);
                (held[index].is_none() && end != there).then_some((index, end - states[index]))
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

// ---- search ----

/// Largest number of predictions for one reading. The last step is then along the tangent, and [`crate::Update::converged`] is false.
pub const MAX_PREDICTIONS: u32 = 10;
/// One-sided normal quantile (1e-4) beyond which a block is rejected.
const GATE_Z: f64 = 3.719;
/// Multiple of the limit beyond which a block is rejected at any distance from the minimum.
const BEYOND_DOUBT: f64 = 4.0;
/// Evidence that a minimum may have beyond its tangent's prediction; twice that at a distance of [`FAR`] along another reading's
/// tangent.
const CURVATURE_EVIDENCE: f64 = 10.0;
/// Distance of the measured inputs, in standard deviations, within which a prediction is recent.
const RECENT: f64 = 10.0;
/// Halvings of a step that increases the cost.
const MAX_HALVINGS: usize = 6;
/// Length of the last step, in standard deviations. It is taken along the tangent: another prediction would change it only by
/// the curvature.
const SMALL_STEP: f64 = 0.5;
/// Largest shift of a search's start by another reading's tangent, in standard deviations.
const FAR: f64 = 4.0;

/// Model within one update, with the predictions left and the last prediction of each side.
pub(crate) struct Predictor<'a, M> {
    pub(crate) model: &'a mut M,
    pub(crate) left: u32,
    pub(crate) seen: &'a mut LastPredictions,
}

/// Last prediction per side of the onset.
#[derive(Clone, Debug, Default)]
pub(crate) struct LastPredictions([Option<Prediction>; 3]);

/// Solution of a reading on one side of the onset.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Explanation {
    pub(crate) side: Side,
    pub(crate) states: Vector,
    pub(crate) linear: Linear,
    /// Factor of the inverse covariance after the reading.
    pub(crate) factor: Cholesky,
    /// Blocks that contradict the rest.
    pub(crate) rejected: u32,
    /// Largest sum of squares that the rejected blocks could have if they fitted.
    pub(crate) penalty: f64,
    /// Twice the negative logarithm of the evidence by Laplace's approximation, up to a constant; the smaller, the more likely.
    pub(crate) evidence: f64,
    /// True if the last step was small; false if the predictions were used up.
    pub(crate) converged: bool,
}

/// Step from a linearised prediction, with the rejected blocks.
struct Step {
    along: Vector,
    /// Squared length in standard deviations.
    length: f64,
    /// Decrease of the cost along the tangent.
    gain: f64,
    factor: Cholesky,
    rejected: Rejection,
    /// Blocks of these that stay rejected at any further prediction.
    beyond_doubt: Rejection,
}

/// Start and prospect of a search from another reading's prediction.
struct Guess {
    /// Minimum of its tangent, if that is near.
    states: Option<Vector>,
    /// Expected result, if the prediction is recent.
    prospect: Option<Prospect>,
}

/// Best possible result of a search.
#[derive(Clone, Copy)]
pub(crate) struct Prospect {
    /// Blocks left out.
    pub(crate) rejected: u32,
    /// As in [`Explanation`].
    pub(crate) evidence: f64,
}

/// Rejection blocks, with the largest sum of squares that they could have if they fitted.
#[derive(Clone, Copy, Default)]
struct Rejection {
    blocks: u32,
    penalty: f64,
}

impl<M: Model> Predictor<'_, M> {
    fn predict(&mut self, problem: &ReadingProblem<'_>, states: &Vector) -> Option<Linear> {
        self.left = self.left.checked_sub(1)?;
        let seen = problem.predict(states, self.model)?;
        let linear = problem.linear_of(&seen, states)?;
        self.seen.0[problem.side as usize] = Some(seen);
        Some(linear)
    }

    /// States that explain a reading best; `spread` are the standard deviations before it. `None` if the model has no finite
    /// prediction or the expected result is not `worth` the search.
    pub(crate) fn explain(
        &mut self,
        problem: &mut ReadingProblem<'_>,
        start: &Vector,
        spread: &Vector,
        worth: impl Fn(Prospect) -> bool,
    ) -> Option<Explanation> {
        let guess = self.guess(problem, start, spread);
        if guess.as_ref().and_then(|guess| guess.prospect).is_some_and(|prospect| !worth(prospect)) {
            return None;
        }
        let mut states = guess.and_then(|guess| guess.states).unwrap_or(*start);
        let mut linear = match self.predict(problem, &states) {
            Some(linear) => linear,
            None => {
                states = *start;
                self.predict(problem, &states)?
            }
        };
        'steps: loop {
            let step = step(problem, &states, &linear)?;
            let is_small = step.length < SMALL_STEP * SMALL_STEP;
            let cost = problem.cost(&states, &linear);
            if !worth(step.prospect(cost, if is_small { 0.0 } else { CURVATURE_EVIDENCE })) {
                return None;
            }
            if is_small || self.left == 0 {
                let before = states;
                states.iter_mut().zip(&step.along).for_each(|(x, s)| *x += s);
                problem.keep_in_range(&mut states);
                linear.move_along(&difference(&states, &before));
                return Some(explained(problem, states, linear, step, is_small));
            }
            let mut fraction = 1.0;
            for _ in 0..=MAX_HALVINGS {
                let mut trial = states;
                trial.iter_mut().zip(&step.along).for_each(|(x, s)| *x += fraction * s);
                problem.keep_in_range(&mut trial);
                if let Some(there) = self.predict(problem, &trial)
                    && problem.cost(&trial, &there) <= cost + 1e-9 * cost.abs() + 1e-12
                {
                    (states, linear) = (trial, there);
                    continue 'steps;
                }
                // A step too small to matter is not tried.
                if self.left == 0 || fraction * fraction * step.length <= SMALL_STEP * SMALL_STEP {
                    break;
                }
                fraction *= 0.5;
            }
            // No step along the direction reduces the cost: a minimum at the end of a range or at the onset.
            let converged = self.left > 0;
            return Some(explained(problem, states, linear, step, converged));
        }
    }

    /// Start and prospect from the tangent of the last prediction.
    fn guess(&self, problem: &mut ReadingProblem<'_>, start: &Vector, spread: &Vector) -> Option<Guess> {
        let seen = self.seen.0[problem.side as usize].as_ref()?;
        let inputs = problem.inputs_at(start);
        let linear = problem.linear_of(&seen.moved_to(&inputs), start)?;
        let step = step(problem, start, &linear)?;
        let is_near = step.along.iter().zip(spread).all(|(step, sigma)| step.abs() <= FAR * sigma);
        let is_fresh = seen.measured_within(RECENT, problem.setup, &inputs);
        let mut states = *start;
        states.iter_mut().zip(&step.along).for_each(|(x, s)| *x += s);
        problem.keep_in_range(&mut states);
        // The tangent's error grows with the square of the distance along it.
        let way = seen.way_to(&problem.inputs_at(&states), problem.setup, spread) / FAR;
        let beyond = 2.0 * CURVATURE_EVIDENCE * (way * way).min(1.0);
        Some(Guess {
            states: is_near.then_some(states),
            prospect: is_fresh.then(|| step.prospect(problem.cost(start, &linear), beyond)),
        })
    }
}

impl Step {
    /// Predicted result of a search from `cost`, given evidence `beyond` the tangent's.
    fn prospect(&self, cost: f64, beyond: f64) -> Prospect {
        let Rejection { blocks: rejected, penalty } =
            if beyond > 0.0 { self.beyond_doubt } else { self.rejected };
        let evidence = cost - self.gain + self.factor.ln_determinant() + penalty - beyond;
        Prospect { rejected, evidence }
    }
}

fn explained(
    problem: &ReadingProblem<'_>,
    states: Vector,
    linear: Linear,
    step: Step,
    converged: bool,
) -> Explanation {
    let Step { factor, rejected: Rejection { blocks: rejected, penalty }, .. } = step;
    let evidence = problem.cost(&states, &linear) + factor.ln_determinant() + penalty;
    Explanation { side: problem.side, states, linear, factor, rejected, penalty, evidence, converged }
}

/// Step to the minimum of a linearised prediction. Contradicting blocks are rejected one after the other, up to the limit. The
/// problem's weights are then those of the remaining blocks.
fn step(problem: &mut ReadingProblem<'_>, states: &Vector, linear: &Linear) -> Option<Step> {
    let (mut rejected, mut beyond_doubt) = (Rejection::default(), Rejection::default());
    let most = problem.most_rejected();
    loop {
        problem.leave_out(rejected.blocks);
        let (matrix, right) = problem.equations(states, linear, &problem.weights);
        let (along, factor) = problem.step(states, &matrix, &right)?;
        let worst = worst_block(problem, linear, &along, rejected.blocks);
        match worst.filter(|_| rejected.blocks.count_ones() <= most) {
            Some((block, limit, excess)) => {
                for (which, least) in [(&mut rejected, 1.0), (&mut beyond_doubt, BEYOND_DOUBT)] {
                    if excess > least {
                        which.blocks |= 1 << block;
                        which.penalty += limit;
                    }
                }
            }
            None => {
                let length: f64 = along.iter().zip(matrix.times(&along)).map(|(s, a)| s * a).sum();
                let gain = 2.0 * along.iter().zip(&right).map(|(s, r)| s * r).sum::<f64>() - length;
                return Some(Step { along, length, gain, factor, rejected, beyond_doubt });
            }
        }
    }
}

/// Block whose residual after a step contradicts the rest most, with its limit of the sum of squares and the ratio to it; `None`
/// if all blocks fit.
fn worst_block(
    problem: &ReadingProblem<'_>,
    linear: &Linear,
    along: &Vector,
    rejected: u32,
) -> Option<(usize, f64, f64)> {
    let (mut sums, mut counts) = ([0.0; MAX_ROWS], [0; MAX_ROWS]);
    for (i, row) in problem.present() {
        let moved: f64 = linear.jacobian[i].iter().zip(along).map(|(d, s)| d * s).sum();
        let residual = linear.residual[i] - moved;
        sums[row.block] += residual * residual / row.variance(1.0);
        counts[row.block] += 1;
    }
    let mut worst = None;
    for (block, (sum, count)) in sums.into_iter().zip(counts).enumerate() {
        if count == 0 || rejected & (1 << block) != 0 {
            continue;
        }
        let limit = chi_squared_quantile(count, GATE_Z);
        if sum > limit && worst.is_none_or(|(_, _, excess)| sum / limit > excess) {
            worst = Some((block, limit, sum / limit));
        }
    }
    worst
}

/// Innovation squared over its covariance, linearised at the solution: `v^T R^-1 v - b^T A^-1 b` with the innovation
/// `v = z - h(prior)`. The factor has the size of the states, not of the measurements.
pub(crate) fn innovation(problem: &ReadingProblem<'_>, solution: &Explanation) -> f64 {
    let moved = difference(&solution.states, &problem.prior.states);
    let (mut sum, mut right) = (0.0, [0.0; MAX_STATES]);
    for (i, weight) in problem.weights.iter().enumerate().filter(|(_, w)| **w > 0.0) {
        let row = &solution.linear.jacobian[i];
        let along: f64 = row.iter().zip(&moved).map(|(d, m)| d * m).sum();
        let innovation = solution.linear.residual[i] + along;
        sum += weight * innovation * innovation;
        right.iter_mut().zip(row).for_each(|(right, d)| *right += weight * innovation * d);
    }
    let explained = solution.factor.solve(&right);
    sum - right.iter().zip(&explained).map(|(a, b)| a * b).sum::<f64>()
}
