//! The search for the states that explain a reading: Gauss and Newton's steps, without the blocks of values that contradict the rest.
//!
//! A prediction costs far more than the algebra of a step. So a search begins where the last prediction on its side of the onset,
//! continued along its tangent, has the minimum: mostly one prediction there confirms it. Blocks are left out by the residuals
//! that a step would leave, all anew with each prediction.

use crate::matrix::{Cholesky, Vector};
use crate::normal::chi_squared_quantile;
use crate::reading::{Linear, ReadingProblem, Seen, Side, difference};
use crate::setup::{MAX_ROWS, Model};

/// Predictions for one reading at most; then the last step is taken along the tangent, and said.
pub const MAX_PREDICTIONS: u32 = 10;
/// A block whose residual is that unlikely (one-sided normal quantile of 1e-4) is rejected.
const GATE_Z: f64 = 3.719;
/// A block whose sum of squares is so many times the limit is rejected at the minimum too, however far that is.
const BEYOND_DOUBT: f64 = 4.0;
/// Evidence that a minimum may have beyond what the tangent before it says; twice that beyond another reading's tangent, [`FAR`] along it.
const CURVATURE_EVIDENCE: f64 = 10.0;
/// A prediction is recent for readings of measured inputs within so many standard deviations of it.
const RECENT: f64 = 10.0;
/// Halvings of a step that makes the cost larger.
const MAX_HALVINGS: usize = 6;
/// A step below this share of the standard deviations is the last: it is taken along the tangent, for another prediction
/// would move it by its curvature's share only.
const SMALL_STEP: f64 = 0.5;
/// Standard deviations by which the tangent of another reading may move the begin of a search.
const FAR: f64 = 4.0;

/// A model within one update: its predictions are counted, and the last one of each side is kept.
pub(crate) struct Asked<'a, M> {
    pub(crate) model: &'a mut M,
    pub(crate) left: u32,
    pub(crate) seen: &'a mut LastSeen,
}

/// By side of the onset what the model said last.
#[derive(Clone, Debug, Default)]
pub(crate) struct LastSeen([Option<Seen>; 3]);

/// A reading with one side of the onset assumed.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Explained {
    pub(crate) side: Side,
    pub(crate) states: Vector,
    pub(crate) linear: Linear,
    /// Factor of the inverse covariance after the reading.
    pub(crate) factor: Cholesky,
    /// Blocks that contradict the rest.
    pub(crate) rejected: u32,
    /// The largest sum of squares that the rejected blocks might have.
    pub(crate) penalty: f64,
    /// Twice the negative logarithm of the evidence by Laplace's approximation, but for a constant; less is likelier.
    pub(crate) evidence: f64,
    /// Whether the last step was small; otherwise the predictions ended before.
    pub(crate) converged: bool,
}

/// A step from a linearised prediction, and what it leaves out.
struct Step {
    along: Vector,
    /// Its square in standard deviations, and by how much the sum that is minimised falls along the tangent.
    length: f64,
    gain: f64,
    factor: Cholesky,
    rejected: Rejected,
    /// Those of them that no further prediction would take in.
    beyond_doubt: Rejected,
}

/// What another reading's prediction says before any is made.
struct Guess {
    /// Where its tangent has the minimum, when that is near.
    states: Option<Vector>,
    /// When it is recent.
    prospect: Option<Prospect>,
}

/// What a search will come to at best.
#[derive(Clone, Copy)]
pub(crate) struct Prospect {
    /// Blocks left out.
    pub(crate) rejected: u32,
    /// As in [`Explained`].
    pub(crate) evidence: f64,
}

/// Blocks left out, with the largest sum of squares that they might have.
#[derive(Clone, Copy, Default)]
struct Rejected {
    blocks: u32,
    penalty: f64,
}

impl<M: Model> Asked<'_, M> {
    fn look(&mut self, problem: &ReadingProblem<'_>, states: &Vector) -> Option<Linear> {
        self.left = self.left.checked_sub(1)?;
        let seen = problem.predict(states, self.model)?;
        let linear = problem.linear_of(&seen, states)?;
        self.seen.0[problem.side as usize] = Some(seen);
        Some(linear)
    }

    /// The states that explain a reading best, with `spread` the standard deviations before it. None where the model has no
    /// answer, or the blocks left out are not `worth` it.
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
        let mut linear = match self.look(problem, &states) {
            Some(linear) => linear,
            None => {
                states = *start;
                self.look(problem, &states)?
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
            let mut share = 1.0;
            for _ in 0..=MAX_HALVINGS {
                let mut trial = states;
                trial.iter_mut().zip(&step.along).for_each(|(x, s)| *x += share * s);
                problem.keep_in_range(&mut trial);
                if let Some(there) = self.look(problem, &trial)
                    && problem.cost(&trial, &there) <= cost + 1e-9 * cost.abs() + 1e-12
                {
                    (states, linear) = (trial, there);
                    continue 'steps;
                }
                // A step too small to matter is not tried.
                if self.left == 0 || share * share * step.length <= SMALL_STEP * SMALL_STEP {
                    break;
                }
                share *= 0.5;
            }
            // No step along the direction helps: a minimum at the edge of a range or of the contact.
            let converged = self.left > 0;
            return Some(explained(problem, states, linear, step, converged));
        }
    }

    /// What the tangent of the last prediction says.
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
        // What the tangent leaves out grows with the square of the way along it.
        let way = seen.way_to(&problem.inputs_at(&states), problem.setup, spread) / FAR;
        let beyond = 2.0 * CURVATURE_EVIDENCE * (way * way).min(1.0);
        Some(Guess {
            states: is_near.then_some(states),
            prospect: is_fresh.then(|| step.prospect(problem.cost(start, &linear), beyond)),
        })
    }
}

impl Step {
    /// What a search comes to if its next minimum has so much evidence beyond what the tangent says, from this cost.
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

/// The step to the minimum of a linearised prediction, one block after the other left out that contradicts the rest, as long as
/// the reading can spare it. The problem's weights are those of the rest.
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

/// The block whose residual after a step contradicts the rest most, when one does, with the largest sum of squares it might have
/// and how many times that it has.
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
