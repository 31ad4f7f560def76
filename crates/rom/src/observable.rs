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
//! ```
//!
//! Angles count right-handed about `n` and lie between -180 and 180 degrees from one section to the next. Each coordinate is affine
//! in the modal coefficients (Eq. 6 of the paper); those few rows are kept, so that no block of coordinates is needed. The half-width is
//! `sum_k |dq/dx_k|` times the displacement's: a bound where no point is off by more than that.

use crate::evaluation::Evaluation;
use crate::inputs::MAX_INPUTS;
use crate::model::{BlockKind, Model, ModelError, ModelFileError, ModelHeader};
use crate::probe::{MeshPoint, PointError};
use crate::snapshots::RegimeKind;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Most observables of a model.
pub const MAX_OBSERVABLES: usize = 8;
/// Most points of one observable.
const MAX_POINTS: usize = 32;
/// Square of the sine below which a vector lies along the axis and has no angle.
const ALONG_AXIS: f64 = 1e-12;
/// Axis of an angle that is not given: a finger that bends down, towards `-y`, has a positive angle.
const DOWNWARDS: [f64; 3] = [0.0, 0.0, -1.0];

/// Quantity that is computed of the points.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ObservableKind {
    /// Angle from the first section to the last, degrees; two points for each section.
    SectionAngle,
    /// Angle of the line between two points, degrees.
    ChordAngle,
    /// Curvature of the circle through three points, 1/mm.
    Curvature,
    /// Length of the line through the points, mm.
    Length,
    /// Coordinate of a point along the axis, mm.
    Position,
}

impl ObservableKind {
    /// End of the name: the unit.
    pub const fn suffix(self) -> &'static str {
        match self {
            Self::SectionAngle | Self::ChordAngle => "_deg",
            Self::Curvature => "_per_mm",
            Self::Length | Self::Position => "_mm",
        }
    }

    /// The unit.
    pub const fn unit(self) -> &'static str {
        match self {
            Self::SectionAngle | Self::ChordAngle => "deg",
            Self::Curvature => "1/mm",
            Self::Length | Self::Position => "mm",
        }
    }

    fn takes(self, points: usize) -> bool {
        match self {
            Self::SectionAngle => points >= 4 && points.is_multiple_of(2),
            Self::ChordAngle => points == 2,
            Self::Curvature => points == 3,
            Self::Length => points >= 2,
            Self::Position => points == 1,
        }
    }

    const fn expected(self) -> &'static str {
        match self {
            Self::SectionAngle => "two points for each section, at least two sections",
            Self::ChordAngle => "two points",
            Self::Curvature => "three points",
            Self::Length => "at least two points",
            Self::Position => "one point",
        }
    }
}

/// A point of a definition.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Place {
    /// Undeformed coordinates, mm.
    At([f64; 3]),
    /// A node.
    Node(u32),
    /// Mean of a node set.
    Set(String),
}

/// Definition of an observable in a training configuration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Definition {
    /// Quantity.
    pub kind: ObservableKind,
    /// Its points.
    pub points: Vec<Place>,
    /// Axis of an angle or a curvature (left out: `[0, 0, -1]`), direction of a position.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub axis: Option<[f64; 3]>,
}

/// Value of an observable.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observed {
    /// In the unit at the end of its name.
    pub value: f64,
    /// Half-width in the same unit.
    pub halfwidth: f64,
}

/// Observables of a model; of most models none.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Observables {
    items: Vec<Item>,
    /// Rows of the points' coordinates, by regime.
    regimes: Vec<(RegimeKind, Vec<Row>)>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Item {
    name: String,
    kind: ObservableKind,
    /// First of its points, and their number.
    points: [usize; 2],
    /// Two unit vectors normal to the axis, and the axis.
    frame: [[f64; 3]; 3],
    /// Value of the undeformed shape, which is subtracted.
    rest: f64,
}

/// A coordinate: mean and weights of some of the coefficients.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Row {
    mean: f64,
    first: usize,
    weights: Vec<f64>,
}

