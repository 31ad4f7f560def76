//! Tests of `src/ros/describe.rs` that need its private parts.

use super::*;
use crate::ros::golden;

#[test]
fn the_bytes_are_those_of_another_writer() {
    assert_eq!(response(true, "{}"), golden::bytes(include_str!("../golden/described.hex")));
}

#[test]
fn a_malformed_request_has_no_answer_and_an_absent_twin_is_a_failure() {
    let ros =
        Ros2 { domain_id: 0, node: "softtwin".into(), models: Vec::new().into(), marker_full_scale_mpa: 0.5 };
    for request in [&[][..], &[0, 1, 0], &[0, 0, 0, 0, 0]] {
        assert!(answer(request, &ros, "finger", None).is_none(), "{request:?}");
    }
    let found = answer(&[0, 1, 0, 0, 0], &ros, "finger", None).unwrap();
    assert_eq!(found[4], 0, "success");
    assert!(String::from_utf8_lossy(&found[12..]).starts_with("no state of finger"));
}
