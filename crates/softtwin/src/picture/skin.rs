//! From nodes and facets to lit corners: smooth where the surface is smooth, sharp at its edges.

use super::camera::{Vec3, cross, dot, minus, unit};

/// Facets whose normals differ by more than this (degrees) meet at an edge.
const CREASE_DEG: f32 = 40.0;

/// What is to be drawn of a body.
#[derive(Clone, Debug, Default)]
pub struct Body {
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

impl Body {
    /// Corners of all facets. The normal at a corner is the area-weighted mean over the facets at its node that are
    /// within the crease angle (40 degrees) of its own facet.
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
mod tests {
    use super::*;

    /// Two squares that share the edge x = 0 and are bent against each other by `angle_deg`.
    fn bent(angle_deg: f32) -> Body {
        let (sin, cos) = angle_deg.to_radians().sin_cos();
        let flat = [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [-1.0, 1.0, 0.0]];
        let nodes_mm = flat.into_iter().chain([[cos, 0.0, sin], [cos, 1.0, sin]]).collect();
        Body { values: vec![0.0; 6], nodes_mm, facets: vec![[2, 0, 3], [0, 1, 3], [0, 4, 1], [4, 5, 1]] }
    }

    #[test]
    fn a_gentle_bend_is_smooth_and_a_sharp_one_is_an_edge() {
        let gentle = bent(20.0).corners();
        assert!((dot(gentle[1][0].normal, gentle[2][0].normal) - 1.0).abs() < 0.02, "{gentle:?}");
        let sharp = bent(80.0).corners();
        assert!((dot(sharp[1][0].normal, sharp[2][0].normal) - 80_f32.to_radians().cos()).abs() < 1e-5);
    }

    #[test]
    fn a_facet_without_area_gives_no_nan() {
        let body = Body { nodes_mm: vec![[1.0; 3]; 3], facets: vec![[0, 1, 2]], values: vec![0.0; 3] };
        assert!(body.corners()[0].iter().all(|c| c.normal.iter().all(|v| v.is_finite())));
    }
}
