//! Faults of a rig, each with its alarm within two seconds, and no alarm without a fault.

use crate::model::{Finger, GAP, PRESSURE, Random, setup_with_middle};
use estimate::{Alarm, Filter, InputRole, MAX_INPUTS, Measurement, Model, Predicted, Setup};

const RATE_HZ: f64 = 200.0;
const TRUTH: [f64; 2] = [42.0, 0.84]; // gap in mm, stiffness in MPa
/// Begin of the faults of a running rig (s).
const BEGIN_S: f64 = 15.0;

/// True values of one reading, which a fault changes.
struct Instant {
    t_s: f64,
    /// Pressure in the actuator and pressure at the gauge, MPa.
    pressure: f64,
    gauge: f64,
    gap: f64,
    /// Force, then x and y of tip and middle.
    rows: [f64; 5],
}

/// An inflation of 10 s, then breathing; two markers. The sensors are those of the shipped scene.
fn rig() -> Setup {
    let mut setup = setup_with_middle();
    for row in &mut setup.rows {
        row.model_sigma = if row.block == 0 { 0.006 } else { 0.1 };
    }
    setup.model_correlation_s = 10.0;
    setup
}

fn pressure(t_s: f64) -> f64 {
    if t_s < 10.0 { 0.01 * t_s } else { 0.08 + 0.02 * (0.5 * std::f64::consts::TAU * (t_s - 10.0)).cos() }
}

/// Runs for `seconds`; returns time and kind of the first alarm.
fn first_alarm(
    setup: Setup,
    seconds: f64,
    before: impl Fn(&mut Instant),
    after: impl Fn(&mut Instant),
) -> Option<(f64, Alarm)> {
    let (changes, _) = alarms(setup, seconds, before, after);
    changes.into_iter().find_map(|(t_s, alarm)| Some((t_s, alarm?)))
}

/// Runs for `seconds`; returns the changes of the alarm with their times, and the filter at the end.
fn alarms(
    setup: Setup,
    seconds: f64,
    before: impl Fn(&mut Instant),
    after: impl Fn(&mut Instant),
) -> (Vec<(f64, Option<Alarm>)>, Filter) {
    let mut changes: Vec<(f64, Option<Alarm>)> = Vec::new();
    let mut random = Random(91);
    let mut filter = Filter::new(setup).expect("a valid setup");
    for k in 0..(seconds * RATE_HZ) as usize {
        let t_s = k as f64 / RATE_HZ;
        let read = pressure(t_s) + 0.0009;
        let mut now = Instant { t_s, pressure: pressure(t_s), gauge: read, gap: TRUTH[0], rows: [0.0; 5] };
        before(&mut now);
        let (mut inputs, mut predicted) = ([f64::NAN; MAX_INPUTS], [Predicted::default(); 5]);
        inputs[..3].copy_from_slice(&[now.pressure, now.gap, TRUTH[1]]);
        Finger.predict(&inputs, &mut predicted);
        for (row, predicted) in now.rows.iter_mut().zip(&predicted) {
            *row = predicted.value;
        }
        after(&mut now);
        let mut reading = Measurement::at(t_s);
        reading.inputs[PRESSURE] = now.gauge + 0.0005 * random.normal();
        for (row, (value, sigma)) in now.rows.iter().zip([0.005, 0.2, 0.2, 0.2, 0.2]).enumerate() {
            reading.rows[row] = value + sigma * random.normal();
        }
        for marker in [1..3, 3..5] {
            let missing = random.uniform() < 0.1;
            let outlier = random.uniform() < 0.01;
            if missing {
                reading.rows[marker].fill(f64::NAN);
            } else if outlier {
                reading.rows[marker.start] += 30.0;
            }
        }
        let alarm = filter.update(&reading, &mut Finger).alarm;
        if alarm != changes.last().and_then(|(_, last)| *last) {
            changes.push((t_s, alarm));
        }
    }
    (changes, filter)
}

/// Alarm within two seconds of a fault in a running rig.
fn of_running_rig(before: impl Fn(&mut Instant), after: impl Fn(&mut Instant)) -> Alarm {
    let (t_s, alarm) = first_alarm(rig(), BEGIN_S + 2.0, before, after).expect("an alarm within two seconds");
    assert!(t_s >= BEGIN_S, "{alarm:?} at {t_s} s, before the fault");
    alarm
}

fn wrong_pressure_or_not_explained(fault: impl Fn(&mut Instant)) {
    let alarm = of_running_rig(fault, |_| {});
    assert!(matches!(alarm, Alarm::Input(0b1) | Alarm::NotExplained), "{alarm:?}");
}

#[test]
fn noise_without_fault_raises_no_alarm_in_ten_minutes() {
    assert_eq!(first_alarm(rig(), 600.0, |_| {}, |_| {}), None);
}

#[test]
fn leak_behind_the_gauge_is_a_wrong_pressure_or_not_explained() {
    let leak = |now: &mut Instant| {
        let open_s = (now.t_s - BEGIN_S).max(0.0);
        now.pressure *= 1.0 - 0.15 * (1.0 - (-open_s / 0.3).exp());
    };
    wrong_pressure_or_not_explained(leak);
}

#[test]
fn blocked_tube_is_a_wrong_pressure_or_not_explained() {
    let blocked = |now: &mut Instant| now.pressure = pressure(now.t_s.min(BEGIN_S));
    wrong_pressure_or_not_explained(blocked);
}

#[test]
fn drifted_gauge_is_a_wrong_pressure() {
    let slipped = |now: &mut Instant| now.gauge += if now.t_s < BEGIN_S { 0.0 } else { 0.005 };
    assert_eq!(of_running_rig(slipped, |_| {}), Alarm::Input(1 << PRESSURE));
}

