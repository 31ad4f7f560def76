//! Observables: quantities of the deformed shape that benches measure, such as a bending angle, from the positions of a few points.
//!
//! With `x_k` the deformed position of point `k`, `n` the unit axis and `phi(v)` the angle of `v` in the plane normal to `n`:
//!
//! ```text
//! section_angle   sum_j phi(s_j+1) - phi(s_j), minus its value of the undeformed shape; section j: s_j = x_2j+1 - x_2j
//! chord_angle     phi(x_1 - x_0), minus its value of the undeformed shape
//! curvature       2 n . (x_1 - x_0) x (x_2 - x_1) / (|x_1 - x_0| |x_2 - x_1| |x_2 - x_0|): of the circle through three points
//! length          sum_k |x_k+1 - x_k|
//! position        n . x_0
//! volume          of closed chambers: -1/3 sum of x . n dA over their walls (`volume.rs`)
//! ```
//!
//! Angles count right-handed about `n` and lie between -180 and 180 degrees from one section to the next. Each coordinate is affine
//! in the modal coefficients (Eq. 6 of the paper); those few rows are kept, so that no block of coordinates is needed. The half-width is
//! `f sum_k |dq/dx_k|` times the displacement's. The factor `f` is the conformal quantile of the ratio of the observable's leave-one-out
//! errors to that bound. A [`Correction`] adds a measured difference; that of the modes ([`crate::difference`]) is part of the shape, and its
//! part of the half-width has no factor.

mod correction;
mod definition;
mod item;
mod volume;

pub use correction::Correction;
pub use definition::{Definition, ObservableKind, PointSpec};

use crate::affine::Affine;
use crate::body::VolumeForm;
use crate::evaluation::Evaluation;
use crate::inputs::MAX_INPUTS;
use crate::model::{BlockKind, Model, ModelError, ModelFileError, ModelHeader, RegimeModel};
use crate::probe::{MeshPoint, affine_coordinate};
use crate::snapshots::RegimeKind;
use crate::statistics::quantile;
use crate::vector::norm;
use item::{Item, Shape, Source, wrapped};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use volume::Walls;

/// Most observables of a model.
pub const MAX_OBSERVABLES: usize = 8;
/// Value of an observable.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observed {
    /// In the unit at the end of its name.
    pub value: f64,
    /// Half-width in the same unit.
    pub halfwidth: f64,
    /// Part of the value that is a measured difference from the finite elements, of the modes (of volumes to first order) and of the
    /// [`Correction`]; 0 without one.
    pub offset: f64,
}

/// Value of an observable of the deformed shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OfShape {
    /// In the unit at the end of its name.
    pub value: f64,
    /// `sum_k |dq/dx_k|`.
    pub reach: f64,
    /// Part of the value that comes from the modes' measured difference.
    pub offset: f64,
}

/// Observables of a model; of most models none.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Observables {
    items: Vec<Item>,
    regimes: Vec<OfRegime>,
    /// Measured differences, with the number of the observable.
    corrections: Vec<(usize, Correction)>,
}

/// Data from which the observables of one regime are computed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct OfRegime {
    kind: RegimeKind,
    /// Rows of the points' coordinates.
    rows: Vec<Affine>,
    volumes: Vec<VolumeForm>,
    /// Factor of each half-width.
    factors: Vec<f64>,
}

/// Definitions on the mesh of a model.
pub struct OnMesh {
    items: Vec<Item>,
    points: Vec<MeshPoint>,
    walls: Vec<Walls>,
}

impl OnMesh {
    /// The definitions; the model's undeformed mesh must be loaded.
    ///
    /// # Errors
    /// Every definition that does not suit the model, with its name.
    pub fn new(model: &Model, definitions: &BTreeMap<String, Definition>) -> Result<Self, Vec<String>> {
        let mut found = Self { items: Vec::new(), points: Vec::new(), walls: Vec::new() };
        let mut problems = Vec::new();
        if definitions.len() > MAX_OBSERVABLES {
            problems
                .push(format!("expected at most {MAX_OBSERVABLES} observables, found {}", definitions.len()));
        }
        for (name, definition) in definitions {
            match Item::new(model, name, definition, found.points.len(), found.walls.len()) {
                Ok((item, source)) => {
                    found.items.push(item);
                    match source {
                        Source::Points(places) => found.points.extend(places),
                        Source::Chambers(walls) => found.walls.push(walls),
                    }
                }
                Err(reason) => problems.push(format!("{name}: {reason}")),
            }
        }
        if problems.is_empty() { Ok(found) } else { Err(problems) }
    }

