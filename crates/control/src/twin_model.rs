//! A trained model as the controller sees it: force and one observable, or one coordinate of a point, with their gradients, in one pass.

use crate::inverse::{Model, Point, Quantity};
use rom::evaluation::Evaluation;
use rom::evaluator::{Evaluator, Query};
use rom::inputs::{GAP, Inputs, PRESSURE};
use rom::model::{ModelError, ModelFileError};
use rom::observable::Observables;
use rom::probe::{MeshPoint, PointError, ProbePosition, Probes, model_tip};
use rom::snapshots::RegimeKind;

/// Force and observable of a model.
#[derive(Debug)]
pub struct TwinModel {
    held: ObservableSource,
    evaluation: Evaluation,
    /// Inputs other than pressure and gap; NaN: the model's default.
    inputs: Inputs,
    /// The pressure along which it is evaluated, among the inputs.
    driven: usize,
    /// Positions of the inputs that the model has.
    taken: Vec<usize>,
    range_mpa: [f64; 2],
    observable_grows: bool,
}

#[derive(Debug)]
enum ObservableSource {
    /// A coordinate of a point.
    Point { probes: Box<Probes>, position: Box<[ProbePosition; 1]>, axis: usize },
    /// One of the model's observables.
    Observable { evaluator: Box<Evaluator>, observables: Observables, at: usize },
}

/// A point of the undeformed mesh, mm, and the axis (0, 1, 2: x, y, z) that is followed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tip {
    /// Undeformed coordinates, mm.
    pub at_mm: [f64; 3],
    pub axis: usize,
}

impl Tip {
    /// The middle of the free end of the reference actuator's base, up and down.
    pub const REFERENCE: Self = Self { at_mm: [115.0, 2.0, 16.0], axis: 1 };
}

/// The vertical axis.
const Y: usize = 1;

/// A gap that no actuator closes, mm.
pub const OUT_OF_REACH_MM: f64 = 1e4;

/// Why a model cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum TwinModelError {
    #[error(transparent)]
    Model(#[from] ModelError),
    #[error("tip: {0}")]
    Point(#[from] PointError),
    #[error(transparent)]
    Observables(#[from] ModelFileError),
    #[error(
        "the model's memory: expected a line with two time constants, found an orifice, which no control law inverts; set control.line and use a model without memory"
    )]
    Orifice,
    /// An observable that the model does not have.
    #[error("expected an observable of the model ({}), found `{found}`", if .known.is_empty() { "it has none".into() } else { .known.join(", ") })]
    NoObservable { found: String, known: Vec<String> },
}

impl TwinModel {
    /// Takes a point of a model by its undeformed coordinates.
    ///
    /// # Errors
    /// [`TwinModelError`]: no such point, or blocks that were not loaded.
    pub fn new(model: &rom::model::Model, tip: Tip) -> Result<Self, TwinModelError> {
        Self::of_point(model, &MeshPoint::at(model, tip.at_mm)?, tip.axis)
    }

    /// Takes a point of a model and the axis (0, 1, 2: x, y, z) that is followed. The model's parameters have the defaults of its
    /// header.
    ///
    /// # Errors
    /// [`TwinModelError`]: blocks that were not loaded.
    pub fn of_point(
        model: &rom::model::Model,
        point: &MeshPoint,
        axis: usize,
    ) -> Result<Self, TwinModelError> {
        let probes = Probes::new(model, std::slice::from_ref(point))?;
        let evaluation = probes.evaluation();
        let position = Box::new([ProbePosition::default()]);
        let held = ObservableSource::Point { probes: Box::new(probes), position, axis: axis.min(2) };
        Ok(Self::of_held(model, held, evaluation))
    }

    /// Takes an observable of a model by its name.
    ///
    /// # Errors
    /// [`TwinModelError`]: no such observable, or a header that contradicts itself.
    pub fn of_observable(model: &rom::model::Model, name: &str) -> Result<Self, TwinModelError> {
        let observables = Observables::of(model)?;
        let position = observables.names().position(|known| known == name);
        let position = position.ok_or_else(|| TwinModelError::NoObservable {
            found: name.to_owned(),
            known: observables.names().map(str::to_owned).collect(),
        })?;
        let evaluator = Evaluator::new(&model.header)?.for_search();
        let evaluation = evaluator.evaluation();
        let held = ObservableSource::Observable { evaluator: Box::new(evaluator), observables, at: position };
        Ok(Self::of_held(model, held, evaluation))
    }

