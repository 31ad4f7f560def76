//! Tests of `src/visible.rs`.

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
fn unknown_nodes_are_omitted_and_open_sheets_are_kept() {
    let nodes = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    assert_eq!(visible_facets(&nodes, &[[0, 1, 2], [0, 1, 9]]), vec![[0, 1, 2]]);
}
