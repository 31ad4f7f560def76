//! Tests of `src/ros/marker.rs` that need its private parts.

use super::*;
use crate::ros::golden;

/// Four nodes with the von Mises stress 0, 0.25, 0.5 and 1 MPa.
fn field() -> (FieldHeader, Vec<f32>) {
    let mut header = FieldHeader { node_count: 4, field_count: 4, ..FieldHeader::default() };
    header.field_ids[..4].copy_from_slice(&[field_id::X, field_id::Y, field_id::Z, field_id::VON_MISES]);
    let x = [0.0, 1.0, 0.0, 0.0];
    let y = [0.0, 0.0, 2.0, 0.0];
    let z = [0.0, 0.0, 0.0, -4.0];
    (header, [x, y, z, [0.0, 0.25, 0.5, 1.0]].concat())
}

#[test]
fn the_bytes_are_those_of_another_writer() {
    let (header, values) = field();
    let found = marker(&header, &values, &[0, 1, 2, 0, 3, 1], 0.5, "finger", 12_000_000_345).unwrap();
    assert_eq!(found, golden::bytes(include_str!("../golden/marker.hex")));
}

#[test]
fn a_field_without_a_coordinate_or_a_corner_gives_none() {
    let (mut header, values) = field();
    assert!(marker(&header, &values, &[0, 1, 4], 0.5, "finger", 0).is_none(), "node 4 of 4");
    header.field_ids[2] = field_id::DISPLACEMENT;
    assert!(marker(&header, &values, &[0, 1, 2], 0.5, "finger", 0).is_none(), "no z");
}

#[test]
fn colours_end_at_full_scale_and_are_grey_without_stress() {
    assert_eq!(colour(0.0), SCALE[0]);
    assert_eq!(colour(-1.0), SCALE[0]);
    assert_eq!(colour(1.0), SCALE[2]);
    assert_eq!(colour(1.001), BEYOND);
    assert_eq!(colour(f32::NAN), UNKNOWN);
    let (mut header, values) = field();
    header.field_ids[3] = field_id::DISPLACEMENT;
    assert!(marker(&header, &values, &[0, 1, 2], 0.5, "finger", 0).is_some());
}
