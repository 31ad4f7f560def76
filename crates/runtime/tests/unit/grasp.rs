//! Tests of `src/grasp/mod.rs` that need its private parts.

use super::*;

/// The paper's gripper: 17 g, friction 0.2, two fingers.
fn paper() -> GraspSpec {
    GraspSpec { mass_g: 17.0, friction: 0.2, safety: 1.0, fingers: Vec::new() }
}

fn state(force_n: f64, halfwidth_n: f32) -> Option<State> {
    Some(State {
        flags: 0,
        contact_force_n: force_n,
        force_halfwidth_n: halfwidth_n,
        t_sensor_ns: 5,
        ..State::default()
    })
}

#[test]
fn the_papers_gripper_holds_its_object() {
    let grasp = evaluate(&paper(), &[state(0.58, 0.001), state(0.58, 0.001)]);
    assert_eq!(grasp.grasp_status, grasp_status::HELD);
    assert!((grasp.needed_force_n - 0.017 * 9.81 / 0.4).abs() < 1e-12);
    assert!((grasp.margin - (0.58 / 0.416925 - 1.0)).abs() < 1e-9);
    // 17 g on 2 x 0.58 N need a friction coefficient of 0.144; the paper asks for 0.2.
    assert!((grasp.needed_friction - 0.017 * 9.81 / 1.16).abs() < 1e-9);
}

#[test]
fn grasp_uses_the_weakest_finger_and_its_half_width() {
    let needed_n = needed_force_n(&paper(), 2);
    let status = |a: f64, b: f64, halfwidth| {
        evaluate(&paper(), &[state(a, halfwidth), state(b, halfwidth)]).grasp_status
    };
    assert_eq!(status(needed_n * 0.99, 10.0, 0.0), grasp_status::NOT_HELD);
    assert_eq!(status(needed_n * 1.01, 10.0, 0.1), grasp_status::MARGINAL);
    assert_eq!(status(needed_n * 1.01, 10.0, 0.001), grasp_status::HELD);
    assert_eq!(status(needed_n * 1.01, 10.0, f32::NAN), grasp_status::HELD, "half-widths are off");
}

#[test]
fn force_outside_the_training_range_holds_nothing_for_sure() {
    let needed_n = needed_force_n(&paper(), 2);
    let status = |force_n: f64| {
        let outside = state(force_n, f32::NAN).map(|state| State { flags: flags::OUTSIDE_DOMAIN, ..state });
        evaluate(&paper(), &[outside, state(10.0, 0.001)])
    };
    assert_eq!(status(2.0 * needed_n).grasp_status, grasp_status::UNKNOWN);
    assert!(status(2.0 * needed_n).force_halfwidth_n.is_nan());
    assert_eq!(status(0.5 * needed_n).grasp_status, grasp_status::NOT_HELD);
}

#[test]
fn a_finger_without_fresh_data_makes_the_grasp_unknown() {
    assert_eq!(evaluate(&paper(), &[state(1.0, 0.0), None]).grasp_status, grasp_status::UNKNOWN);
    let of_no_force = evaluate(&paper(), &[state(1.0, 0.0), state(f64::NAN, 0.0), state(1.0, 0.0)]);
    assert_eq!(of_no_force.grasp_status, grasp_status::UNKNOWN);
    assert!(of_no_force.least_force_n.is_nan() && of_no_force.margin.is_nan(), "{of_no_force:?}");
    let stale = State { flags: flags::STALE, contact_force_n: 1.0, ..State::default() };
    let grasp = evaluate(&paper(), &[state(1.0, 0.0), Some(stale)]);
    assert_eq!((grasp.grasp_status, grasp.flags), (grasp_status::UNKNOWN, flags::STALE));
}