    /// How many.
    pub fn count(&self) -> usize {
        self.items.len()
    }

    /// Value of one for a shape, and the sum of `|dq/dx_k|`.
    pub fn measure(&self, observable: usize, node: impl Fn(usize) -> [f64; 3]) -> (f64, f64) {
        let item = &self.items[observable];
        if let Some(volume) = item.volume() {
            let place = |corner: u32| node(corner as usize);
            let walls = &self.walls[volume];
            return (walls.volume_mm3(place), walls.area_mm2(place));
        }
        let shape = Shape::of(&self.points[item.points()], node);
        let (value, by) = item.measure(&shape);
        (item.beyond_rest(value), by.iter().take(item.points().len()).map(|by| norm(*by)).sum())
    }

    /// Difference of two values of one: of chord angles the smaller one.
    pub fn difference(&self, observable: usize, a: f64, b: f64) -> f64 {
        if self.items[observable].kind == ObservableKind::ChordAngle { wrapped(a - b) } else { a - b }
    }

    /// The observables of the model, whose coordinates must be loaded. `ratios`: by regime and observable the ratios of leave-one-out errors
    /// to the bound, at this coverage; without them the factors are 1.
    ///
    /// # Errors
    /// Coordinates that the model does not have; a volume with too many modes.
    pub fn reduced(
        self,
        model: &Model,
        ratios: &[(RegimeKind, Vec<Vec<f64>>)],
        coverage: f64,
    ) -> Result<Observables, Vec<String>> {
        let of_regime = |regime: &RegimeModel| -> Result<OfRegime, String> {
            let axes = self.points.iter().flat_map(|point| [0, 1, 2].map(|axis| (point, axis)));
            let rows: Result<Vec<Affine>, ModelError> =
                axes.map(|(point, axis)| affine_coordinate(model, regime, point, axis)).collect();
            let known = ratios.iter().find(|(kind, _)| *kind == regime.kind).map(|(_, ratios)| ratios);
            let factor = |index: usize| {
                let own = known.and_then(|known| known.get(index)).filter(|own| !own.is_empty());
                own.map_or(1.0, |own| quantile(own.clone(), coverage))
            };
            Ok(OfRegime {
                kind: regime.kind,
                rows: rows.map_err(|error| error.to_string())?,
                volumes: volume::forms(model, regime.kind, &self.walls)?,
                factors: (0..self.items.len()).map(factor).collect(),
            })
        };
        let regimes: Result<_, String> = model.header.regimes.iter().map(of_regime).collect();
        let regimes = regimes.map_err(|error| vec![error])?;
        Ok(Observables { items: self.items, regimes, corrections: Vec::new() })
    }
}

impl Observables {
    /// The observables of a trained model without leave-one-out errors; its coordinates and undeformed mesh must be loaded.
    ///
    /// # Errors
    /// Every definition that does not suit the model, with its name.
    pub fn define(model: &Model, definitions: &BTreeMap<String, Definition>) -> Result<Self, Vec<String>> {
        OnMesh::new(model, definitions)?.reduced(model, &[], 1.0)
    }

    /// The observables of a model file.
    ///
    /// # Errors
    /// [`ModelFileError::Header`] when they do not fit the model.
    pub fn of(model: &Model) -> Result<Self, ModelFileError> {
        let found: Self = model.record(BlockKind::Observables)?.unwrap_or_default();
        let problem = found.problem(&model.header);
        problem.map_or(Ok(found), |reason| Err(ModelFileError::Header(format!("observables: {reason}"))))
    }

    /// The first contradiction to the header.
    fn problem(&self, header: &ModelHeader) -> Option<String> {
        if self.items.is_empty() {
            return None;
        }
        let points = self.items.iter().map(|item| item.points().end).max().unwrap_or(0);
        let volumes = self.items.iter().filter_map(Item::volume).map(|volume| volume.saturating_add(1)).max();
        let finite =
            |item: &Item| item.rest.is_finite() && item.frame.as_flattened().iter().all(|v| v.is_finite());
        if self.items.len() > MAX_OBSERVABLES
            || !self.items.iter().all(|item| item.is_sound() && finite(item))
        {
            return Some("an item with other points than its kind takes".into());
        }
        for regime in &header.regimes {
            let name = regime.kind.name();
            let Some(own) = self.of_regime(regime.kind) else {
                return Some(format!("no rows of the {name} regime"));
            };
            let count = regime.groups.iter().map(|group| group.coefficients.end).max().unwrap_or(0);
            let fits = |row: &Affine| {
                row.first.saturating_add(row.weights.len()) <= count
                    && row.mean.is_finite()
                    && row.weights.iter().all(|w| w.is_finite())
            };
            if own.rows.len() < points.saturating_mul(3)
                || !own.rows.iter().all(fits)
                || own.volumes.len() < volumes.unwrap_or(0)
                || !own.volumes.iter().all(|form| form.fits(count))
                || own.factors.len() != self.items.len()
            {
                return Some(format!("rows of the {name} regime that its coefficients do not have"));
            }
        }
        let known =
            |(index, correction): &(usize, Correction)| *index < self.items.len() && correction.is_sound();
        (!self.corrections.iter().all(known)).then(|| "a difference of no observable".into())
    }

