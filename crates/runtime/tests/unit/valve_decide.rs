use super::*;
use crate::valve::ValveSpec;
use proptest::prelude::*;

const MS: u64 = 1_000_000;
const NOW: u64 = 1_000_000 * MS;

fn spec(more: &str) -> ValveSpec {
    toml::from_str(&format!("range_mpa = [0.0, 0.08]\n{more}")).unwrap()
}

fn governor(more: &str) -> Governor {
    Governor::new(&spec(more), NOW, Arc::default())
}

fn wants(pressure_mpa: f64, age_ms: u64) -> Setpoint {
    let t_publish_ns = NOW - age_ms * MS;
    Setpoint { boot_id: 7, seq: 1, t_publish_ns, valid_for_ns: 40 * MS, pressure_mpa, ..Setpoint::default() }
}

fn fresh(force_n: f64) -> State {
    State { flags: 0, t_sensor_ns: NOW - 10 * MS, contact_force_n: force_n, ..State::default() }
}

#[test]
fn cause_of_a_closed_valve_is_named() {
    let setpoint = wants(0.05, 10);
    let reason = |setpoint: Option<&Setpoint>, state: Option<&State>, more: &str| {
        let found = governor(more).decide(NOW + MS, setpoint, None, state);
        assert!(found.reason == valve_reason::FOLLOWING || found.pressure_mpa == 0.0, "{found:?}");
        (found.reason, found.interlock)
    };
    assert_eq!(reason(Some(&setpoint), Some(&fresh(0.1)), ""), (valve_reason::FOLLOWING, 0));
    assert_eq!(reason(None, Some(&fresh(0.1)), ""), (valve_reason::NO_SETPOINT, 0));
    assert_eq!(reason(Some(&wants(f64::NAN, 0)), Some(&fresh(0.1)), ""), (valve_reason::NO_SETPOINT, 0));
    assert_eq!(reason(Some(&wants(0.05, 45)), Some(&fresh(0.1)), ""), (valve_reason::TIMEOUT, 0));
    // The scene's longest validity counts, whatever the setpoint says.
    assert_eq!(reason(Some(&setpoint), Some(&fresh(0.1)), "valid_max_ms = 5").0, valve_reason::TIMEOUT);
    let closed = |interlock| (valve_reason::INTERLOCK, interlock);
    assert_eq!(reason(Some(&setpoint), None, ""), closed(valve_interlock::NO_STATE));
    let old = State { t_sensor_ns: NOW - 60 * MS, ..fresh(0.1) };
    assert_eq!(reason(Some(&setpoint), Some(&old), ""), closed(valve_interlock::STALE));
    let outside = State { domain_status: domain_status::OUTSIDE, ..fresh(0.1) };
    assert_eq!(reason(Some(&setpoint), Some(&outside), ""), closed(valve_interlock::OUTSIDE_DOMAIN));
    assert_eq!(reason(Some(&setpoint), Some(&outside), "stop_outside_domain = false").1, 0);
    assert_eq!(
        reason(Some(&setpoint), Some(&fresh(0.1)), "needs_force = true"),
        closed(valve_interlock::NO_FORCE)
    );
    assert_eq!(
        reason(Some(&setpoint), Some(&fresh(0.6)), "force_max_n = 0.5"),
        closed(valve_interlock::FORCE)
    );
    let cell = State { measured_force_n: 0.6, ..fresh(0.1) };
    assert_eq!(reason(Some(&setpoint), Some(&cell), "force_max_n = 0.5"), closed(valve_interlock::FORCE));
    for (flags, interlock) in [
        (flags::FORCE_MISMATCH, valve_interlock::FORCE_MISMATCH),
        (flags::MARKER_MISMATCH, valve_interlock::MARKER_MISMATCH),
        (flags::OBSERVABLE_MISMATCH, valve_interlock::OBSERVABLE_MISMATCH),
        (flags::ESTIMATE_ALARM, valve_interlock::ESTIMATE_ALARM),
    ] {
        let contradicts = State { flags, ..fresh(0.1) };
        let found = reason(Some(&setpoint), Some(&contradicts), "stop_on_mismatch = true");
        assert_eq!(found, closed(interlock));
    }
}

#[test]
fn force_trip_stays_until_the_operator_releases_it() {
    let mut governor = governor("force_max_n = 0.5");
    let release = |at_ns: u64| Setpoint { t_publish_ns: at_ns, ..wants(f64::NAN, 0) };
    let mut decide = |setpoint: Setpoint, operator: Option<Setpoint>, force_n| {
        governor.decide(NOW, Some(&setpoint), operator.as_ref(), Some(&fresh(force_n))).reason
    };
    assert_eq!(decide(wants(0.05, 0), None, 0.6), valve_reason::INTERLOCK);
    assert_eq!(decide(wants(0.05, 0), None, 0.0), valve_reason::INTERLOCK, "the owner still pushes");
    assert_eq!(
        decide(wants(0.0, 0), None, 0.0),
        valve_reason::INTERLOCK,
        "the owner asks for the safe value"
    );
    let another_run = Setpoint { boot_id: 8, ..wants(0.05, 0) };
    assert_eq!(decide(another_run, None, 0.0), valve_reason::INTERLOCK, "another run");
    assert_eq!(
        decide(another_run, Some(release(NOW - MS)), 0.0),
        valve_reason::INTERLOCK,
        "an earlier release"
    );
    assert_eq!(decide(another_run, Some(release(NOW)), 0.6), valve_reason::INTERLOCK, "still beyond");
    assert_eq!(
        decide(another_run, Some(release(NOW)), 0.0),
        valve_reason::INTERLOCK,
        "that release is used up"
    );
}

