//! Tests of `src/camera.rs`.

use super::*;

#[test]
fn axes_are_orthonormal_and_right_handed_everywhere() {
    for azimuth in [-170.0, -35.0, 0.0, 20.0, 90.0, 135.0] {
        for elevation in [-80.0, 0.0, 25.0, 89.0] {
            let c = Camera::new(azimuth, elevation);
            for (a, b) in [(c.right, c.up), (c.up, c.toward), (c.toward, c.right)] {
                assert!(dot(a, b).abs() < 1e-6);
            }
            let third = cross(c.right, c.up);
            assert!((0..3).all(|k| (third[k] - c.toward[k]).abs() < 1e-6), "{azimuth} {elevation}");
        }
    }
}

#[test]
fn side_view_has_x_right_and_y_up() {
    let c = Camera::new(0.0, 0.0);
    assert_eq!(c.project([3.0, 4.0, 5.0]), [3.0, 4.0, 5.0]);
}

#[test]
fn window_contains_every_point() {
    let c = Camera::new(30.0, 20.0);
    let points = [[0.0, 0.0, 0.0], [120.0, -80.0, 32.0], [60.0, 19.0, -9.0]];
    let w = Window::around(&c, points.into_iter(), [200, 100], 0.05);
    for p in points.map(|p| c.project(p)) {
        assert!((p[0] - w.centre_mm[0]).abs() < 100.0 * w.mm_per_px);
        assert!((p[1] - w.centre_mm[1]).abs() < 50.0 * w.mm_per_px);
    }
}
