//! What is observed of an actuator: the place of its tip, and bending angles, by how much the section at the free end has turned about
//! an axis across the body, against the first section.
//!
//! `simulate` and `build` measure them on finite elements, a model as observables. Both go through the four nodes chosen here, so that a
//! pressure that `build` reports for 90 degrees gives 90 degrees in the model.

use crate::algebra::{cross, dot, sub};
use crate::family::Family;
use crate::mesh::EndFace;
use crate::problem::Problem;
use rom::observable::{Definition, ObservableKind, PointSpec};
use std::collections::BTreeMap;

/// Sections narrower than this fraction of the free length have no direction.
const NARROWEST: f64 = 1.0e-3;

/// One bending angle.
pub struct Bending {
    /// Name of the observable.
    pub name: &'static str,
    /// Low and high node of the first section, then of the last.
    nodes: [usize; 4],
    /// Axis of rotation, a unit vector.
    about: [f64; 3],
}

impl Bending {
    /// The bending angles of an actuator, the main one first: of a finger of boxes that of its base, of another shape those in the two
    /// planes through its axis. Empty where the end has no width.
    pub fn all(family: &Family) -> Vec<Self> {
        let problem = &family.problem;
        let Some(shape) = family.actuator.shape() else {
            let end = problem.mesh().end_face();
            // Downwards first, as for a finger; across an axis that is itself vertical, to the left first.
            let across = match end.axis {
                0 => [1, 2],
                1 => [0, 2],
                _ => [1, 0],
            };
            let named = ["bending_angle_deg", "side_angle_deg"].into_iter().zip(across);
            return named.filter_map(|(name, towards)| Self::across(problem, &end, name, towards)).collect();
        };
        // The front edges of the base: every mesh of boxes has nodes there.
        let (end_mm, top_mm) = (shape.base.length_mm, shape.base_top_mm());
        let points = [(0.0, 0.0), (0.0, top_mm), (end_mm, 0.0), (end_mm, top_mm)];
        let nodes = points.map(|(x, y)| nearest(problem, [x, shape.base_mm() + y, 0.0]));
        vec![Self { name: "bending_angle_deg", nodes, about: [0.0, 0.0, -1.0] }]
    }

    /// The angle by which the end turns towards lower values of a coordinate.
    fn across(problem: &Problem, end: &EndFace, name: &'static str, towards: usize) -> Option<Self> {
        let held = &problem.mesh().fixed_nodes;
        let narrowest_mm = NARROWEST * end.free_length_mm;
        let last = extremes(problem, &end.nodes, towards, narrowest_mm)?;
        let first = extremes(problem, held, towards, narrowest_mm)
            .or_else(|| extremes(problem, held, end.axis, narrowest_mm))?;
        // The axis of the body turns towards -towards: about the cross product of both.
        let (mut along, mut down) = ([0.0; 3], [0.0; 3]);
        (along[end.axis], down[towards]) = (end.sense, -1.0);
        Some(Self { name, nodes: [first[0], first[1], last[0], last[1]], about: cross(along, down) })
    }

    /// Definition of the observable.
    pub fn definition(&self, problem: &Problem) -> Definition {
        Definition {
            kind: ObservableKind::SectionAngle,
            points: self.nodes.map(|n| PointSpec::At(problem.mesh().nodes_mm[n])).to_vec(),
            axis: Some(self.about),
        }
    }

    /// The angle in a state, degrees, 0 in the undeformed one: of all its turns the one that is nearest to `near`.
    pub fn angle_deg(&self, problem: &Problem, u: &[[f64; 3]], near: f64) -> f64 {
        let turned = |moved: f64| {
            let [a, b, c, d] = self.nodes.map(|n| {
                let x = problem.mesh().nodes_mm[n];
                [0, 1, 2].map(|k| x[k] + moved * u[n][k])
            });
            let (first, last) = (sub(b, a), sub(d, c));
            let across = dot(first, last) - dot(first, self.about) * dot(last, self.about);
            dot(self.about, cross(first, last)).atan2(across)
        };
        let angle = (turned(1.0) - turned(0.0)).to_degrees();
        angle + 360.0 * ((near - angle) / 360.0).round()
    }
}

