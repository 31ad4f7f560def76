//! Values of observables at points, and their derivatives.

use super::definition::{DOWNWARDS, Definition, MAX_POINTS, ObservableKind};
use super::volume::Walls;
use crate::model::Model;
use crate::probe::{MeshPoint, PointError};
use crate::vector::{Vec3, cross, dot, norm, sub};
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Square of the sine below which a vector lies along the axis and has no angle.
const ALONG_AXIS: f64 = 1e-12;

/// Some of the points of all observables that follow each other; of a volume the number of volumes before it, and no points. A model stores
/// the pair, and the equations in Python read it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(from = "[usize; 2]", into = "[usize; 2]")]
struct ItemPoints {
    first: usize,
    count: usize,
}

impl From<[usize; 2]> for ItemPoints {
    fn from([first, count]: [usize; 2]) -> Self {
        Self { first, count }
    }
}

impl From<ItemPoints> for [usize; 2] {
    fn from(ItemPoints { first, count }: ItemPoints) -> Self {
        [first, count]
    }
}

impl ItemPoints {
    /// The first of the points behind these.
    fn end(self) -> usize {
        self.first.saturating_add(self.count)
    }
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Item {
    pub name: String,
    pub kind: ObservableKind,
    /// See [`Item::points`] and [`Item::volume`].
    points: ItemPoints,
    /// Two unit vectors normal to the axis, and the axis.
    pub frame: [Vec3; 3],
    /// Value of the undeformed shape, which is subtracted.
    pub rest: f64,
}

/// Data from which an observable is computed.
pub(super) enum Source {
    Points(Vec<MeshPoint>),
    Chambers(Walls),
}

/// Points of one observable.
pub(super) struct Shape {
    pub points: [Vec3; MAX_POINTS],
    pub count: usize,
}

impl Shape {
    pub const fn new() -> Self {
        Self { points: [[0.0; 3]; MAX_POINTS], count: 0 }
    }

    /// Weighted means of nodes.
    pub fn of(places: &[MeshPoint], node: impl Fn(usize) -> Vec3) -> Self {
        let mut shape = Self::new();
        for (to, place) in shape.points.iter_mut().zip(places) {
            for (index, weight) in &place.weights {
                to.iter_mut().zip(node(*index as usize)).for_each(|(to, x)| *to += weight * x);
            }
        }
        shape.count = places.len();
        shape
    }

    fn vector(&self, from: usize, to: usize) -> Vec3 {
        sub(self.points[to], self.points[from])
    }
}

/// Derivatives of a value with respect to the points.
pub(super) type ByPoint = [Vec3; MAX_POINTS];

impl Item {
    /// The observable and its source; `first` is the number of points before it, `volumes` that of volumes.
    pub fn new(
        model: &Model,
        name: &str,
        definition: &Definition,
        first: usize,
        volumes: usize,
    ) -> Result<(Self, Source), String> {
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
        let frame = frame(axis.map(|v| v / length));
        let item_points = ItemPoints { first, count: places.len() };
        let mut item = Self { name: name.to_owned(), kind: *kind, points: item_points, frame, rest: 0.0 };
        if *kind == ObservableKind::Volume {
            item.points = ItemPoints { first: volumes, count: 0 };
            return Ok((item, Source::Chambers(Walls::of(model, &places)?)));
        }
        if matches!(kind, ObservableKind::SectionAngle | ObservableKind::ChordAngle) {
            let mesh = model.undeformed_mm().ok_or_else(|| PointError::NoMesh.to_string())?;
            item.rest = item.measure(&Shape::of(&places, |node| mesh.map(|axis| f64::from(axis[node])))).0;
            if !item.rest.is_finite() {
                return Err(
                    "a section or chord of the undeformed shape lies along the axis; choose other points"
                        .into(),
                );
            }
        }
        Ok((item, Source::Points(places)))
    }

    /// Its points among those of all observables; none of a volume.
    pub fn points(&self) -> Range<usize> {
        if self.kind == ObservableKind::Volume { 0..0 } else { self.points.first..self.points.end() }
    }

    /// Which volume it is; `None` for an observable of points.
    pub fn volume(&self) -> Option<usize> {
        (self.kind == ObservableKind::Volume).then_some(self.points.first)
    }

    /// Moves it behind points and volumes of other observables.
    pub fn shift(&mut self, points: usize, volumes: usize) {
        self.points.first += if self.kind == ObservableKind::Volume { volumes } else { points };
    }

    /// True if it has as many points as its kind takes.
    pub fn is_sound(&self) -> bool {
        self.kind.takes(self.points.count) && self.points.count <= MAX_POINTS
    }

    /// Value of an observable of points: the measured one minus that of the undeformed shape.
    pub fn beyond_rest(&self, value: f64) -> f64 {
        let change = value - self.rest;
        if self.kind == ObservableKind::ChordAngle { wrapped(change) } else { change }
    }

    /// Value and derivatives.
    pub fn measure(&self, shape: &Shape) -> (f64, ByPoint) {
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
            ObservableKind::Volume => f64::NAN, // of its walls, see `VolumeForm`
        };
        (value, by)
    }

    /// Angle of a vector in the plane normal to the axis, degrees, and its derivatives; NaN for a vector along the axis.
    fn angle(&self, v: Vec3) -> (f64, Vec3) {
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
            let first = 2 * section;
            let (angle, angle_by) = self.angle(shape.vector(first, first + 1));
            sum += wrapped(angle - last);
            add(by, first, first + 1, angle_by, 1.0);
            add(by, first - 2, first - 1, last_by, -1.0);
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
        let by_a: Vec3 = [0, 1, 2].map(|k| scale * cross(b, n)[k] - value * a[k] / (la * la));
        let by_b: Vec3 = [0, 1, 2].map(|k| scale * cross(n, a)[k] - value * b[k] / (lb * lb));
        let by_c: Vec3 = c.map(|v| -value * v / (lc * lc));
        add(by, 0, 1, by_a, 1.0);
        add(by, 1, 2, by_b, 1.0);
        add(by, 0, 2, by_c, 1.0);
        value
    }
}

/// The same direction between -180 and 180 degrees.
pub(super) fn wrapped(angle_deg: f64) -> f64 {
    (angle_deg + 180.0).rem_euclid(360.0) - 180.0
}

/// Adds the derivatives of a function of `x_to - x_from`.
fn add(by: &mut ByPoint, from: usize, to: usize, along: Vec3, factor: f64) {
    for (axis, value) in along.into_iter().enumerate() {
        by[to][axis] += factor * value;
        by[from][axis] -= factor * value;
    }
}

/// A right-handed frame whose third vector is the given unit vector.
fn frame(n: Vec3) -> [Vec3; 3] {
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
