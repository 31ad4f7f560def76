//! Motion between two readings: the states of a swing among the unknowns are carried by the model's own step, their covariance by difference
//! quotients of that step with respect to all unknowns.
//!
//! States are the inertial load `a` and the velocity along its tangent, as a rate `v` of the load. The position `X(u, a)` is continuous where
//! a measured input `u` is noisy: noise `e` of one reading changes the load by `-c e`, `c = da/du` of the reading's input alone, and the rate by
//! an impulse, which is process noise. Further process noise is an error of the frequency, and what an impact loses.

use crate::matrix::{MAX_STATES, Symmetric, Vector};
use crate::setup::{MAX_INPUTS, Measurement, Model, MotionEnd, MotionState, Setup, Swing};

/// Differences of an unknown in the quotients, in its standard deviations: the first one that lands or leaves where the states do.
const DIFFERENCES: [f64; 4] = [0.1, -0.1, 0.01, -0.01];
/// Distance of a moving body from its estimate, in standard deviations of the load, at which a reading without contact excludes a gap.
const EXCLUDING_SIGMAS: f64 = 3.0;
/// Smallest standard deviation in the differences, as a fraction of the prior's.
const MIN_SIGMA: f64 = 0.01;
/// Standard deviation of the velocity after a landing or leaving, as a fraction of that before.
const IMPACT: f64 = 0.3;

/// Step of a motion with its derivatives.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CarriedMotion {
    /// Load and rate at the reading.
    pub(crate) states: [f64; 2],
    /// Their derivatives with respect to the unknowns before.
    by: [Vector; 2],
    /// Process noise: variance of the load, covariance, variance of the rate.
    noise: [f64; 3],
    /// Response to a change of the first measured input over all of the step, by which its value acts.
    drive: [f64; 2],
    /// Derivative of the load with respect to each measured input of the reading alone.
    pub(crate) by_reading: [f64; MAX_INPUTS],
}

/// Two readings between which a motion is carried.
pub(crate) struct Passage<'a> {
    pub(crate) setup: &'a Setup,
    pub(crate) from: &'a Measurement,
    pub(crate) to: &'a Measurement,
    /// No obstacle is known yet.
    pub(crate) is_open: bool,
}

impl Passage<'_> {
    fn inputs(&self, at: &Measurement, states: &Vector) -> [f64; MAX_INPUTS] {
        moving_inputs(self.setup, at, states, self.is_open)
    }

    /// Carries the states to the reading; `None` if the motion begins at rest there. The model's last step is the one of the states.
    pub(crate) fn carry(
        &self,
        states: &Vector,
        covariance: &Symmetric,
        model: &mut impl Model,
    ) -> Option<CarriedMotion> {
        let swing = self.setup.swing?;
        let from = self.start(states, &swing);
        let to = self.inputs(self.to, states);
        let base = model.step(&from, self.to.t_s, &to)?;
        let step = StepAround { passage: self, swing, states, covariance, from, to, base };
        let (by, may_change) = step.by_unknowns(model)?;
        let mut carried = CarriedMotion {
            states: [base.load, base.rate],
            by,
            noise: [0.0; 3],
            drive: [0.0; 2],
            by_reading: [0.0; MAX_INPUTS],
        };
        step.add_readings(&mut carried, model)?;
        step.add_frequency(&mut carried);
        if may_change {
            step.add_impact(&mut carried, model)?;
        }
        let arrived = model.step(&step.from, self.to.t_s, &step.to)?;
        carried.states = [arrived.load, arrived.rate];
        Some(carried)
    }

    /// Where the motion begins at states.
    fn start(&self, states: &Vector, swing: &Swing) -> MotionState {
        MotionState { t_s: self.from.t_s, inputs: self.inputs(self.from, states), rate: states[swing.rate] }
    }
}

/// The step of a passage at its states, around which errors are told by further steps.
struct StepAround<'a> {
    passage: &'a Passage<'a>,
    swing: Swing,
    states: &'a Vector,
    covariance: &'a Symmetric,
    from: MotionState,
    to: [f64; MAX_INPUTS],
    /// Where the step ends without further errors.
    base: MotionEnd,
}