impl Observables {
    /// The observables of a trained model; its coordinates and undeformed mesh must be loaded.
    ///
    /// # Errors
    /// Every definition that does not suit the model, with its name.
    pub fn define(model: &Model, definitions: &BTreeMap<String, Definition>) -> Result<Self, Vec<String>> {
        let (mut items, mut points, mut problems) = (Vec::new(), Vec::new(), Vec::new());
        if definitions.len() > MAX_OBSERVABLES {
            problems
                .push(format!("expected at most {MAX_OBSERVABLES} observables, found {}", definitions.len()));
        }
        for (name, definition) in definitions {
            match Item::new(model, name, definition, points.len()) {
                Ok((item, places)) => {
                    items.push(item);
                    points.extend(places);
                }
                Err(reason) => problems.push(format!("{name}: {reason}")),
            }
        }
        if !problems.is_empty() {
            return Err(problems);
        }
        let rows = |regime: &crate::model::RegimeModel| {
            let axes = points.iter().flat_map(|point| [0, 1, 2].map(|axis| (point, axis)));
            let rows: Result<Vec<Row>, ModelError> =
                axes.map(|(point, axis)| Row::new(model, regime, point, axis)).collect();
            rows.map(|rows| (regime.kind, rows))
        };
        let regimes: Result<_, _> = model.header.regimes.iter().map(rows).collect();
        Ok(Self { items, regimes: regimes.map_err(|error| vec![error.to_string()])? })
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
        let points = self.items.iter().map(|item| item.points[0].saturating_add(item.points[1])).max()?;
        let sound = |item: &Item| item.kind.takes(item.points[1]) && item.points[1] <= MAX_POINTS;
        let finite =
            |item: &Item| item.rest.is_finite() && item.frame.as_flattened().iter().all(|v| v.is_finite());
        if self.items.len() > MAX_OBSERVABLES || !self.items.iter().all(|item| sound(item) && finite(item)) {
            return Some("an item with other points than its kind takes".into());
        }
        for regime in &header.regimes {
            let Some((_, rows)) = self.regimes.iter().find(|(kind, _)| *kind == regime.kind) else {
                return Some(format!("no rows of the {} regime", regime.kind.name()));
            };
            let count = regime.groups.iter().map(|group| group.coefficients.end).max().unwrap_or(0);
            let fits = |row: &Row| {
                row.first.saturating_add(row.weights.len()) <= count
                    && row.mean.is_finite()
                    && row.weights.iter().all(|w| w.is_finite())
            };
            if rows.len() < 3 * points || !rows.iter().all(fits) {
                return Some(format!(
                    "rows of the {} regime that its coefficients do not have",
                    regime.kind.name()
                ));
            }
        }
        None
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

    /// Value of one of an evaluation with modal coefficients; NaN where the model was not trained in its regime. Allocates nothing.
    pub fn value(&self, at: usize, evaluation: &Evaluation) -> Observed {
        let mut shape = Shape::new();
        let Some(item) = self.shape(at, evaluation, &mut shape) else {
            return Observed { value: f64::NAN, halfwidth: f64::NAN };
        };
        let (value, by) = item.measure(&shape);
        let reach: f64 = by.iter().take(shape.count).map(|by| norm(*by)).sum();
        let change = value - item.rest;
        let is_chord = item.kind == ObservableKind::ChordAngle;
        let value = if is_chord { wrapped(change) } else { change };
        Observed { value, halfwidth: reach * evaluation.halfwidths.displacement_mm }
    }

    /// Derivatives of one with respect to each input, of an evaluation with gradients. Allocates nothing.
    pub fn gradient(&self, at: usize, evaluation: &Evaluation) -> [f64; MAX_INPUTS] {
        let mut shape = Shape::new();
        let Some(item) = self.shape(at, evaluation, &mut shape) else { return [f64::NAN; MAX_INPUTS] };
        let (_, by) = item.measure(&shape);
        let rows = self.rows(item, evaluation.regime).as_chunks::<3>().0;
        std::array::from_fn(|input| {
            let along = evaluation.coefficient_gradient(input);
            let axes = rows.iter().flatten().zip(by.as_flattened());
            axes.filter(|_| !along.is_empty()).map(|(row, by)| by * row.change(along)).sum()
        })
    }

    fn rows(&self, item: &Item, regime: RegimeKind) -> &[Row] {
        let [first, count] = item.points;
        let rows = self.regimes.iter().find(|(kind, _)| *kind == regime);
        rows.and_then(|(_, rows)| rows.get(3 * first..3 * (first + count))).unwrap_or(&[])
    }

    fn shape(&self, at: usize, evaluation: &Evaluation, shape: &mut Shape) -> Option<&Item> {
        let item = self.items.get(at)?;
        let rows = self.rows(item, evaluation.regime).as_chunks::<3>().0;
        if evaluation.coefficients.is_empty() || rows.is_empty() {
            return None;
        }
        for (to, axes) in shape.points.iter_mut().zip(rows) {
            *to = [0, 1, 2].map(|axis| axes[axis].mean + axes[axis].change(&evaluation.coefficients));
        }
        shape.count = rows.len();
        Some(item)
    }
}

impl Row {
    fn new(
        model: &Model,
        regime: &crate::model::RegimeModel,
        point: &MeshPoint,
        axis: u8,
    ) -> Result<Self, ModelError> {
        let (mean, group, weights) = crate::probe::coordinate(model, regime, point, axis)?;
        let first = regime.groups.get(group).map_or(0, |group| group.coefficients.start);
        Ok(Self { mean, first, weights })
    }