    /// Names, in order.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.items.iter().map(|item| item.name.as_str())
    }

    /// Units, in order.
    pub fn units(&self) -> impl Iterator<Item = &'static str> {
        self.items.iter().map(|item| item.kind.unit())
    }

    /// How many.
    pub fn count(&self) -> usize {
        self.items.len()
    }

    /// Adds the observables of the same model.
    pub fn append(&mut self, other: Self) {
        let (points, volumes) =
            (self.regimes.first()).map_or((0, 0), |regime| (regime.rows.len() / 3, regime.volumes.len()));
        let before = self.items.len();
        for mut item in other.items {
            item.shift(points, volumes);
            self.items.push(item);
        }
        for theirs in other.regimes {
            match self.regimes.iter_mut().find(|own| own.kind == theirs.kind) {
                Some(own) => {
                    own.rows.extend(theirs.rows);
                    own.volumes.extend(theirs.volumes);
                    own.factors.extend(theirs.factors);
                }
                None => self.regimes.push(theirs),
            }
        }
        self.corrections
            .extend(other.corrections.into_iter().map(|(index, correction)| (before + index, correction)));
    }

    /// Sets the measured difference of an observable in a regime.
    pub fn correct(&mut self, observable: usize, correction: Correction) {
        self.corrections
            .retain(|(corrected, known)| *corrected != observable || known.regime != correction.regime);
        self.corrections.push((observable, correction));
    }

    /// The measured differences, with the number of the observable.
    pub fn corrections(&self) -> &[(usize, Correction)] {
        &self.corrections
    }

    /// Removes all measured differences.
    pub fn clear_corrections(&mut self) {
        self.corrections.clear();
    }

    /// The volumes of chambers in a regime.
    pub(crate) fn volumes(&self, regime: RegimeKind) -> &[VolumeForm] {
        self.of_regime(regime).map_or(&[], |regime| &regime.volumes)
    }

    /// Value of one of an evaluation with modal coefficients; NaN where the model was not trained in its regime. Allocates nothing.
    pub fn value(&self, observable: usize, evaluation: &Evaluation) -> Observed {
        let factor = self.of_regime(evaluation.regime).and_then(|regime| regime.factors.get(observable));
        let Some((OfShape { value, reach, offset }, factor)) =
            self.of_shape(observable, evaluation).zip(factor)
        else {
            return Observed { value: f64::NAN, halfwidth: f64::NAN, offset: 0.0 };
        };
        let (all_mm, own_mm) = (evaluation.halfwidths.displacement_mm, evaluation.difference_mm);
        let halfwidth = if all_mm.is_nan() {
            f64::NAN
        } else if own_mm > 0.0 {
            let of_model_mm = (all_mm * all_mm - own_mm * own_mm).max(0.0).sqrt();
            reach * (factor * of_model_mm).hypot(own_mm)
        } else {
            factor * reach * all_mm
        };
        let Some(correction) = self.correction(observable, evaluation.regime) else {
            return Observed { value, halfwidth, offset };
        };
        let (further, share) = correction.at(&evaluation.inputs);
        let halfwidth = correction.halfwidth(share, halfwidth);
        Observed { value: value + further, halfwidth, offset: offset + further }
    }

    /// Value of the shape, without [`Correction`]s.
    pub fn of_shape(&self, observable: usize, evaluation: &Evaluation) -> Option<OfShape> {
        let difference = evaluation.coefficient_difference();
        if let Some(form) = self.form(observable, evaluation) {
            let value = form.value(&evaluation.coefficients, None);
            let offset = match difference {
                [] => 0.0,
                along => form.value(&evaluation.coefficients, Some(along)),
            };
            return Some(OfShape { value, reach: form.area_mm2, offset });
        }
        let mut shape = Shape::new();
        let item = self.shape(observable, evaluation, &[], &mut shape)?;
        let (value, by) = item.measure(&shape);
        let reach: f64 = by.iter().take(shape.count).map(|by| norm(*by)).sum();
        let mut offset = 0.0;
        if !difference.is_empty() {
            self.shape(observable, evaluation, difference, &mut shape)?;
            let plain = item.measure(&shape).0;
            let is_chord = item.kind == ObservableKind::ChordAngle;
            offset = if is_chord { wrapped(value - plain) } else { value - plain };
        }
        Some(OfShape { value: item.beyond_rest(value), reach, offset })
    }

    /// Derivative of the shape's value along a direction of the coefficients; `None` where it has no value.
    pub fn along(&self, observable: usize, evaluation: &Evaluation, direction: &[f64]) -> Option<f64> {
        if let Some(form) = self.form(observable, evaluation) {
            return Some(form.value(&evaluation.coefficients, Some(direction)));
        }
        let mut shape = Shape::new();
        let item = self.shape(observable, evaluation, &[], &mut shape)?;
        let (_, by) = item.measure(&shape);
        let rows = self.rows(item, evaluation.regime).iter().zip(by.as_flattened());
        Some(rows.map(|(row, by)| by * row.change(direction)).sum())
    }

    /// Derivatives of one with respect to each input, of an evaluation with gradients. Allocates nothing.
    pub fn gradient(&self, observable: usize, evaluation: &Evaluation) -> [f64; MAX_INPUTS] {
        let mut gradient = self.shape_gradient(observable, evaluation);
        if let Some(correction) = self.correction(observable, evaluation.regime) {
            let own = correction.gradient(evaluation);
            gradient.iter_mut().zip(own).for_each(|(to, own)| *to += own);
        }
        gradient
    }

    fn shape_gradient(&self, observable: usize, evaluation: &Evaluation) -> [f64; MAX_INPUTS] {
        let along = |input| Some(evaluation.coefficient_gradient(input)).filter(|along| !along.is_empty());
        if let Some(form) = self.form(observable, evaluation) {
            let by = |input| along(input).map_or(0.0, |by| form.value(&evaluation.coefficients, Some(by)));
            return std::array::from_fn(by);
        }
        let mut shape = Shape::new();
        let Some(item) = self.shape(observable, evaluation, &[], &mut shape) else {
            return [f64::NAN; MAX_INPUTS];
        };
        let (_, by) = item.measure(&shape);
        let rows = self.rows(item, evaluation.regime).as_chunks::<3>().0;
        std::array::from_fn(|input| {
            let Some(along) = along(input) else { return 0.0 };
            rows.iter().flatten().zip(by.as_flattened()).map(|(row, by)| by * row.change(along)).sum()
        })
    }

    fn of_regime(&self, regime: RegimeKind) -> Option<&OfRegime> {
        self.regimes.iter().find(|known| known.kind == regime)
    }

    fn correction(&self, observable: usize, regime: RegimeKind) -> Option<&Correction> {
        let mut own = self.corrections.iter().filter(|(corrected, _)| *corrected == observable);
        own.find(|(_, correction)| correction.regime == regime).map(|(_, correction)| correction)
    }

    fn form(&self, observable: usize, evaluation: &Evaluation) -> Option<&VolumeForm> {
        let volume = self.items.get(observable)?.volume()?;
        let regime = self.of_regime(evaluation.regime).filter(|_| !evaluation.coefficients.is_empty())?;
        regime.volumes.get(volume)
    }

    fn rows(&self, item: &Item, regime: RegimeKind) -> &[Affine] {
        let points = item.points();
        let rows = self.of_regime(regime).map(|regime| &regime.rows);
        rows.and_then(|rows| rows.get(3 * points.start..3 * points.end)).unwrap_or(&[])
    }

    /// Deformed points, without a part of the coefficients unless it is empty.
    fn shape(
        &self,
        observable: usize,
        evaluation: &Evaluation,
        without: &[f64],
        shape: &mut Shape,
    ) -> Option<&Item> {
        let item = self.items.get(observable)?;
        let rows = self.rows(item, evaluation.regime).as_chunks::<3>().0;
        if evaluation.coefficients.is_empty() || rows.is_empty() {
            return None;
        }
        for (to, axes) in shape.points.iter_mut().zip(rows) {
            let change = |row: &Affine| row.change(&evaluation.coefficients) - row.change(without);
            *to = [0, 1, 2].map(|axis| axes[axis].mean + change(&axes[axis]));
        }
        shape.count = rows.len();
        Some(item)
    }
}