#[test]
fn release_counts_once_and_only_with_a_stamp_of_now() {
    let is_open_after = |release_ns: u64, seen_ns: u64| {
        let mut governor = governor("force_max_n = 0.5");
        let mut decide = |at_ns: u64, operator: Option<Setpoint>, force_n: f64| {
            let setpoint = Setpoint { t_publish_ns: at_ns, ..wants(0.05, 0) };
            let state = State { t_sensor_ns: at_ns, ..fresh(force_n) };
            governor.decide(at_ns, Some(&setpoint), operator.as_ref(), Some(&state)).reason
        };
        assert_eq!(decide(NOW, None, 0.6), valve_reason::INTERLOCK);
        let release = Setpoint { t_publish_ns: release_ns, ..wants(f64::NAN, 0) };
        decide(seen_ns - 10 * MS, None, 0.0);
        let is_open = decide(seen_ns, Some(release), 0.0) == valve_reason::FOLLOWING;
        // The next trip stays, though the same release is still what the topic has.
        assert_eq!(decide(seen_ns + 10 * MS, Some(release), 0.6), valve_reason::INTERLOCK);
        assert_eq!(decide(seen_ns + 20 * MS, Some(release), 0.0), valve_reason::INTERLOCK);
        is_open
    };
    let seen_ns = NOW + 50 * MS;
    assert!(is_open_after(seen_ns - MS, seen_ns) && is_open_after(seen_ns, seen_ns));
    for future_ns in [seen_ns + 1, seen_ns + 15 * MS, u64::MAX] {
        assert!(!is_open_after(future_ns, seen_ns), "{future_ns}");
    }
    assert!(!is_open_after(NOW + 1, NOW + 2000 * MS), "an operator of seconds ago did not see this");
}

#[test]
fn after_a_pause_the_way_up_begins_at_the_safe_value() {
    let modbus = |watchdog: &str| {
        format!(
            "rate_mpa_per_s = 0.5\nwrite_hz = 100.0\n[modbus]\ntcp = \"a:1\"\ntimeout_ms = 30.0\n\
             value = {{ from = {{ unit_id = 1, register = 1 }} }}\n{watchdog}"
        )
    };
    // Two periods and one answer; with a time-out of the device, a period less than that.
    for (watchdog, longest_ms) in [("", 50), ("watchdog = { register = 2, raw = 5, scale_ms = 10.0 }", 40)] {
        let mut governor = governor(&modbus(watchdog));
        let mut decide = |at_ms: u64| {
            let at_ns = NOW + at_ms * MS;
            let operator = Setpoint { t_publish_ns: at_ns, valid_for_ns: 0, ..wants(0.08, 0) };
            governor.decide(at_ns, None, Some(&operator), None).pressure_mpa
        };
        let (mut at_ms, mut before) = (0, 0.0);
        for dt_ms in [10, longest_ms] {
            at_ms += dt_ms;
            let written = decide(at_ms);
            assert!((written - before - 0.5e-3 * dt_ms as f64).abs() < 1e-12, "{written} at {at_ms} ms");
            before = written;
        }
        for pause_ms in [longest_ms + 1, 500] {
            at_ms += pause_ms;
            assert_eq!(decide(at_ms), 0.0, "after {pause_ms} ms");
            at_ms += 10;
            assert!((decide(at_ms) - 0.005).abs() < 1e-12);
        }
    }
}

#[test]
fn the_operator_wins_until_released() {
    let mut governor = governor("");
    let operator = Setpoint { valid_for_ns: 0, ..wants(0.02, 0) };
    let (stale, later) = (State { t_sensor_ns: 0, ..fresh(0.1) }, NOW + 3600 * 1000 * MS);
    let mut decide = |at_ns| governor.decide(at_ns, Some(&wants(0.05, 0)), Some(&operator), Some(&stale));
    // The first write after that pause is the safe value.
    assert_eq!(decide(later - MS).pressure_mpa, 0.0);
    let found = decide(later);
    assert_eq!((found.reason, found.pressure_mpa), (valve_reason::OVERRIDE, 0.02));
    assert_eq!(found.interlock, valve_interlock::STALE, "what it overrides is still said");
    let released = Setpoint { pressure_mpa: f64::NAN, ..operator };
    let found = governor.decide(later, None, Some(&released), Some(&fresh(0.1)));
    assert_eq!((found.reason, found.pressure_mpa), (valve_reason::NO_SETPOINT, 0.0));
    let limited = Setpoint { valid_for_ns: 5 * MS, ..wants(0.02, 0) };
    assert_eq!(governor.decide(NOW + 6 * MS, None, Some(&limited), None).reason, valve_reason::NO_SETPOINT);
}

