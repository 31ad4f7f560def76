//! Tests of `src/ros/message.rs` that need its private parts.

use super::*;
use crate::ros::golden;
use wire::layout::set_slot;

#[test]
fn inputs_have_the_pressures_of_all_cavities_in_pascals() {
    let mut state = State { input_count: 4, ..State::default() };
    state.inputs[..4].copy_from_slice(&[0.02, 30.0, 0.01, 0.8]);
    let names = ["pressure_mpa", "gap_mm", "pressure_mpa.lower", "elastomer.law.jm"];
    names.iter().enumerate().for_each(|(at, name)| set_slot(&mut state.input_names, at, name));
    let message = inputs(&state, "two", 0).unwrap();
    let values = [2.0e4, 0.03, 1.0e4, 0.8];
    let expected =
        Cdr::new().header(0, "two").strings(&names).word(4).doubles(&values).word(0).word(0).finish();
    assert_eq!(message, expected);
    assert_eq!(inputs(&State::default(), "two", 0), None);
}

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
