//! From nodes and facets to lit corners: smooth where the surface is smooth, sharp at its edges.

use super::camera::{Vec3, cross, dot, minus, unit};

/// Facets whose normals differ by more than this (degrees) meet at an edge.
const CREASE_DEG: f32 = 40.0;

/// Size of a marker, as a fraction of the extent of all of them, and the least, mm.
const MARKER_SHARE: f32 = 0.02;
const MARKER_MM: f32 = 1.0;
/// Corners of an octahedron, and its faces.
const CORNERS: [[f32; 3]; 6] =
    [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]];
const FACES: [[u32; 3]; 8] =
    [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]];

/// Drawable part of a body.
#[derive(Clone, Debug, Default)]
pub struct DrawnBody {
    /// Node positions, mm.
    pub nodes_mm: Vec<Vec3>,
    /// Flat facets over the nodes.
    pub facets: Vec<[u32; 3]>,
    /// Value of each node that is shown as colour.
    pub values: Vec<f32>,
}

/// A corner of a facet as the rasteriser takes it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corner {
    /// Where, mm.
    pub position: Vec3,
    /// Which way the surface looks there.
    pub normal: Vec3,
    /// The shown value.
    pub value: f32,
}

/// Half the size of a marker among these nodes, mm.
pub fn marker_mm(nodes_mm: &[Vec3]) -> f32 {
    let extent = |axis: usize| {
        let ends = nodes_mm.iter().map(|node| node[axis]);
        let (low, high) = ends.fold((f32::INFINITY, f32::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
        high - low
    };
    (MARKER_SHARE * [0, 1, 2].map(extent).into_iter().fold(0.0, f32::max)).max(MARKER_MM)
}

/// Distance of each point from its place at rest.
pub fn distances(nodes_mm: &[Vec3], rest_mm: &[Vec3]) -> Vec<f32> {
    let distance = |(to, from): (&Vec3, &Vec3)| {
        to.iter().zip(from).map(|(to, from)| (to - from) * (to - from)).sum::<f32>().sqrt()
    };
    nodes_mm.iter().zip(rest_mm).map(distance).collect()
}

impl DrawnBody {
    /// Octahedra at markers, coloured by their distance from `rest_mm`.
    pub fn of_markers(nodes_mm: &[Vec3], rest_mm: &[Vec3]) -> Self {
        let size = marker_mm(nodes_mm);
        let corner = |node: &Vec3, at: Vec3| [0, 1, 2].map(|k| node[k] + size * at[k]);
        let facets =
            (0..nodes_mm.len() as u32).flat_map(|node| FACES.map(|face| face.map(|at| 6 * node + at)));
        Self {
            nodes_mm: nodes_mm.iter().flat_map(|node| CORNERS.map(|at| corner(node, at))).collect(),
            facets: facets.collect(),
            values: distances(nodes_mm, rest_mm).iter().flat_map(|value| [*value; 6]).collect(),
        }
    }

    /// Corners of all facets. The normal at a corner is the area-weighted mean over the facets at its node that are
    /// within the crease angle (40 degrees) of its facet.
    pub fn corners(&self) -> Vec<[Corner; 3]> {
        let areas: Vec<Vec3> = self.facets.iter().map(|f| self.area(f)).collect();
        let units: Vec<Vec3> = areas.iter().map(|a| unit(*a)).collect();
        let (starts, around) = self.facets_around_nodes();
        let limit = CREASE_DEG.to_radians().cos();
        let corner = |own: usize, node: u32| {
            let node = node as usize;
            let mut sum = [0.0; 3];
            for &other in &around[starts[node]..starts[node + 1]] {
                if dot(units[own], units[other as usize]) >= limit {
                    let area = areas[other as usize];
                    sum = std::array::from_fn(|k| sum[k] + area[k]);
                }
            }
            Corner { position: self.nodes_mm[node], normal: unit(sum), value: self.values[node] }
        };
        self.facets.iter().enumerate().map(|(own, facet)| facet.map(|node| corner(own, node))).collect()
    }

    /// Normal of a facet with twice its area as length.
    fn area(&self, facet: &[u32; 3]) -> Vec3 {
        let [a, b, c] = facet.map(|node| self.nodes_mm[node as usize]);
        cross(minus(b, a), minus(c, a))
    }

    /// Facets at each node: `around[starts[node] .. starts[node + 1]]`.
    fn facets_around_nodes(&self) -> (Vec<usize>, Vec<u32>) {
        let mut starts = vec![0; self.nodes_mm.len() + 1];
        for node in self.facets.as_flattened() {
            starts[*node as usize + 1] += 1;
        }
        for node in 0..self.nodes_mm.len() {
            starts[node + 1] += starts[node];
        }
        let mut next = starts.clone();
        let mut around = vec![0; 3 * self.facets.len()];
        for (index, facet) in self.facets.iter().enumerate() {
            for node in facet {
                around[next[*node as usize]] = index as u32;
                next[*node as usize] += 1;
            }
        }
        (starts, around)
    }
}

#[cfg(test)]
#[path = "../tests/unit/skin.rs"]
mod tests;
