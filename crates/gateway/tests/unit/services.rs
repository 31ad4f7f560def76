//! Tests of `src/ros/services.rs` that need its private parts.

use super::*;
use crate::ros::golden::bytes as golden;
use wire::layout::{INPUTS_MAX, set_slot};

const REQUEST: &str = include_str!("../golden/what_if_request.hex");

#[test]
fn requests_are_those_of_another_writer() {
    let query = ServiceKind::WhatIf.query(&golden(REQUEST)).unwrap().unwrap();
    assert_eq!((query.kind, query.pressure_mpa, query.gap_mm), (query_kind::WHATIF, 0.05, 30.0));
    let parameters: Vec<(String, f64)> = query
        .parameters()
        .map(|(name, value)| (String::from_utf8_lossy(name).trim_end_matches('\0').to_owned(), value))
        .collect();
    assert_eq!(parameters, [("a".to_owned(), 1.5), ("elastomer.law.mu_mpa".to_owned(), 0.8)]);
    assert_eq!((query.want_field, query.node_set), (1, pack_name("tip")));
    let query = ServiceKind::Pressure.query(&golden(include_str!("../golden/find_pressure_request.hex")));
    let query = query.unwrap().unwrap();
    assert_eq!((query.kind, query.force_n, query.gap_mm), (query_kind::PRESSURE, 0.3, 30.0));
    assert!(query.pressure_mpa.is_nan() && query.want_field == 0 && query.parameter_count == 0);
    let query =
        ServiceKind::Gap.query(&golden(include_str!("../golden/find_gap_request.hex"))).unwrap().unwrap();
    assert_eq!((query.kind, query.pressure_mpa, query.force_n), (query_kind::GAP, 0.06, 0.3));
    assert_eq!(query.force_halfwidth_n, 0.01);
}

#[test]
fn responses_are_those_of_another_writer() {
    let mut answer = Answer {
        pressure_mpa: 0.05,
        gap_mm: 30.0,
        regime: regime::CONTACT,
        domain_status: 2,
        domain_distance: 0.25,
        contact_force_n: 0.3,
        force_halfwidth_n: 0.5,
        onset_pressure_mpa: f64::INFINITY,
        displacement_halfwidth_mm: 0.125,
        von_mises_halfwidth_mpa: 0.0625,
        uncertainty: 0.001,
        low: 0.049,
        high: 0.051,
        node_count: 3,
        field_count: 2,
        max_von_mises_mpa: 0.3,
        max_von_mises_node: 17,
        flags: flags::OUTSIDE_DOMAIN,
        model_hash: std::array::from_fn(|at| at as u8),
        input_count: 3,
        inputs: [f64::NAN; INPUTS_MAX],
        ..Answer::default()
    };
    answer.inputs[..3].copy_from_slice(&[0.05, 30.0, 0.8]);
    answer.force_by_input[..3].copy_from_slice(&[10.0, -0.02, 0.1]);
    answer.field_ids[..2].copy_from_slice(&[field_id::X, field_id::VON_MISES]);
    for (at, name) in ["pressure_mpa", "gap_mm", "elastomer.law.mu_mpa"].into_iter().enumerate() {
        set_slot(&mut answer.input_names, at, name);
    }
    let field = [1.0, 2.0, 3.0, 0.1, 0.2, 0.3];
    assert_eq!(response(&answer, &field), golden(include_str!("../golden/answered.hex")));
    assert_eq!(refusal("no twin"), golden(include_str!("../golden/not_answered.hex")));
}

#[test]
fn truncated_requests_are_refused_at_every_length() {
    let whole = golden(REQUEST);
    for length in 0..whole.len() - 1 {
        assert!(ServiceKind::WhatIf.query(&whole[..length]).is_none(), "{length}");
    }
    let many = Cdr::new().doubles(&[0.05, 30.0]).word(65).finish();
    assert!(ServiceKind::WhatIf.query(&many).is_none());
    let long = Cdr::new().doubles(&[0.05, 30.0]).word(0).word(u32::MAX).finish();
    assert!(ServiceKind::WhatIf.query(&long).is_none());
}

#[test]
fn a_twin_that_has_no_state_is_not_described() {
    let ros =
        Ros2 { domain_id: 0, node: "softtwin".into(), models: Vec::new().into(), marker_full_scale_mpa: 0.5 };
    assert_eq!(trigger_response(true, "{}"), golden(include_str!("../golden/described.hex")));
    assert_eq!(description(&ros, "finger", None)[4], 0, "success");
    assert_eq!(description(&ros, "finger", Some(&State::default()))[4], 1, "success");
}
