//! Inputs that reach a goal, such as a force or a point at a place: bounded least squares on the model's gradients, from several starts.
//!
//! Residuals are divided by their tolerances, inputs scaled to [0, 1] between their bounds. The first start is the caller's, the
//! others fill the bounds evenly.

use crate::evaluation::Evaluation;
use crate::evaluator::{Evaluator, Query};
use crate::inputs::{Inputs, MAX_INPUTS};
use crate::least_squares::{Residuals, Search, minimise, square};
use crate::model::{Model, ModelError, Selection};
use crate::model_state::ModelState;
use crate::probe::{MeshPoint, PointError, ProbePosition, Probes};
use std::str::FromStr;

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
pub struct Solution {
    /// The inputs.
    pub inputs: Inputs,
    /// Residuals of the goal there.
    pub residuals: Vec<Residual>,
    /// Evaluations of the model.
    pub evaluations: usize,
}

impl Solution {
    /// True if every part is met to its tolerance.
    pub fn is_met(&self) -> bool {
        self.residuals.iter().all(|r| r.value.abs() <= r.tolerance)
    }
}

/// Changes the inputs at `within` (position, low, high) until the residuals that `residuals_at` gives are met; `start` holds the others. `None`
/// if it returns `None` at every start. Cost: about ten calls of it if the first start succeeds, some hundreds if none does.
pub fn reach(
    within: &[(usize, [f64; 2])],
    start: Inputs,
    residuals_at: &mut dyn FnMut(Inputs) -> Option<Vec<Residual>>,
) -> Option<Solution> {
    let mut evaluations = 0;
    let mut best: Option<(f64, Inputs, Vec<Residual>)> = None;
    let scaled_start =
        within.iter().map(|(input, [low, high])| (start.values()[*input] - low) / (high - low));
    let first: Vec<f64> = scaled_start.map(|x| x.clamp(0.0, 1.0)).collect();
    for number in 0..STARTS {
        // Golden ratios of one, two, ... dimensions: points of a sequence that fills the bounds.
        let root = |k: usize| (k as f64 + 2.0).sqrt();
        let share = |k: usize| (0.5 + number as f64 * root(k)).fract();
        let x = if number == 0 { first.clone() } else { (0..within.len()).map(share).collect() };
        let mut goal = Goal {
            within,
            start,
            residuals_at: &mut *residuals_at,
            evaluations: &mut evaluations,
            here: Vec::new(),
        };
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
    best.map(|(_, inputs, residuals)| Solution { inputs, residuals, evaluations })
}

struct Goal<'a> {
    within: &'a [(usize, [f64; 2])],
    start: Inputs,
    residuals_at: &'a mut dyn FnMut(Inputs) -> Option<Vec<Residual>>,
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
        let residuals = (self.residuals_at)(inputs)?;
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

/// A force is met within this, N.
const FORCE_N: f64 = 1e-4;
/// A place is met within this, mm.
const PLACE_MM: f64 = 0.01;
/// A stress is kept within this, MPa.
const STRESS_MPA: f64 = 1e-4;
/// Step of the differences of the largest stress, as a fraction of an input's range: its node may change, so it has no other slope.
const STRESS_STEP: f64 = 1e-3;

/// What a design is asked for.
#[derive(Clone, Debug, PartialEq)]
pub enum Objective {
    /// `force_n=0.3`.
    Force(f64),
    /// `y_mm@100,0,16=-20`: coordinate (0 to 2) of the point with these undeformed coordinates, target in mm.
    Place(usize, [f64; 3], f64),
    /// `max_von_mises_mpa<=0.3`.
    Stress(f64),
}

impl FromStr for Objective {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let expected = || {
            format!(
                "expected force_n=VALUE, x_mm|y_mm|z_mm@X,Y,Z=VALUE with the point's undeformed coordinates, or \
                 max_von_mises_mpa<=VALUE; found {text:?}"
            )
        };
        let (name, value) = text.split_once('=').ok_or_else(expected)?;
        let number =
            |text: &str| text.trim().parse::<f64>().ok().filter(|v| v.is_finite()).ok_or_else(expected);
        let value = number(value)?;
        match name.split_once('@') {
            None if name == "force_n" && value >= 0.0 => Ok(Self::Force(value)),
            None if name == "max_von_mises_mpa<" && value > 0.0 => Ok(Self::Stress(value)),
            Some((axis, point)) => {
                let axis =
                    ["x_mm", "y_mm", "z_mm"].iter().position(|name| *name == axis).ok_or_else(expected)?;
                let point_mm = point.split(',').map(number).collect::<Result<Vec<f64>, _>>()?;
                Ok(Self::Place(axis, point_mm.try_into().map_err(|_| expected())?, value))
            }
            None => Err(expected()),
        }
    }
}

impl Objective {
    /// Name, target and unit as the report has them.
    pub fn target(&self) -> (String, f64, &'static str) {
        match self {
            Self::Force(target) => ("force_n".into(), *target, "N"),
            Self::Place(axis, [x, y, z], target) => {
                (format!("{}_mm@{x},{y},{z}", ["x", "y", "z"][*axis]), *target, "mm")
            }
            Self::Stress(limit) => ("max_von_mises_mpa".into(), *limit, "MPa"),
        }
    }

