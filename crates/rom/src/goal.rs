//! Inputs that reach a goal: bounded least squares on the model's gradients, from several starts.
//!
//! Residuals `r_i(x)` over their tolerances, inputs scaled to [0, 1] between their bounds: damped Gauss-Newton steps
//! `(J^T J + l I) s = -J^T r` over the inputs that do not press against a bound. The damping keeps the answer near its start where
//! the goal leaves inputs open. The first start is the caller's, the others fill the bounds evenly.

use crate::dense::Dense;
use crate::inputs::{Inputs, MAX_INPUTS};

/// Steps from each start.
const STEPS: usize = 80;
/// Starts.
const STARTS: usize = 12;
/// Damping at a start, and where a start is given up.
const DAMPING: [f64; 2] = [1e-3, 1e9];
/// A sum of squares below this is met to rounding.
const MET: f64 = 1e-8;

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
/// if `at` returns `None` at every start. Cost: at most 960 calls of `at`, about ten if the first start succeeds.
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
        let mut descent = Descent { within, start, at: &mut *at, evaluations: &mut evaluations };
        if let Some(found) = descent.run(x)
            && best.as_ref().is_none_or(|(square, ..)| found.0 < *square)
        {
            best = Some(found);
        }
        if best.as_ref().is_some_and(|(square, ..)| *square <= MET) {
            break;
        }
    }
    best.map(|(_, inputs, residuals)| Found { inputs, residuals, evaluations })
}

struct Descent<'a> {
    within: &'a [(usize, [f64; 2])],
    start: Inputs,
    at: &'a mut dyn FnMut(Inputs) -> Option<Vec<Residual>>,
    evaluations: &'a mut usize,
}

/// Sum of squares over the tolerances.
fn square(residuals: &[Residual]) -> f64 {
    residuals.iter().map(|r| (r.value / r.tolerance).powi(2)).sum()
}

impl Descent<'_> {
    fn inputs(&self, x: &[f64]) -> Inputs {
        let with_input = |inputs: Inputs, ((input, [low, high]), x): (&(usize, [f64; 2]), &f64)| {
            inputs.with(*input, (low + x * (high - low)).clamp(*low, *high))
        };
        self.within.iter().zip(x).fold(self.start, with_input)
    }

    fn run(&mut self, mut x: Vec<f64>) -> Option<(f64, Inputs, Vec<Residual>)> {
        let evaluate = |own: &mut Self, x: &[f64]| {
            let inputs = own.inputs(x);
            *own.evaluations += 1;
            (own.at)(inputs).map(|residuals| (square(&residuals), residuals))
        };
        let mut here = evaluate(self, &x)?;
        let [mut damping, most] = DAMPING;
        for _ in 0..STEPS {
            if here.0 <= MET || damping > most {
                break;
            }
            let Some(trial) = self.step(&x, &here.1, damping) else { break };
            match evaluate(self, &trial).filter(|next| next.0 < here.0) {
                Some(next) => {
                    (x, here) = (trial, next);
                    damping *= 0.2;
                }
                None => damping *= 5.0,
            }
        }
        Some((here.0, self.inputs(&x), here.1))
    }

    /// Inputs after a step; `None` if every input is at a bound that stops it.
    fn step(&self, x: &[f64], residuals: &[Residual], damping: f64) -> Option<Vec<f64>> {
        let by = |r: &Residual, k: usize| {
            let (input, [low, high]) = self.within[k];
            r.gradient[input] * (high - low) / r.tolerance
        };
        let downhill =
            |k: usize| -> f64 { -residuals.iter().map(|r| by(r, k) * r.value / r.tolerance).sum::<f64>() };
        let is_open = |k: &usize| match x[*k] {
            x if x <= 0.0 => downhill(*k) > 0.0,
            x if x >= 1.0 => downhill(*k) < 0.0,
            _ => true,
        };
        let open: Vec<usize> = (0..x.len()).filter(is_open).collect();
        if open.is_empty() {
            return None;
        }
        let product =
            |i: usize, j: usize| residuals.iter().map(|r| by(r, open[i]) * by(r, open[j])).sum::<f64>();
        let mut normal = Dense::from_fn(open.len(), product);
        let largest = (0..open.len()).map(|i| normal[(i, i)]).fold(f64::MIN_POSITIVE, f64::max);
        (0..open.len()).for_each(|i| normal[(i, i)] += damping * largest);
        let mut step: Vec<f64> = open.iter().map(|k| downhill(*k)).collect();
        normal.solve(&mut step, 1)?;
        let mut trial = x.to_vec();
        open.iter().enumerate().for_each(|(i, k)| trial[*k] = (trial[*k] + step[i]).clamp(0.0, 1.0));
        Some(trial)
    }
}