impl StepAround<'_> {
    /// Half of its time.
    fn half_s(&self) -> f64 {
        0.5 * (self.passage.to.t_s - self.passage.from.t_s)
    }

    fn quotient(&self, there: &MotionEnd, by: f64) -> [f64; 2] {
        [(there.load - self.base.load) / by, (there.rate - self.base.rate) / by]
    }

    /// Derivatives of load and rate with respect to the unknowns, and whether a body may land or leave within the step.
    fn by_unknowns(&self, model: &mut impl Model) -> Option<([Vector; 2], bool)> {
        let Self { passage, swing, states, from, to, base, .. } = self;
        let (mut by, mut may_change) = ([[0.0; MAX_STATES]; 2], base.has_changed);
        for (index, unknown) in passage.setup.unknowns.iter().enumerate() {
            let sigma = self.covariance.get(index, index).sqrt().max(MIN_SIGMA * unknown.sigma);
            for difference in DIFFERENCES.map(|part| part * sigma) {
                let mut trial = **states;
                trial[index] += difference;
                let [low, high] = unknown.range;
                if !(low..=high).contains(&trial[index]) {
                    continue;
                }
                let (moved, end) = (passage.start(&trial, swing), passage.inputs(passage.to, &trial));
                // A bias of a load cell has no effect on a motion.
                let is_same = |a: &[f64; MAX_INPUTS], b: &[f64; MAX_INPUTS]| {
                    a.iter().zip(b).all(|(a, b)| a.to_bits() == b.to_bits())
                };
                if index != swing.rate && is_same(&moved.inputs, &from.inputs) && is_same(&end, to) {
                    break;
                }
                let there = model.step(&moved, passage.to.t_s, &end)?;
                if there.has_changed == base.has_changed {
                    let derivative = self.quotient(&there, difference);
                    by.iter_mut().zip(derivative).for_each(|(row, d)| row[index] = d);
                    break;
                }
                // An impact is no derivative, but may take place.
                may_change = true;
            }
        }
        Some((by, may_change))
    }

    /// The noise of the reading's measured inputs, and their effects.
    fn add_readings(&self, carried: &mut CarriedMotion, model: &mut impl Model) -> Option<()> {
        let Self { passage, from, to, base, .. } = self;
        let first = passage.setup.measured_inputs().next().map(|(input, _)| input);
        for (input, sigma) in passage.setup.measured_inputs() {
            if !to[input].is_finite() {
                continue;
            }
            let mut end = *to;
            end[input] += sigma;
            let mut difference = sigma;
            let mut there = model.step(from, passage.to.t_s, &end)?;
            if there.has_changed != base.has_changed {
                difference = -sigma;
                end[input] = to[input] - sigma;
                there = model.step(from, passage.to.t_s, &end)?;
            }
            let [load, rate] = self.quotient(&there, difference);
            carried.by_reading[input] = load;
            // The noise of a reading acts in both steps beside it.
            let acting = [2.0 * self.half_s() * rate, 2.0 * rate];
            add_square(&mut carried.noise, acting, sigma);
            if first == Some(input) {
                carried.drive = acting;
            }
        }
        Some(())
    }

    /// The error of the model's frequency.
    fn add_frequency(&self, carried: &mut CarriedMotion) {
        let Swing { load, frequency_error, .. } = self.swing;
        // Change of the rate per load in the step: the square of the frequency times the time.
        let pull = carried.by[1][load].abs();
        let periods = (pull * 2.0 * self.half_s()).sqrt().clamp(1e-3, 1.0);
        let off = self.states[load] - self.passage.setup.unknowns[load].prior;
        let of_frequency = 2.0 * frequency_error * pull * off / periods.sqrt();
        add_square(&mut carried.noise, [self.half_s() * of_frequency, of_frequency], 1.0);
    }

    /// An impact has no derivative, and its time jumps by inner steps: errors of the states before count as independent ones.
    fn add_impact(&self, carried: &mut CarriedMotion, model: &mut impl Model) -> Option<()> {
        let Self { passage, swing, states, base, .. } = self;
        (carried.by, carried.drive) = ([[0.0; MAX_STATES]; 2], [0.0; 2]);
        for (index, unknown) in passage.setup.unknowns.iter().enumerate() {
            let mut trial = **states;
            let sigma = self.covariance.get(index, index).sqrt();
            trial[index] += if trial[index] + sigma > unknown.range[1] { -sigma } else { sigma };
            let end = passage.inputs(passage.to, &trial);
            let there = model.step(&passage.start(&trial, swing), passage.to.t_s, &end)?;
            add_square(&mut carried.noise, [there.load - base.load, there.rate - base.rate], 1.0);
        }
        let of_impact = IMPACT * states[swing.rate];
        add_square(&mut carried.noise, [self.half_s() * of_impact, of_impact], 1.0);
        Some(())
    }
}

