//! Measured observables of a scene.

use crate::config::ActuatorSpec;
use estimate::Predicted;
use rom::evaluation::Evaluation;
use rom::evaluator::Evaluator;
use rom::inputs::{InputSpec, Inputs};
use rom::model::{Model, ModelError};
use rom::observable::Observables;
use rom::snapshots::FieldKind;

/// The measured observables of a scene with the whole coefficients that they are computed of.
#[derive(Debug, Clone)]
pub(super) struct Observed {
    pub(super) evaluator: Evaluator,
    pub(super) evaluation: Evaluation,
    observables: Observables,
    /// Positions of the measured ones, in the order of the scene.
    which: Vec<usize>,
}

/// Positions of a scene's measured observables among the names that its model has.
///
/// # Errors
/// Observables that the model does not have.
pub(crate) fn measured_observables<'a>(
    spec: &ActuatorSpec,
    known: impl Iterator<Item = &'a str>,
) -> Result<Vec<usize>, Vec<String>> {
    let known: Vec<&str> = known.collect();
    let (mut which, mut problems) = (Vec::new(), Vec::new());
    for name in spec.observables.keys() {
        match known.iter().position(|known| known == name) {
            Some(at) => which.push(at),
            None => problems.push(format!(
                "observables.{name}: expected an observable or a scalar output of the model ({}), found no such quantity",
                known.join(", ")
            )),
        }
    }
    if problems.is_empty() { Ok(which) } else { Err(problems) }
}

impl Observed {
    /// `None` if the scene measures no observable.
    ///
    /// # Errors
    /// Observables that the model does not have.
    pub(super) fn new(spec: &ActuatorSpec, model: &Model) -> Result<Option<Self>, Vec<String>> {
        if spec.observables.is_empty() {
            return Ok(None);
        }
        let fail = |error: &dyn std::fmt::Display| vec![format!("model: {error}")];
        let observables = Observables::of(model).map_err(|error| fail(&error))?;
        let which = measured_observables(spec, observables.names())?;
        let mut evaluator = Evaluator::new(&model.header).map_err(|error: ModelError| fail(&error))?;
        let fields = model.header.fields.iter().enumerate();
        let coordinates = fields.filter(|(_, field)| matches!(field.spec.kind, FieldKind::Coordinate(_)));
        evaluator = evaluator.for_search();
        evaluator.restrict(&coordinates.map(|(index, _)| index).collect::<Vec<_>>());
        Ok(Some(Self { evaluation: evaluator.evaluation(), evaluator, observables, which }))
    }

    /// The largest half-width of a measured observable along the ranges of the inputs.
    pub(super) fn largest_halfwidth(&mut self, measured: usize, model: &Model) -> f64 {
        let inputs = &model.header.inputs;
        let value = |spec: &InputSpec, part: f64| spec.range[0] + part * (spec.range[1] - spec.range[0]);
        let state = |part: f64| {
            let start = Inputs::new(f64::NAN, f64::INFINITY);
            let ranged =
                inputs.iter().enumerate().filter(|(_, spec)| spec.range.iter().all(|end| end.is_finite()));
            ranged.fold(start, |state, (input, spec)| state.with(input, value(spec, part)))
        };
        let mut largest = 0.0_f64;
        for part in [0.0, 0.25, 0.5, 0.75, 1.0] {
            self.evaluator.evaluate(state(part), &mut self.evaluation);
            let width = self
                .which
                .get(measured)
                .map(|observable| self.observables.value(*observable, &self.evaluation).halfwidth);
            largest = largest.max(width.filter(|width| width.is_finite()).unwrap_or(0.0));
        }
        largest
    }

    /// Values and derivatives at the last evaluated state.
    pub(super) fn read(&self, out: &mut [Predicted]) {
        for (to, at) in out.iter_mut().zip(&self.which) {
            to.value = self.observables.value(*at, &self.evaluation).value;
            to.gradient = self.observables.gradient(*at, &self.evaluation);
        }
    }
}
