//! The surface of a body visible from outside: without the walls of closed cavities.

use super::camera::{Vec3, cross, dot};
use rom::parts::Parts;

/// The facets that can be seen from outside: connected parts of the boundary that enclose material, without those that
/// enclose a cavity.
///
/// A part's signed volume `1/6 sum a . (b x c)` is positive when its facets point out of what they enclose. The walls of
/// a closed cavity point out of the material, hence into the cavity, and give a negative one. When no part is positive
/// (orientation unknown, open sheets) all facets are returned. Facets that name a node that is not there are left out.
pub fn visible_facets(nodes_mm: &[Vec3], facets: &[[u32; 3]]) -> Vec<[u32; 3]> {
    let known = |facet: &[u32; 3]| facet.iter().all(|&node| (node as usize) < nodes_mm.len());
    let facets: Vec<[u32; 3]> = facets.iter().copied().filter(known).collect();
    let mut parts = Parts::new(nodes_mm.len(), &facets);
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

#[cfg(test)]
#[path = "../tests/unit/visible.rs"]
mod tests;