    /// Takes what a column of targets names: `force_n`, `pressure_mpa`, `tip_y_mm` (height of `marker`, or the model's observable of that
    /// name, or the height of its tip), or an observable.
    ///
    /// # Errors
    /// [`TwinModelError`]: no such observable, or blocks that were not loaded.
    pub fn of_column(
        model: &rom::model::Model,
        column: &str,
        marker: Option<&MeshPoint>,
    ) -> Result<(Quantity, Self), TwinModelError> {
        let of_node = |node: usize| Self::of_point(model, &MeshPoint::node(model, node as u32)?, Y);
        // Force and pressure need no point: any will do.
        Ok(match (column, marker) {
            ("force_n", _) => (Quantity::Force, of_node(0)?),
            ("pressure_mpa", _) => (Quantity::Pressure, of_node(0)?),
            ("tip_y_mm", Some(point)) => (Quantity::Observable, Self::of_point(model, point, Y)?),
            // A model that defines its tip is held there, another one at the middle of its end face.
            ("tip_y_mm", None) if !Observables::of(model)?.names().any(|name| name == column) => {
                (Quantity::Observable, of_node(model_tip(model).unwrap_or(0))?)
            }
            (name, _) => (Quantity::Observable, Self::of_observable(model, name)?),
        })
    }

    fn of_held(model: &rom::model::Model, held: ObservableSource, evaluation: Evaluation) -> Self {
        let range_mpa = model.header.inputs[PRESSURE].range;
        let inputs = Inputs::new(f64::NAN, f64::NAN);
        let taken = model.header.taken_inputs().map(|(index, _)| index).collect();
        let driven = PRESSURE;
        Self { held, evaluation, inputs, driven, taken, range_mpa, observable_grows: false }.with_direction()
    }

    fn with_direction(mut self) -> Self {
        let [first, last] =
            self.range_mpa.map(|pressure_mpa| self.at(pressure_mpa, OUT_OF_REACH_MM).observable);
        self.observable_grows = last > first;
        self
    }

    /// Evaluates along the pressure of another cavity, at position `input` of the model's inputs. The others have their lowest value until
    /// [`Self::set_inputs`].
    pub(crate) fn driven_by(mut self, input: usize, model: &rom::model::Model) -> Self {
        if input == self.driven {
            return self;
        }
        self.inputs = self.inputs.with(PRESSURE, self.range_mpa[0]);
        (self.driven, self.range_mpa) = (input, model.header.inputs[input].range);
        self.with_direction()
    }

    /// The pressure along which it is evaluated, among the model's inputs.
    pub fn driven(&self) -> usize {
        self.driven
    }

    /// Sets the inputs for the evaluations that follow from those of a state: the inputs that the model has, in its order; NaN: the
    /// default; of another cavity's `pressure_mpa` the value before. The driven pressure and the gap are those of each evaluation.
    pub fn set_inputs(&mut self, values: &[f64]) {
        let of_state = self.taken.iter().zip(values);
        for (index, value) in of_state.filter(|(index, value)| **index != PRESSURE || !value.is_nan()) {
            self.inputs = self.inputs.with(*index, *value);
        }
    }
}

impl Model for TwinModel {
    fn at(&mut self, pressure_mpa: f64, gap_mm: f64) -> Point {
        let inputs = self.inputs.with(self.driven, pressure_mpa).with(GAP, gap_mm);
        let (observable, observable_by_pressure) = match &mut self.held {
            ObservableSource::Point { probes, position, axis } => {
                probes.answer(inputs, Query::GRADIENTS, &mut self.evaluation, position.as_mut_slice());
                let [point] = position.as_ref();
                (point.position_mm[*axis], point.gradient[*axis][self.driven])
            }
            ObservableSource::Observable { evaluator, observables, at } => {
                evaluator.answer(inputs, Query::GRADIENTS, &mut self.evaluation);
                let by = observables.gradient(*at, &self.evaluation);
                (observables.value(*at, &self.evaluation).value, by[self.driven])
            }
        };
        Point {
            force_n: self.evaluation.contact_force_n,
            force_by_pressure: self.evaluation.force_gradient[self.driven],
            observable,
            observable_by_pressure,
            onset_mpa: match (self.evaluation.onset_pressure_mpa, self.evaluation.regime) {
                (Some(onset_mpa), _) if self.driven == PRESSURE => onset_mpa,
                (_, RegimeKind::Contact) => 0.0,
                (_, RegimeKind::Free) => f64::INFINITY,
            },
        }
    }

    fn range_mpa(&self) -> [f64; 2] {
        self.range_mpa
    }

    fn observable_grows(&self) -> bool {
        self.observable_grows
    }
}
