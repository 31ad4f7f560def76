//! Tests of `src/skin.rs`.

use super::*;

/// Two squares with the common edge x = 0, at an angle of `angle_deg`.
fn bent(angle_deg: f32) -> DrawnBody {
    let (sin, cos) = angle_deg.to_radians().sin_cos();
    let flat = [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [-1.0, 1.0, 0.0]];
    let nodes_mm = flat.into_iter().chain([[cos, 0.0, sin], [cos, 1.0, sin]]).collect();
    DrawnBody { values: vec![0.0; 6], nodes_mm, facets: vec![[2, 0, 3], [0, 1, 3], [0, 4, 1], [4, 5, 1]] }
}

#[test]
fn small_crease_is_smooth_and_large_one_is_an_edge() {
    let gentle = bent(20.0).corners();
    assert!((dot(gentle[1][0].normal, gentle[2][0].normal) - 1.0).abs() < 0.02, "{gentle:?}");
    let sharp = bent(80.0).corners();
    assert!((dot(sharp[1][0].normal, sharp[2][0].normal) - 80_f32.to_radians().cos()).abs() < 1e-5);
}

#[test]
fn facet_without_area_gives_no_nan() {
    let body = DrawnBody { nodes_mm: vec![[1.0; 3]; 3], facets: vec![[0, 1, 2]], values: vec![0.0; 3] };
    assert!(body.corners()[0].iter().all(|c| c.normal.iter().all(|v| v.is_finite())));
}
