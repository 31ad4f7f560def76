//! The free end of any mesh: what a user calls its tip.
//!
//! The body's axis is the coordinate along which it reaches farthest from the middle of its held nodes. The end face is the thin slice of
//! nodes at that end: a plane end gives its nodes, a dome gives a cap as wide as a tenth of the body. The tip is the centroid of the
//! face's area, so it does not depend on where a mesher put its nodes.

use super::check::Boundary;
use super::types::Mesh;
use crate::algebra::{Vec3, add, axpy, cross, dot, norm, sub};
use rom::statistics::range;

/// Thicknesses of the slice that are tried, as fractions of the reach; the last is taken where all are narrow.
const SLICES: [f64; 5] = [1.0e-4, 0.01, 0.03, 0.06, 0.1];
/// Width of the face across the axis, as a fraction of the body's, from which a slice is wide enough.
const WIDE: f64 = 0.1;
/// Barycentric coordinates above this are inside a tetrahedron: rounding.
const INSIDE: f64 = -1.0e-6;

/// The free end.
#[derive(Clone, Debug, PartialEq)]
pub struct EndFace {
    /// Coordinate along the body's axis: 0, 1 or 2.
    pub axis: usize,
    /// 1 where the end is at the largest coordinate, -1 at the smallest.
    pub sense: f64,
    /// Nodes of the face.
    pub nodes: Vec<u32>,
    /// Centroid of the face's area (mm).
    pub centroid_mm: Vec3,
    /// Distance from the middle of the held nodes to the centroid (mm).
    pub free_length_mm: f64,
    /// False where the centroid is in a hole of the body, as in the end of a tube.
    pub is_solid: bool,
}

impl Mesh {
    /// The end that is farthest from the held nodes. Cost: linear in the elements.
    #[must_use]
    pub fn end_face(&self) -> EndFace {
        let held = mean(self.fixed_nodes.iter().map(|n| self.nodes_mm[*n as usize]));
        let ends = (0..3).flat_map(|axis| [1.0, -1.0].map(|sense| (axis, sense)));
        let reach = |(axis, sense): (usize, f64)| {
            self.nodes_mm.iter().map(|x| sense * (x[axis] - held[axis])).fold(0.0, f64::max)
        };
        // Of equal ends the first: x before y and z, upwards before downwards.
        let first_best = |best: ((usize, f64), f64), end| {
            let end_reach_mm = reach(end);
            if end_reach_mm > best.1 * (1.0 + 1.0e-9) { (end, end_reach_mm) } else { best }
        };
        let ((axis, sense), reach_mm) = ends.fold(((0, 1.0), 0.0), first_best);
        let across = [(axis + 1) % 3, (axis + 2) % 3];
        let all: Vec<u32> = (0..self.nodes_mm.len() as u32).collect();
        let body = across.map(|k| self.extent_mm(&all, k));
        let slice = |share: &f64| -> Vec<u32> {
            let within =
                |n: &u32| sense * (self.nodes_mm[*n as usize][axis] - held[axis]) >= (1.0 - share) * reach_mm;
            all.iter().copied().filter(within).collect()
        };
        let is_wide = |nodes: &Vec<u32>| {
            across.iter().zip(body).all(|(k, body)| self.extent_mm(nodes, *k) >= WIDE * body)
        };
        let nodes =
            SLICES.iter().map(slice).find(is_wide).unwrap_or_else(|| slice(&SLICES[SLICES.len() - 1]));
        let centroid_mm = self.area_centroid_mm(&nodes);
        EndFace {
            axis,
            sense,
            centroid_mm,
            free_length_mm: norm(sub(centroid_mm, held)),
            is_solid: self.tets.iter().any(|tet| self.has_inside(tet, centroid_mm)),
            nodes,
        }
    }

    /// Extent of nodes along a coordinate (mm).
    fn extent_mm(&self, nodes: &[u32], axis: usize) -> f64 {
        range(nodes.iter().map(|n| self.nodes_mm[*n as usize][axis]))
    }

    /// Centroid of the outer faces between nodes; without one the mean of the nodes.
    fn area_centroid_mm(&self, nodes: &[u32]) -> Vec3 {
        let mut is_in = vec![false; self.nodes_mm.len()];
        nodes.iter().for_each(|n| is_in[*n as usize] = true);
        let (mut area, mut moment) = (0.0, [0.0; 3]);
        for corners in Boundary::new(&self.tets).faces().filter(|f| f.iter().all(|n| is_in[*n as usize])) {
            let [a, b, c] = corners.map(|n| self.nodes_mm[n as usize]);
            let area_mm2 = 0.5 * norm(cross(sub(b, a), sub(c, a)));
            axpy(area_mm2 / 3.0, add(add(a, b), c), &mut moment);
            area += area_mm2;
        }
        match area > 0.0 {
            // The faces come in no order: rounding makes the sum the same in every run.
            true => moment.map(|v| (v / area * 1.0e6).round() / 1.0e6),
            false => mean(nodes.iter().map(|n| self.nodes_mm[*n as usize])),
        }
    }

    /// Whether a point is in the straight-edged tetrahedron of an element.
    fn has_inside(&self, tet: &[u32; 10], at_mm: Vec3) -> bool {
        let [a, b, c, d] = [0, 1, 2, 3].map(|k| self.nodes_mm[tet[k] as usize]);
        let volume = |a: Vec3, b: Vec3, c: Vec3, d: Vec3| dot(cross(sub(b, a), sub(c, a)), sub(d, a));
        let whole = volume(a, b, c, d);
        let parts =
            [volume(at_mm, b, c, d), volume(a, at_mm, c, d), volume(a, b, at_mm, d), volume(a, b, c, at_mm)];
        parts.iter().all(|part| part / whole >= INSIDE)
    }
}

fn mean(points: impl Iterator<Item = Vec3>) -> Vec3 {
    let (sum, count) = points.fold(([0.0; 3], 0.0_f64), |(sum, count), x| (add(sum, x), count + 1.0));
    sum.map(|v| v / count.max(1.0))
}
