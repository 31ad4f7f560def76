//! Tests of `src/shadow.rs`.

use super::*;

fn square(height: f32) -> DrawnBody {
    let nodes_mm = vec![[40.0, height, 10.0], [44.0, height, 10.0], [40.0, height, 14.0]];
    DrawnBody { nodes_mm, facets: vec![[0, 1, 2]], values: vec![0.0; 3] }
}

#[test]
fn shadow_is_under_the_body_and_fades_with_height() {
    let [low, high] = [1.0, 60.0].map(|h| Shadow::cast(&square(h), 0.0, [0.0, 120.0], [-9.0, 41.0]));
    assert!(low.at(41.3, 11.3) < high.at(41.3, 11.3));
    assert!(high.at(41.3, 11.3) < 1.0);
    assert!((low.at(100.0, 30.0) - 1.0).abs() < 1e-6);
}

#[test]
fn body_beyond_the_plate_casts_no_shadow() {
    let shadow = Shadow::cast(&square(1.0), 0.0, [50.0, 60.0], [0.0, 5.0]);
    assert!(shadow.light.iter().all(|v| (*v - 1.0).abs() < 1e-6));
}
