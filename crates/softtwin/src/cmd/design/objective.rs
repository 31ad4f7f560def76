//! Objectives of a design: a force, a point at a place, a largest stress.

use crate::failure::usage;
use rom::evaluation::Evaluation;
use rom::evaluator::Query;
use rom::goal::Residual;
use rom::inputs::{Inputs, MAX_INPUTS};
use rom::model::{Model, Selection};
use rom::model_state::ModelState;
use rom::probe::{MeshPoint, ProbePosition, Probes};
use std::str::FromStr;

/// A force is met within this, N.
const FORCE_N: f64 = 1e-4;
/// A place is met within this, mm.
const PLACE_MM: f64 = 0.01;
/// A stress is kept within this, MPa.
const STRESS_MPA: f64 = 1e-4;
/// Step of the differences of the largest stress, as a fraction of an input's range: its node may change, so it has no other slope.
const STRESS_STEP: f64 = 1e-3;

/// One objective of the command line.
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
                let at = point.split(',').map(number).collect::<Result<Vec<f64>, _>>()?;
                Ok(Self::Place(axis, at.try_into().map_err(|_| expected())?, value))
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

/// The model as the objectives see it.
pub struct Goals<'a> {
    objectives: &'a [Objective],
    evaluator: rom::evaluator::Evaluator,
    evaluation: Evaluation,
    probes: Probes,
    /// Residuals of points and force only.
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
    ) -> anyhow::Result<Self> {
        let points = objectives.iter().filter_map(|objective| match objective {
            Objective::Place(_, at, _) => Some(MeshPoint::at(model, *at)),
            _ => None,
        });
        let points =
            points.collect::<Result<Vec<_>, _>>().map_err(|error| usage(format!("--objective: {error}")))?;
        let evaluator = rom::evaluator::Evaluator::new(&model.header)?;
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
        let one = |(objective, (value, gradient)): (&Objective, (f64, [f64; MAX_INPUTS]))| {
            let missed = objective.missed(value);
            let tolerance = match objective {
                Objective::Force(_) => FORCE_N,
                Objective::Place(..) => PLACE_MM,
                Objective::Stress(_) => STRESS_MPA,
            };
            let kept = matches!(objective, Objective::Stress(_)) && missed == 0.0;
            Residual { value: missed, tolerance, gradient: if kept { [0.0; MAX_INPUTS] } else { gradient } }
        };
        Some(self.objectives.iter().zip(values).map(one).collect())
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
    let mut at = |inputs: Inputs| Some(f64::from(whole.update(inputs).ok()?.stress_mpa?.value));
    let mut gradient = [0.0; MAX_INPUTS];
    for (input, [low, high]) in within {
        let step = STRESS_STEP * (high - low);
        let value = inputs.values()[*input];
        let (above, below) = (at(inputs.with(*input, value + step))?, at(inputs.with(*input, value - step))?);
        gradient[*input] = (above - below) / (2.0 * step);
    }
    Some((at(inputs)?, gradient))
}

/// Objectives that ask for one quantity twice cannot both be met.
pub fn check(objectives: &[Objective]) -> anyhow::Result<()> {
    let names: Vec<String> = objectives.iter().map(|objective| objective.target().0).collect();
    match names.iter().enumerate().find(|(i, name)| names[..*i].contains(name)) {
        Some((_, name)) => Err(usage(format!("--objective: {name} is given twice; give one target"))),
        None => Ok(()),
    }
}