/// Adds the variance of an error `along` times `sigma`.
fn add_square(noise: &mut [f64; 3], along: [f64; 2], sigma: f64) {
    let [load, rate] = along.map(|along| along * sigma);
    noise.iter_mut().zip([load * load, load * rate, rate * rate]).for_each(|(to, more)| *to += more);
}

/// Inputs of a motion at a reading without noise; an obstacle that is not known is absent.
pub(crate) fn moving_inputs(
    setup: &Setup,
    at: &Measurement,
    states: &Vector,
    is_open: bool,
) -> [f64; MAX_INPUTS] {
    let mut inputs = setup.inputs_at(at, &setup.without_noise(states));
    if let (true, Some(gap)) = (is_open, setup.gap) {
        inputs[gap] = f64::INFINITY;
    }
    inputs
}

/// Largest gap that a reading without contact excludes; for a body that moves, at the least advanced of its likely positions.
pub(crate) fn excluded_gap_mm(
    setup: &Setup,
    covariance: &Symmetric,
    inputs: &[f64; MAX_INPUTS],
    model: &mut impl Model,
) -> f64 {
    let mut onset_mm = |inputs: &[f64; MAX_INPUTS]| model.onset_gap_mm(inputs).unwrap_or(f64::NEG_INFINITY);
    let (Some(swing), Some(load)) = (setup.swing, setup.load_input()) else { return onset_mm(inputs) };
    let reach = EXCLUDING_SIGMAS * covariance.get(swing.load, swing.load).sqrt();
    let [mut less, mut more] = [*inputs; 2];
    (less[load], more[load]) = (less[load] - reach, more[load] + reach);
    onset_mm(&less).min(onset_mm(&more))
}

impl CarriedMotion {
    /// Covariance at the reading.
    pub(crate) fn spread(&self, swing: &Swing, covariance: &mut Symmetric) {
        let places = [swing.load, swing.rate];
        let with = self.by.map(|by| covariance.times(&by));
        let along = |a: usize, b: usize| self.by[a].iter().zip(&with[b]).map(|(x, y)| x * y).sum::<f64>();
        let [load, both, rate] = self.noise;
        let own = [along(0, 0) + load, along(0, 1) + both, along(1, 1) + rate];
        for (place, with) in places.iter().zip(&with) {
            for (other, value) in with.iter().enumerate().take(covariance.size()) {
                if !places.contains(&other) {
                    covariance.set(*place, other, *value);
                    covariance.set(other, *place, *value);
                }
            }
        }
        covariance.set(swing.load, swing.load, own[0]);
        covariance.set(swing.load, swing.rate, own[1]);
        covariance.set(swing.rate, swing.load, own[1]);
        covariance.set(swing.rate, swing.rate, own[2]);
    }

    /// Errors of load and rate at the reading, from errors of the unknowns before and a difference of the first measured input.
    pub(crate) fn errors(&self, before: &Vector, difference: f64) -> [f64; 2] {
        let error = |k: usize| {
            let carried: f64 = self.by[k].iter().zip(before).map(|(by, s)| by * s).sum();
            carried + self.drive[k] * difference
        };
        [error(0), error(1)]
    }
}
