//! Inputs that reach a goal: bounded least squares on the model's gradients, from several starts.
//!
//! Residuals are divided by their tolerances, inputs scaled to [0, 1] between their bounds. The first start is the caller's, the others fill the bounds
//! evenly.

use crate::inputs::{Inputs, MAX_INPUTS};
use crate::least_squares::{Residuals, Search, minimise, square};

/// Starts.
const STARTS: usize = 12;
/// A sum of squares below this is met to rounding.
const MET: f64 = 1e-8;
/// Search from each start.
const SEARCH: Search = Search {
    steps: 80,
    tries: 18,
    damping: 1e-3,
    by_unknown: false,
    largest_change: f64::INFINITY,
    met: MET,
    least_decrease: 0.0,
};

/// One part of a goal at some inputs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Residual {
    /// Distance from the goal, in the goal's unit; 0 if a limit is kept.
    pub value: f64,
    /// Largest value that counts as met, in the same unit, > 0.
    pub tolerance: f64,
    /// Derivatives with respect to all inputs of the model.
    pub gradient: [f64; MAX_INPUTS],
}

/// The best inputs found.
#[derive(Clone, Debug, PartialEq)]
pub struct Found {
    /// The inputs.
    pub inputs: Inputs,
    /// Residuals of the goal there.
    pub residuals: Vec<Residual>,
    /// Evaluations of the model.
    pub evaluations: usize,
}

impl Found {
    /// True if every part is met to its tolerance.
    pub fn is_met(&self) -> bool {
        self.residuals.iter().all(|r| r.value.abs() <= r.tolerance)
    }
}

/// Changes the inputs at `within` (position, low, high) until the residuals that `at` gives are met; `start` holds the others. `None`
/// if `at` returns `None` at every start. Cost: about ten calls of `at` if the first start succeeds, some hundreds if none does.
pub fn reach(
    within: &[(usize, [f64; 2])],
    start: Inputs,
    at: &mut dyn FnMut(Inputs) -> Option<Vec<Residual>>,
) -> Option<Found> {
    let mut evaluations = 0;
    let mut best: Option<(f64, Inputs, Vec<Residual>)> = None;
    let own = within.iter().map(|(input, [low, high])| (start.values()[*input] - low) / (high - low));
    let first: Vec<f64> = own.map(|x| x.clamp(0.0, 1.0)).collect();
    for number in 0..STARTS {
        // Golden ratios of one, two, ... dimensions: points of a sequence that fills the bounds.
        let root = |k: usize| (k as f64 + 2.0).sqrt();
        let share = |k: usize| (0.5 + number as f64 * root(k)).fract();
        let x = if number == 0 { first.clone() } else { (0..within.len()).map(share).collect() };
        let mut goal = Goal { within, start, at: &mut *at, evaluations: &mut evaluations, here: Vec::new() };
        let Some(found) = minimise(&mut goal, &x, &SEARCH) else { continue };
        let sum = square(&found.residuals);
        if best.as_ref().is_none_or(|(least, ..)| sum < *least) {
            let inputs = goal.inputs(&found.unknowns);
            best = Some((sum, inputs, goal.here));
        }
        if best.as_ref().is_some_and(|(square, ..)| *square <= MET) {
            break;
        }
    }
    best.map(|(_, inputs, residuals)| Found { inputs, residuals, evaluations })
}

struct Goal<'a> {
    within: &'a [(usize, [f64; 2])],
    start: Inputs,
    at: &'a mut dyn FnMut(Inputs) -> Option<Vec<Residual>>,
    evaluations: &'a mut usize,
    /// Residuals at the best inputs so far.
    here: Vec<Residual>,
}

impl Goal<'_> {
    fn inputs(&self, x: &[f64]) -> Inputs {
        self.within.iter().zip(x).fold(self.start, |inputs, ((input, [low, high]), x)| {
            inputs.with(*input, (low + x * (high - low)).clamp(*low, *high))
        })
    }
}

fn over_tolerances(residuals: &[Residual]) -> Vec<f64> {
    residuals.iter().map(|r| r.value / r.tolerance).collect()
}

impl Residuals for Goal<'_> {
    fn at(&mut self, x: &[f64]) -> Option<Vec<f64>> {
        *self.evaluations += 1;
        let inputs = self.inputs(x);
        let residuals = (self.at)(inputs)?;
        let found = over_tolerances(&residuals);
        if self.here.is_empty() || square(&found) < square(&over_tolerances(&self.here)) {
            self.here = residuals;
        }
        Some(found)
    }

    fn jacobian(&mut self, _: &[f64], _: &[f64]) -> Option<Vec<Vec<f64>>> {
        let column = |(input, [low, high]): &(usize, [f64; 2])| {
            self.here.iter().map(|r| r.gradient[*input] * (high - low) / r.tolerance).collect()
        };
        Some(self.within.iter().map(column).collect())
    }

    fn bounds(&self, _: usize) -> [f64; 2] {
        [0.0, 1.0]
    }
}
