//! Search for the states that explain a reading: Gauss-Newton steps without the blocks of values that contradict the rest.
//!
//! A prediction costs far more than the algebra of a step. A search therefore starts at the minimum of the last prediction on its
//! side of the onset, continued along its tangent; usually one prediction there confirms it. Blocks are rejected by the residuals
//! that a step would leave. The rejection starts again with each prediction.

use crate::matrix::{Cholesky, MAX_STATES, Vector};
use crate::normal::chi_squared_quantile;
use crate::reading::{Linear, ReadingProblem, Seen, Side, difference};
use crate::setup::{MAX_ROWS, Model};

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
pub(crate) struct Asked<'a, M> {
    pub(crate) model: &'a mut M,
    pub(crate) left: u32,
    pub(crate) seen: &'a mut LastSeen,
}

/// Last prediction per side of the onset.
#[derive(Clone, Debug, Default)]
pub(crate) struct LastSeen([Option<Seen>; 3]);

/// Solution of a reading on one side of the onset.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Explained {
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
    rejected: Rejected,
    /// Blocks of these that stay rejected at any further prediction.
    beyond_doubt: Rejected,
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
    /// As in [`Explained`].
    pub(crate) evidence: f64,
}

/// Rejected blocks, with the largest sum of squares that they could have if they fitted.
#[derive(Clone, Copy, Default)]
struct Rejected {
    blocks: u32,
    penalty: f64,
}

impl<M: Model> Asked<'_, M> {
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
    ) -> Option<Explained> {
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
        let Rejected { blocks: rejected, penalty } =
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
) -> Explained {
    let Step { factor, rejected: Rejected { blocks: rejected, penalty }, .. } = step;
    let evidence = problem.cost(&states, &linear) + factor.ln_determinant() + penalty;
    Explained { side: problem.side, states, linear, factor, rejected, penalty, evidence, converged }
}

/// Step to the minimum of a linearised prediction. Contradicting blocks are rejected one after the other, up to the limit. The
/// problem's weights are then those of the remaining blocks.
fn step(problem: &mut ReadingProblem<'_>, states: &Vector, linear: &Linear) -> Option<Step> {
    let (mut rejected, mut beyond_doubt) = (Rejected::default(), Rejected::default());
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
pub(crate) fn innovation(problem: &ReadingProblem<'_>, solution: &Explained) -> f64 {
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