    fn change(&self, coefficients: &[f64]) -> f64 {
        let own = coefficients.get(self.first..).unwrap_or(&[]);
        self.weights.iter().zip(own).map(|(weight, a)| weight * a).sum()
    }
}

/// Points of one observable.
struct Shape {
    points: [[f64; 3]; MAX_POINTS],
    count: usize,
}

impl Shape {
    const fn new() -> Self {
        Self { points: [[0.0; 3]; MAX_POINTS], count: 0 }
    }

    fn vector(&self, from: usize, to: usize) -> [f64; 3] {
        [0, 1, 2].map(|axis| self.points[to][axis] - self.points[from][axis])
    }
}

/// Derivatives of a value with respect to the points.
type ByPoint = [[f64; 3]; MAX_POINTS];

impl Item {
    fn new(
        model: &Model,
        name: &str,
        definition: &Definition,
        first: usize,
    ) -> Result<(Self, Vec<MeshPoint>), String> {
        let Definition { kind, points, axis } = definition;
        if !name.ends_with(kind.suffix()) {
            return Err(format!("expected a name with the unit at its end, `...{}`", kind.suffix()));
        }
        if !kind.takes(points.len()) || points.len() > MAX_POINTS {
            return Err(format!("expected {}, found {}", kind.expected(), points.len()));
        }
        let axis = match (axis, kind) {
            (None, ObservableKind::Position) => {
                return Err("expected axis = [x, y, z], the direction of the position".into());
            }
            (axis, _) => axis.unwrap_or(DOWNWARDS),
        };
        let length = norm(axis);
        if !(length.is_finite() && length > 0.0) {
            return Err(format!("axis: expected a direction, found {axis:?}"));
        }
        let places: Result<Vec<MeshPoint>, PointError> = points.iter().map(|place| place.on(model)).collect();
        let places = places.map_err(|error| error.to_string())?;
        let mut item = Self {
            name: name.to_owned(),
            kind: *kind,
            points: [first, places.len()],
            frame: frame(axis.map(|v| v / length)),
            rest: 0.0,
        };
        if matches!(kind, ObservableKind::SectionAngle | ObservableKind::ChordAngle) {
            let mesh = [0, 1, 2].map(|axis| model.f32_block(BlockKind::Undeformed(axis)));
            let [Some(x), Some(y), Some(z)] = mesh else { return Err(PointError::NoMesh.to_string()) };
            let mut shape = Shape::new();
            for (to, place) in shape.points.iter_mut().zip(&places) {
                *to = [x, y, z]
                    .map(|axis| place.weights.iter().map(|(n, w)| w * f64::from(axis[*n as usize])).sum());
            }
            shape.count = places.len();
            item.rest = item.measure(&shape).0;
            if !item.rest.is_finite() {
                return Err(
                    "a section or chord of the undeformed shape lies along the axis; choose other points"
                        .into(),
                );
            }
        }
        Ok((item, places))
    }