/// The lowest and the highest of some nodes along a coordinate; of several the one nearest to the middle, so that the section goes through
/// it. `None` where they are as good as level.
fn extremes(problem: &Problem, nodes: &[u32], axis: usize, narrowest_mm: f64) -> Option<[usize; 2]> {
    let places = &problem.mesh().nodes_mm;
    let place = |n: u32| places[n as usize];
    let middle =
        [0, 1, 2].map(|k| nodes.iter().map(|n| place(*n)[k]).sum::<f64>() / nodes.len().max(1) as f64);
    let off =
        |n: u32| -> f64 { (0..3).filter(|k| *k != axis).map(|k| (place(n)[k] - middle[k]).powi(2)).sum() };
    let level = |n: u32| place(n)[axis];
    let low_mm = nodes.iter().map(|n| level(*n)).fold(f64::INFINITY, f64::min);
    let high_mm = nodes.iter().map(|n| level(*n)).fold(f64::NEG_INFINITY, f64::max);
    if high_mm - low_mm <= narrowest_mm {
        return None;
    }
    let near = |level_mm: f64| {
        let at_level = nodes.iter().copied().filter(|n| (level(*n) - level_mm).abs() <= 0.1 * narrowest_mm);
        at_level.min_by(|a, b| off(*a).total_cmp(&off(*b))).map(|n| n as usize)
    };
    Some([near(low_mm)?, near(high_mm)?])
}

fn nearest(problem: &Problem, at_mm: [f64; 3]) -> usize {
    let places = &problem.mesh().nodes_mm;
    let square = |n: usize| -> f64 { dot(sub(places[n], at_mm), sub(places[n], at_mm)) };
    (0..places.len()).min_by(|a, b| square(*a).total_cmp(&square(*b))).unwrap_or(0)
}

/// Farthest that the nearest node may be from a point of an observable (mm), as the model's own limit is.
const NEAR_MM: f64 = 4.0;

/// Observables of every actuator: its bending angles and the place of its tip. Of a finger also the angle of its chord, in place of the
/// tip's z, and the volume of its chambers.
pub fn observables(family: &Family) -> BTreeMap<String, Definition> {
    let problem = &family.problem;
    let definition = |kind, points, axis| Definition { kind, points, axis };
    let mut all: BTreeMap<String, Definition> = Bending::all(family)
        .into_iter()
        .map(|bending| (bending.name.to_owned(), bending.definition(problem)))
        .collect();
    let shape = family.actuator.shape();
    let tip = match &shape {
        Some(shape) => PointSpec::At([shape.base.length_mm, shape.base_mm(), 0.0]),
        None => tip_place(family),
    };
    let axes = [("tip_x_mm", [1.0, 0.0, 0.0]), ("tip_y_mm", [0.0, 1.0, 0.0]), ("tip_z_mm", [0.0, 0.0, 1.0])];
    for (name, axis) in axes.into_iter().take(if shape.is_some() { 2 } else { 3 }) {
        all.insert(name.into(), definition(ObservableKind::Position, vec![tip.clone()], Some(axis)));
    }
    if let Some(shape) = shape {
        let chord = vec![PointSpec::At([0.0, shape.base_mm(), 0.0]), tip];
        all.insert("chord_angle_deg".into(), definition(ObservableKind::ChordAngle, chord, None));
        all.insert("chamber_volume_mm3".into(), definition(ObservableKind::Volume, Vec::new(), None));
    }
    all
}

/// The centroid of the end face; where that is in a hole, or far from every node, the mean of the face's nodes.
fn tip_place(family: &Family) -> PointSpec {
    let mesh = family.problem.mesh();
    let end = mesh.end_face();
    let distance = |x: &[f64; 3]| x.iter().zip(end.centroid_mm).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
    let is_near = mesh.nodes_mm.iter().any(|x| distance(x) <= NEAR_MM * NEAR_MM);
    if end.is_solid && is_near { PointSpec::At(end.centroid_mm) } else { PointSpec::Set("tip".into()) }
}
