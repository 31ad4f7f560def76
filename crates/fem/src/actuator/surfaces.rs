//! Names of an actuator's surfaces by their positions, for meshes without names (a `.vtu`, or one made by `grid`).
//!
//! The mesh must be in the actuator frame and its faces must lie on the planes of `actuator.toml`.

use super::boxes::Boxes;
use super::file::{Fixed, Shape};
use crate::mesh::Boundary;
use formats::mesh_file::{TET_FACES, Tet10, Tri6};
use std::collections::{BTreeMap, HashSet};

/// Tolerance of the mesher's coordinates (mm).
const TOLERANCE_MM: f64 = 1.0e-3;

/// `bottom`, `sheet`, `fixed`, `cavity`, that of an opposite row, `slot_lower_0`, `slot_upper_0`, ... with their triangles; surfaces
/// without triangles are absent. Cost `O(elements x chambers)`.
pub(crate) fn locate(
    shape: &Shape<'_>,
    points_mm: &[[f64; 3]],
    tets: &[Tet10],
) -> BTreeMap<String, Vec<Tri6>> {
    let places = Places { boxes: Boxes::of(shape), shape };
    let boundary = Boundary::new(tets);
    let mut surfaces: BTreeMap<String, Vec<Tri6>> = BTreeMap::new();
    let mut sheet_seen = HashSet::new();
    for tet in tets {
        for face in TET_FACES {
            let tri = face.map(|k| tet[k]);
            let Some(corners) = corners(points_mm, &tri) else { continue };
            let outer = boundary.has([tri[0], tri[1], tri[2]]);
            if places.on_sheet(&corners) {
                let mut key = [tri[0], tri[1], tri[2]];
                key.sort_unstable();
                // A face of the sheet inside the base has an element on either side.
                if sheet_seen.insert(key) {
                    surfaces.entry("sheet".into()).or_default().push(tri);
                }
            }
            if let Some(name) = places.name(&corners).filter(|_| outer) {
                surfaces.entry(name).or_default().push(tri);
            }
        }
    }
    surfaces
}

/// Positions of a triangle's corners; `None` if a node does not exist (the mesh's check reports it).
fn corners(points_mm: &[[f64; 3]], tri: &Tri6) -> Option<[[f64; 3]; 3]> {
    let point = |n: u32| points_mm.get(n as usize).copied();
    Some([point(tri[0])?, point(tri[1])?, point(tri[2])?])
}

struct Places<'a> {
    boxes: Boxes,
    shape: &'a Shape<'a>,
}

fn on(corners: &[[f64; 3]; 3], axis: usize, v: f64) -> bool {
    corners.iter().all(|p| (p[axis] - v).abs() < TOLERANCE_MM)
}

impl Places<'_> {
    fn on_sheet(&self, corners: &[[f64; 3]; 3]) -> bool {
        self.shape.sheet && on(corners, 1, self.shape.base_mm() + self.shape.base.lower_mm)
    }

    /// Name of an outer face.
    fn name(&self, corners: &[[f64; 3]; 3]) -> Option<String> {
        let a = self.shape;
        let on = |axis: usize, v: f64| on(corners, axis, v);
        let centroid: [f64; 3] = std::array::from_fn(|k| corners.iter().map(|p| p[k]).sum::<f64>() / 3.0);
        if on(1, 0.0) {
            return Some("bottom".into());
        }
        let base = [0.0, a.base_top_mm()].map(|y| a.base_mm() + y);
        let in_base = (base[0]..base[1]).contains(&centroid[1]);
        let held = match a.fixed {
            Fixed::BodyStart => on(0, a.body.start_mm) && !in_base,
            Fixed::BaseStart => on(0, 0.0),
            Fixed::BodyEnd => on(0, a.body.start_mm + a.body.length_mm) && !in_base,
            Fixed::BaseEnd => on(0, a.base.length_mm),
            Fixed::BodyTop => on(1, a.base_mm() + a.body.top_mm),
            Fixed::BaseFront => on(2, 0.0) && in_base,
            Fixed::BaseBack => on(2, a.base.width_mm) && in_base,
        };
        if held {
            return Some("fixed".into());
        }
        let across = corners.iter().all(|p| (p[0] - centroid[0]).abs() < TOLERANCE_MM);
        if let Some((i, side)) = self.boxes.slot_at(centroid, TOLERANCE_MM).filter(|_| across) {
            return Some(format!("slot_{side}_{i}"));
        }
        match (self.boxes.cavity_at(centroid, TOLERANCE_MM)?, &a.chambers.opposite) {
            (0, _) => Some("cavity".into()),
            (_, name) => name.as_ref().map(|name| format!("cavity.{name}")),
        }
    }
}

/// Elements of each part of the boxes: `lower`, `upper`, `body`.
pub(crate) fn volumes(
    shape: &Shape<'_>,
    points_mm: &[[f64; 3]],
    tets: &[Tet10],
) -> BTreeMap<String, Vec<u32>> {
    let boxes = Boxes::of(shape);
    let mut volumes: BTreeMap<String, Vec<u32>> = BTreeMap::new();
    for (e, tet) in tets.iter().enumerate() {
        let corners: Vec<[f64; 3]> =
            tet[..4].iter().filter_map(|n| points_mm.get(*n as usize).copied()).collect();
        let centroid: [f64; 3] =
            std::array::from_fn(|k| corners.iter().map(|p| p[k]).sum::<f64>() / corners.len() as f64);
        volumes.entry(boxes.part(centroid).into()).or_default().push(e as u32);
    }
    volumes
}
