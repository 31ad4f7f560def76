//! Tests of `src/cmd/draw/placed.rs` that need its private parts.

use super::*;
use crate::picture::camera::{cross, minus};

#[test]
fn mirrored_body_has_outward_normals() {
    let body = DrawnBody {
        nodes_mm: vec![[0.0, 1.0, 0.0], [0.0, 1.0, 1.0], [1.0, 1.0, 0.0]],
        facets: vec![[0, 1, 2]],
        values: vec![1.0, 2.0, 3.0],
    };
    let mut whole = DrawnBody::default();
    add(&mut whole, &body, &PlaceSpec::default());
    add(&mut whole, &body, &PlaceSpec { mirrored: true, offset_mm: [0.0, -70.0, 0.0] });
    assert_eq!(whole.nodes_mm[3], [0.0, -71.0, 0.0]);
    let up = |facet: [u32; 3]| {
        let [a, b, c] = facet.map(|node| whole.nodes_mm[node as usize]);
        cross(minus(b, a), minus(c, a))[1]
    };
    assert!(up(whole.facets[0]) > 0.0 && up(whole.facets[1]) < 0.0, "top of one, bottom of the other");
    assert_eq!(whole.values.len(), 6);
}
