//! Tests of `src/config/estimate.rs` that need its private parts.

use super::CameraSpec;
use wire::layout::Marker;

#[test]
fn turns_are_about_x_then_y_then_z() {
    let camera = CameraSpec { position_mm: [0.0; 3], rotation_deg: [90.0, 0.0, 90.0] };
    let turned = camera.rotation().map(|row| row.map(|v| v.round()));
    // About x first: y becomes z; then about z: x becomes y, and the old z (now -y) becomes x.
    assert_eq!(turned, [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    let camera = CameraSpec { position_mm: [1.0, 2.0, 3.0], ..camera };
    let [x, y, z] = camera.in_actuator_mm(Marker { x: 10.0, y: 20.0, z: 30.0 });
    assert!((x - 31.0).abs() < 1e-12 && (y - 12.0).abs() < 1e-12 && (z - 23.0).abs() < 1e-12, "{x} {y} {z}");
    for (i, a) in camera.rotation().iter().enumerate() {
        for (j, b) in camera.rotation().iter().enumerate() {
            let dot: f64 = a.iter().zip(b).map(|(a, b)| a * b).sum();
            assert!((dot - f64::from(u8::from(i == j))).abs() < 1e-12);
        }
    }
}