    /// How far a value misses the objective; 0 where a limit is kept.
    pub fn missed(&self, value: f64) -> f64 {
        match self {
            Self::Force(target) | Self::Place(_, _, target) => value - target,
            Self::Stress(limit) => (value - limit).max(0.0),
        }
    }
}

/// Why a model cannot be asked for the objectives.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // the messages say what the values are
pub enum GoalError {
    /// Objectives that ask for one quantity twice cannot both be met.
    #[error("{0} is given twice; give one target")]
    Twice(String),
    #[error(transparent)]
    Point(#[from] PointError),
    #[error(transparent)]
    Model(#[from] ModelError),
}

/// The model as the objectives see it.
pub struct Goals<'a> {
    objectives: &'a [Objective],
    evaluator: Evaluator,
    evaluation: Evaluation,
    probes: Probes,
    /// The evaluation that the probes fill.
    at_points: Evaluation,
    positions: Vec<ProbePosition>,
    /// Only where an objective is a stress: it needs all nodes.
    whole: Option<ModelState>,
    /// Inputs that may change, with their bounds.
    within: &'a [(usize, [f64; 2])],
}

impl<'a> Goals<'a> {
    /// Takes what it needs of the model.
    pub fn new(
        model: &Model,
        objectives: &'a [Objective],
        within: &'a [(usize, [f64; 2])],
    ) -> Result<Self, GoalError> {
        let names: Vec<String> = objectives.iter().map(|objective| objective.target().0).collect();
        if let Some((_, name)) = names.iter().enumerate().find(|(i, name)| names[..*i].contains(name)) {
            return Err(GoalError::Twice(name.clone()));
        }
        let points = objectives.iter().filter_map(|objective| match objective {
            Objective::Place(_, at, _) => Some(MeshPoint::at(model, *at)),
            _ => None,
        });
        let points = points.collect::<Result<Vec<_>, _>>()?;
        let evaluator = Evaluator::new(&model.header)?;
        let probes = Probes::new(model, &points)?;
        let stress = objectives.iter().any(|objective| matches!(objective, Objective::Stress(_)));
        let whole = stress.then(|| ModelState::new(model, &Selection::default())).transpose()?;
        Ok(Self {
            objectives,
            evaluation: evaluator.evaluation(),
            evaluator,
            positions: vec![ProbePosition::default(); points.len()],
            at_points: probes.evaluation(),
            probes,
            whole,
            within,
        })
    }

    /// The model's values of the objectives at some inputs, with their derivatives; `None` if it has no answer.
    pub fn values(&mut self, inputs: Inputs) -> Option<Vec<(f64, [f64; MAX_INPUTS])>> {
        self.probes.answer(inputs, Query::GRADIENTS, &mut self.at_points, &mut self.positions);
        let mut positions = self.positions.iter();
        let mut all = Vec::with_capacity(self.objectives.len());
        for objective in self.objectives {
            all.push(match objective {
                Objective::Force(_) => (self.at_points.contact_force_n, self.at_points.force_gradient),
                Objective::Place(axis, ..) => {
                    let point = positions.next()?;
                    (point.position_mm[*axis], point.gradient[*axis])
                }
                Objective::Stress(_) => stress(self.whole.as_mut()?, self.within, inputs)?,
            });
        }
        all.iter().all(|(value, _)| value.is_finite()).then_some(all)
    }

    /// Residuals of the objectives at some inputs.
    pub fn residuals(&mut self, inputs: Inputs) -> Option<Vec<Residual>> {
        let values = self.values(inputs)?;
        let residual = |(objective, (value, gradient)): (&Objective, (f64, [f64; MAX_INPUTS]))| {
            let missed = objective.missed(value);
            let tolerance = match objective {
                Objective::Force(_) => FORCE_N,
                Objective::Place(..) => PLACE_MM,
                Objective::Stress(_) => STRESS_MPA,
            };
            let kept = matches!(objective, Objective::Stress(_)) && missed == 0.0;
            Residual { value: missed, tolerance, gradient: if kept { [0.0; MAX_INPUTS] } else { gradient } }
        };
        Some(self.objectives.iter().zip(values).map(residual).collect())
    }

    /// Which inputs of the last evaluation are outside the training range, and by how much.
    pub fn outside(&self) -> Option<String> {
        self.evaluator.outside(&self.evaluation)
    }

    /// The evaluation at some inputs.
    pub fn evaluation(&mut self, inputs: Inputs) -> &Evaluation {
        self.evaluator.evaluate(inputs, &mut self.evaluation);
        &self.evaluation
    }
}

/// Largest stress and its differences by the inputs that may change.
fn stress(
    whole: &mut ModelState,
    within: &[(usize, [f64; 2])],
    inputs: Inputs,
) -> Option<(f64, [f64; MAX_INPUTS])> {
    let mut largest_stress = |inputs: Inputs| Some(f64::from(whole.update(inputs).ok()?.stress_mpa?.value));
    let mut gradient = [0.0; MAX_INPUTS];
    for (input, [low, high]) in within {
        let step = STRESS_STEP * (high - low);
        let value = inputs.values()[*input];
        let (above, below) = (
            largest_stress(inputs.with(*input, value + step))?,
            largest_stress(inputs.with(*input, value - step))?,
        );
        gradient[*input] = (above - below) / (2.0 * step);
    }
    Some((largest_stress(inputs)?, gradient))
}
