//! What can be seen of a body from outside: its skin without the walls of closed cavities.

use super::camera::{Vec3, cross, dot};

/// The facets that can be seen from outside: connected parts of the boundary that enclose material, without those that
/// enclose a cavity.
///
/// A part's signed volume `1/6 sum a . (b x c)` is positive when its facets point out of what they enclose. The walls of
/// a closed cavity point out of the material, hence into the cavity, and give a negative one. When no part is positive
/// (orientation unknown, open sheets) all facets are returned. Facets that name a node that is not there are left out.
pub fn visible_facets(nodes_mm: &[Vec3], facets: &[[u32; 3]]) -> Vec<[u32; 3]> {
    let known = |facet: &[u32; 3]| facet.iter().all(|&node| (node as usize) < nodes_mm.len());
    let facets: Vec<[u32; 3]> = facets.iter().copied().filter(known).collect();
    let mut parts = Parts::new(nodes_mm.len());
    for facet in &facets {
        parts.join(facet[0], facet[1]);
        parts.join(facet[0], facet[2]);
    }
    let mut volume_mm3 = vec![0.0_f64; nodes_mm.len()];
    for facet in &facets {
        volume_mm3[parts.root(facet[0]) as usize] += cone_volume(facet.map(|node| nodes_mm[node as usize]));
    }
    let seen: Vec<[u32; 3]> =
        facets.iter().copied().filter(|facet| volume_mm3[parts.root(facet[0]) as usize] > 0.0).collect();
    if seen.is_empty() { facets } else { seen }
}

/// Signed volume between the origin and a triangle.
fn cone_volume([a, b, c]: [Vec3; 3]) -> f64 {
    f64::from(dot(a, cross(b, c))) / 6.0
}

/// Union-find over nodes.
struct Parts(Vec<u32>);

impl Parts {
    fn new(count: usize) -> Self {
        Self((0..count as u32).collect())
    }

    fn root(&mut self, node: u32) -> u32 {
        let mut at = node;
        while self.0[at as usize] != at {
            let up = self.0[self.0[at as usize] as usize];
            self.0[at as usize] = up;
            at = up;
        }
        at
    }

    fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        self.0[a.max(b) as usize] = a.min(b);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A tetrahedron with its corner at `low` and edges of length `size`, facets pointing outwards.
    fn tetrahedron(low: f32, size: f32, first: u32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
        let corners = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let facets = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]];
        (corners.map(|p| p.map(|v| low + size * v)).to_vec(), facets.map(|f| f.map(|n| first + n)).to_vec())
    }

    #[test]
    fn cavity_walls_are_not_visible() {
        let (mut nodes, outer) = tetrahedron(0.0, 1.0, 0);
        let (inner_nodes, inner) = tetrahedron(0.2, 0.1, 4);
        nodes.extend(inner_nodes);
        let hole: Vec<[u32; 3]> = inner.into_iter().map(|[a, b, c]| [a, c, b]).collect();
        assert_eq!(visible_facets(&nodes, &[outer.clone(), hole].concat()), outer);
    }

    #[test]
    fn two_bodies_side_by_side_are_both_visible() {
        let (mut nodes, mut all) = tetrahedron(0.0, 1.0, 0);
        let (other_nodes, other) = tetrahedron(5.0, 1.0, 4);
        nodes.extend(other_nodes);
        all.extend(other);
        assert_eq!(visible_facets(&nodes, &all), all);
    }

    #[test]
    fn unknown_nodes_are_left_out_and_open_sheets_are_kept() {
        let nodes = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        assert_eq!(visible_facets(&nodes, &[[0, 1, 2], [0, 1, 9]]), vec![[0, 1, 2]]);
    }
}