    /// Value and derivatives.
    fn measure(&self, shape: &Shape) -> (f64, ByPoint) {
        let mut by = [[0.0; 3]; MAX_POINTS];
        let value = match self.kind {
            ObservableKind::SectionAngle => self.section_angle(shape, &mut by),
            ObservableKind::ChordAngle => {
                let (angle, along) = self.angle(shape.vector(0, 1));
                add(&mut by, 0, 1, along, 1.0);
                angle
            }
            ObservableKind::Curvature => self.curvature(shape, &mut by),
            ObservableKind::Length => {
                let mut length = 0.0;
                for at in 1..shape.count {
                    let step = shape.vector(at - 1, at);
                    let own = norm(step);
                    add(&mut by, at - 1, at, step.map(|v| v / own), 1.0);
                    length += own;
                }
                length
            }
            ObservableKind::Position => {
                by[0] = self.frame[2];
                dot(self.frame[2], shape.points[0])
            }
        };
        (value, by)
    }

    /// Angle of a vector in the plane normal to the axis, degrees, and its derivatives; NaN for a vector along the axis.
    fn angle(&self, v: [f64; 3]) -> (f64, [f64; 3]) {
        let [t1, t2, _] = self.frame;
        let (x, y) = (dot(v, t1), dot(v, t2));
        let square = x * x + y * y;
        if square <= ALONG_AXIS * dot(v, v) {
            return (f64::NAN, [f64::NAN; 3]);
        }
        let scale = square.recip().to_degrees();
        (y.atan2(x).to_degrees(), [0, 1, 2].map(|k| scale * (x * t2[k] - y * t1[k])))
    }

    fn section_angle(&self, shape: &Shape, by: &mut ByPoint) -> f64 {
        let mut sum = 0.0;
        let (mut last, mut last_by) = self.angle(shape.vector(0, 1));
        for section in 1..shape.count / 2 {
            let at = 2 * section;
            let (angle, angle_by) = self.angle(shape.vector(at, at + 1));
            sum += wrapped(angle - last);
            add(by, at, at + 1, angle_by, 1.0);
            add(by, at - 2, at - 1, last_by, -1.0);
            (last, last_by) = (angle, angle_by);
        }
        sum
    }

    fn curvature(&self, shape: &Shape, by: &mut ByPoint) -> f64 {
        let (a, b, c) = (shape.vector(0, 1), shape.vector(1, 2), shape.vector(0, 2));
        let n = self.frame[2];
        let [la, lb, lc] = [a, b, c].map(norm);
        let scale = 2.0 / (la * lb * lc);
        let value = scale * dot(n, cross(a, b));
        // n . a x b = a . b x n = b . n x a; the lengths by the logarithm.
        let by_a: [f64; 3] = [0, 1, 2].map(|k| scale * cross(b, n)[k] - value * a[k] / (la * la));
        let by_b: [f64; 3] = [0, 1, 2].map(|k| scale * cross(n, a)[k] - value * b[k] / (lb * lb));
        let by_c: [f64; 3] = c.map(|v| -value * v / (lc * lc));
        add(by, 0, 1, by_a, 1.0);
        add(by, 1, 2, by_b, 1.0);
        add(by, 0, 2, by_c, 1.0);
        value
    }
}

impl Place {
    fn on(&self, model: &Model) -> Result<MeshPoint, PointError> {
        match self {
            Self::At(at_mm) => MeshPoint::at(model, *at_mm),
            Self::Node(node) => MeshPoint::node(model, *node),
            Self::Set(name) => MeshPoint::of_set(model, name),
        }
    }
}

/// The same direction between -180 and 180 degrees.
fn wrapped(angle_deg: f64) -> f64 {
    (angle_deg + 180.0).rem_euclid(360.0) - 180.0
}

/// Adds the derivatives of a function of `x_to - x_from`.
fn add(by: &mut ByPoint, from: usize, to: usize, along: [f64; 3], factor: f64) {
    for (axis, value) in along.into_iter().enumerate() {
        by[to][axis] += factor * value;
        by[from][axis] -= factor * value;
    }
}

/// A right-handed frame whose third vector is the given unit vector.
fn frame(n: [f64; 3]) -> [[f64; 3]; 3] {
    let least = if n[0].abs() <= n[1].abs() && n[0].abs() <= n[2].abs() {
        [1.0, 0.0, 0.0]
    } else if n[1].abs() <= n[2].abs() {
        [0.0, 1.0, 0.0]
    } else {
        [0.0, 0.0, 1.0]
    };
    let t1 = cross(least, n);
    let length = norm(t1);
    let t1 = t1.map(|v| v / length);
    [t1, cross(n, t1), n]
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn norm(a: [f64; 3]) -> f64 {
    dot(a, a).sqrt()
}