#[test]
fn unzeroed_load_cell_is_named() {
    let shifted = |now: &mut Instant| now.rows[0] += 0.06;
    let (t_s, alarm) = first_alarm(rig(), 2.0, |_| {}, shifted).expect("an alarm within two seconds");
    assert_eq!(alarm, Alarm::Sensor(0b1), "at {t_s} s");
}

/// The marker is back after two seconds: the alarm stands for as long as the setup says, without changing meanwhile.
#[test]
fn alarm_stands_until_its_evidence_is_gone_for_the_stated_time() {
    let slipped = |now: &mut Instant| {
        let is_off = (BEGIN_S..BEGIN_S + 2.0).contains(&now.t_s);
        now.rows[1] += if is_off { 8.0 } else { 0.0 };
    };
    let (changes, _) = alarms(rig(), BEGIN_S + 16.0, |_| {}, slipped);
    let [(raised_s, raised), (ended_s, None)] = changes[..] else { panic!("two changes: {changes:?}") };
    assert_eq!(raised, Some(Alarm::Sensor(0b10)), "at {raised_s} s");
    let stood_s = ended_s - (BEGIN_S + 2.0);
    assert!((rig().alarm_hold_s..rig().alarm_hold_s + 2.0).contains(&stood_s), "{changes:?}");
}

#[test]
fn wrong_gap_is_not_explained() {
    let mut setup = rig();
    setup.inputs[GAP] = InputRole::Given(TRUTH[0] + 4.0);
    setup.unknowns.remove(0);
    setup.inputs[PRESSURE] =
        InputRole::Measured { sigma: 0.0005, bias: Some(0), rate_change: None, pasts: [None; 2] };
    setup.inputs[2] = InputRole::Estimated(1);
    let onset_s = 100.0 * Finger::onset_mpa(TRUTH[0], TRUTH[1]);
    let (t_s, alarm) =
        first_alarm(setup, onset_s + 2.0, |_| {}, |_| {}).expect("an alarm within two seconds");
    assert!(t_s >= onset_s, "{alarm:?} at {t_s} s, before the contact at {onset_s} s");
    assert_eq!(alarm, Alarm::NotExplained, "at {t_s} s");
}

#[test]
fn swapped_markers_are_not_explained() {
    let swapped = |now: &mut Instant| {
        if now.t_s >= BEGIN_S {
            let [_, tip @ .., mx, my] = &mut now.rows;
            std::mem::swap(&mut tip[0], mx);
            std::mem::swap(&mut tip[1], my);
        }
    };
    assert_eq!(of_running_rig(|_| {}, swapped), Alarm::NotExplained);
}

/// Kilopascals of play between gauge and actuator: while the pressure turns, the actuator keeps its own.
fn with_play(play_kpa: f64) -> impl Fn(&mut Instant) {
    let held = std::cell::Cell::new(0.0_f64);
    move |now: &mut Instant| {
        let half = 0.5e-3 * play_kpa;
        held.set(held.get().clamp(now.pressure - half, now.pressure + half));
        now.pressure = held.get();
    }
}

fn with_lag(lag_s: f64) -> impl Fn(&mut Instant) {
    let held = std::cell::Cell::new(0.0_f64);
    move |now: &mut Instant| {
        held.set(held.get() + (now.pressure - held.get()) / (lag_s * RATE_HZ));
        now.pressure = held.get();
    }
}

#[test]
fn play_and_lag_are_not_explained() {
    let found: Vec<_> = [2.0, 3.0, 5.0]
        .map(|kpa| first_alarm(rig(), 40.0, with_play(kpa), |_| {}))
        .into_iter()
        .chain([0.3, 0.6, 1.2].map(|lag_s| first_alarm(rig(), 40.0, with_lag(lag_s), |_| {})))
        .collect();
    assert!(found.iter().all(Option::is_some), "{found:?}");
}

/// A gap that may drift, and moves by 6 mm at once: that is what is named, and no sensor.
#[test]
fn moved_gap_is_named_before_a_sensor() {
    let mut setup = rig();
    setup.unknowns[0].drift_per_sqrt_s = 0.1;
    let moved = |now: &mut Instant| now.gap += if now.t_s < BEGIN_S { 0.0 } else { 6.0 };
    let (changes, filter) = alarms(setup, BEGIN_S + 16.0, moved, |_| {});
    let [(raised_s, raised), (_, None)] = changes[..] else { panic!("two changes: {changes:?}") };
    assert!((BEGIN_S..BEGIN_S + 2.0).contains(&raised_s), "{changes:?}");
    assert_eq!(raised, Some(Alarm::Unknown(0b1)));
    let gap = filter.estimates().next().expect("the gap");
    assert!((gap.value - TRUTH[0] - 6.0).abs() < 3.0 * gap.sigma && gap.sigma < 0.5, "{gap:?}");
}

/// A marker that slips is no moved gap, although the gap may drift.
#[test]
fn slipped_marker_is_named_where_the_gap_may_drift() {
    let mut setup = rig();
    setup.unknowns[0].drift_per_sqrt_s = 0.1;
    let slipped = |now: &mut Instant| now.rows[1] += if now.t_s < BEGIN_S { 0.0 } else { 8.0 };
    let (changes, filter) = alarms(setup, BEGIN_S + 10.0, |_| {}, slipped);
    let [(_, raised)] = changes[..] else { panic!("one change: {changes:?}") };
    assert_eq!(raised, Some(Alarm::Sensor(0b10)), "{changes:?}");
    let gap = filter.estimates().next().expect("the gap");
    assert!((gap.value - TRUTH[0]).abs() < 3.0 * gap.sigma, "{gap:?}");
}
