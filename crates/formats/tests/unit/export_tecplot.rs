//! Tests of `src/export/tecplot.rs` that need its private parts.

use super::*;
use crate::mesh_file::TET_EDGES;

#[test]
fn the_eight_parts_fill_the_tetrahedron_and_none_is_turned_over() {
    let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let middle = |[a, b]: [usize; 2]| [0, 1, 2].map(|k| 0.5 * (corners[a][k] + corners[b][k]));
    let nodes: Vec<[f64; 3]> = corners.into_iter().chain(TET_EDGES.map(middle)).collect();
    let volume = |part: [usize; 4]| {
        let [a, b, c] = [1, 2, 3].map(|i| [0, 1, 2].map(|k| nodes[part[i]][k] - nodes[part[0]][k]));
        (a[0] * (b[1] * c[2] - b[2] * c[1])
            + a[1] * (b[2] * c[0] - b[0] * c[2])
            + a[2] * (b[0] * c[1] - b[1] * c[0]))
            / 6.0
    };
    for part in EIGHT {
        assert!((volume(part) - 1.0 / 48.0).abs() < 1e-15, "{part:?}: {}", volume(part));
    }
}