#[test]
fn after_a_failure_the_way_up_begins_at_the_safe_value() {
    let mut governor = governor("rate_mpa_per_s = 1.0");
    let decide = |governor: &mut Governor, at_ms| {
        governor.decide(NOW + at_ms * MS, Some(&wants(0.05, 0)), None, Some(&fresh(0.1)))
    };
    assert!((decide(&mut governor, 10).pressure_mpa - 0.01).abs() < 1e-12);
    assert!((decide(&mut governor, 20).pressure_mpa - 0.02).abs() < 1e-12);
    governor.failed(NOW + 35 * MS);
    assert!(
        (decide(&mut governor, 40).pressure_mpa - 0.005).abs() < 1e-12,
        "the wait for the device grants nothing"
    );
}

/// A controller learns by this reason that the valve has closed, and starts again.
#[test]
fn after_a_pause_a_new_setpoint_waits_for_one_turn() {
    let mut governor = governor("write_hz = 200.0");
    let mut decide = |at_ms: u64| {
        let at_ns = NOW + at_ms * MS;
        let setpoint = Setpoint { t_publish_ns: at_ns, ..wants(0.05, 0) };
        let state = State { t_sensor_ns: at_ns, ..fresh(0.1) };
        let found = governor.decide(at_ns, Some(&setpoint), None, Some(&state));
        (found.reason, found.pressure_mpa)
    };
    use valve_reason::{FOLLOWING, TIMEOUT};
    let decided = [5, 25, 46, 51].map(&mut decide);
    assert_eq!(decided, [(FOLLOWING, 0.05), (FOLLOWING, 0.05), (TIMEOUT, 0.0), (FOLLOWING, 0.05)]);
}

proptest! {
    /// Whatever comes: a value within the range; never faster than the rate, but for the way to the safe value.
    #[test]
    fn values_stay_within_range_and_rate(
        steps in prop::collection::vec((0_u64..30, -0.2..0.2_f64, 0_u64..80, 0.0..1.0_f64, any::<bool>(), 0_u64..120), 1..60)
    ) {
        let mut governor = governor("rate_mpa_per_s = 0.7\nforce_max_n = 0.8\nsafe_mpa = 0.01");
        let (mut now, mut last) = (NOW, 0.01);
        for (dt_ms, pressure_mpa, age_ms, force_n, is_override, state_age_ms) in steps {
            now += dt_ms * MS;
            // After four periods nobody knows what the device has.
            last = if dt_ms > 20 { 0.01 } else { last };
            let setpoint = Setpoint { t_publish_ns: now - age_ms * MS, ..wants(pressure_mpa, 0) };
            let operator = is_override.then_some(Setpoint { valid_for_ns: 0, ..setpoint });
            let state = State { t_sensor_ns: now - state_age_ms * MS, ..fresh(force_n) };
            let found = governor.decide(now, Some(&setpoint), operator.as_ref(), Some(&state));
            prop_assert!((0.0..=0.08).contains(&found.pressure_mpa));
            let is_moving = matches!(found.reason, valve_reason::FOLLOWING | valve_reason::OVERRIDE);
            if is_moving {
                prop_assert!((found.pressure_mpa - last).abs() <= 0.7e-3 * dt_ms as f64 + 1e-12);
            } else {
                prop_assert_eq!(found.pressure_mpa, 0.01);
            }
            if !is_override && (age_ms > 40 || state_age_ms > 50 || force_n > 0.8) {
                prop_assert!(!is_moving, "{:?}", found);
            }
            last = found.pressure_mpa;
        }
    }
}

#[test]
fn numbers_and_clocks_at_their_limits_never_open_the_valve() {
    let at = |now_ns: u64, setpoint: Setpoint| {
        let state = State { t_sensor_ns: now_ns, ..fresh(0.1) };
        Governor::new(&spec(""), now_ns, Arc::default())
            .decide(now_ns, Some(&setpoint), None, Some(&state))
            .reason
    };
    let last = Setpoint { seq: u64::MAX, valid_for_ns: u64::MAX, ..wants(0.05, 0) };
    assert_eq!(at(NOW, last), valve_reason::FOLLOWING, "the scene's longest validity counts");
    assert_eq!(at(NOW + 501 * MS, last), valve_reason::TIMEOUT);
    assert_eq!(at(u64::MAX, last), valve_reason::TIMEOUT);
    assert_eq!(at(u64::MAX, Setpoint { t_publish_ns: u64::MAX, ..last }), valve_reason::FOLLOWING);
    // A stamp of another clock is invalid, also if it never becomes old.
    assert_eq!(at(NOW, Setpoint { t_publish_ns: u64::MAX, ..last }), valve_reason::NO_SETPOINT);
    assert_eq!(at(NOW, Setpoint { t_publish_ns: 0, ..last }), valve_reason::TIMEOUT);
}
