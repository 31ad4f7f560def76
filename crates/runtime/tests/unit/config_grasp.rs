//! Tests of `src/config/grasp.rs` that need its private parts.

use super::*;

#[test]
fn a_mirrored_finger_faces_the_other_one_across_the_object() {
    let place = PlaceSpec { mirrored: true, offset_mm: [0.0, -70.0, 0.0] };
    // Both near faces of a block 30 mm thick: 20 mm below the first finger, 20 mm above the second.
    assert_eq!(place.apply([100.0, -20.0, 16.0]), [100.0, -50.0, 16.0]);
    assert_eq!(PlaceSpec::default().apply([1.0, 2.0, 3.0]), [1.0, 2.0, 3.0]);
}
