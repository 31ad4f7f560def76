//! Tests of `src/source/mixed.rs` that need its private parts: time is what the updates say.

use super::*;
use crate::source::sensor::{Channel, Ended, Feed, connect};
use wire::layout::{Ages, Marker, value_bits};

const MS: u64 = 1_000_000;

/// A sensor of these slots with its feed.
fn sensor(name: &str, slots: &[usize], limit_ms: u64) -> (Feed, Input) {
    let channels = slots.iter().map(|slot| Channel::plain(*slot, 1.0)).collect();
    let (feed, inbox) = connect(name.into(), channels, Arc::default(), Ended::default());
    (feed, Input { name: name.into(), inbox, age_limit_ns: limit_ms * MS, ahead: None })
}

/// A gauge that sets the pace, a gap sensor, a camera with the second marker.
fn bench() -> (Mixed, Feed, Feed, Feed) {
    let ((gauge, a), (gap, b), (camera, c)) =
        (sensor("gauge", &[0], 50), sensor("gap", &[1], 100), sensor("camera", &[6, 7, 8], 200));
    let mut mixed = Mixed::new(vec![a, b, c], Pace::Sensor(0), &InputNames::default(), Devices::default());
    (mixed.start_ns, mixed.last_ns) = (1000 * MS, 1000 * MS);
    (mixed, gauge, gap, camera)
}

fn at(ms: u64) -> u64 {
    (1000 + ms) * MS
}

#[test]
fn values_of_different_rates_have_their_own_ages() {
    let (mut mixed, mut gauge, mut gap, mut camera) = bench();
    gap.send(at(1), [(0, 40.0)]);
    camera.send(at(3), [(0, 1.0), (1, 2.0), (2, 3.0)]);
    gauge.send(at(5), [(0, 0.01)]);
    gap.send(at(6), [(0, 41.0)]);
    gauge.send(at(15), [(0, 0.02)]);
    let first = mixed.next_of(0, at(20)).unwrap().sample;
    assert_eq!(
        (first.t_sensor_ns, first.pressure_mpa, first.gap_mm),
        (at(5), 0.01, 40.0),
        "41 mm came later"
    );
    assert_eq!(
        (first.age_count, first.marker_values, first.markers_mm[1]),
        (11, 6, Marker { x: 1.0, y: 2.0, z: 3.0 })
    );
    let markers = [0, 2 * MS, 0, 0, 0, 0, 0, 0];
    assert_eq!(first.ages_ns, Ages { pressure: 0, gap: 4 * MS, force: 0, markers });
    assert_eq!((first.stale_values, first.fault_values, first.status), (0, 0, 0));
    let second = mixed.next_of(0, at(20)).unwrap().sample;
    assert_eq!((second.t_sensor_ns, second.gap_mm), (at(15), 41.0));
    assert_eq!(
        (second.ages_ns.gap, second.ages_ns.markers[1]),
        (9 * MS, 12 * MS),
        "the camera's value is older by now"
    );
    assert_eq!(mixed.next_of(0, at(20)), None);
}

#[test]
fn a_value_older_than_its_limit_is_absent_flagged_and_counted_while_others_go_on() {
    let (mut mixed, mut gauge, mut gap, mut camera) = bench();
    gap.send(at(0), [(0, 40.0)]);
    camera.send(at(0), [(0, 1.0), (1, 2.0), (2, 3.0)]);
    let mut reading_at = |ms: u64| {
        gauge.send(at(ms), [(0, 0.03)]);
        mixed.next_of(0, at(ms)).unwrap().sample
    };
    assert_eq!(reading_at(100).gap_mm, 40.0, "just at its limit");
    let without = reading_at(101);
    assert!(without.gap_mm.is_nan() && without.pressure_mpa == 0.03 && without.markers_mm[1].x == 1.0);
    assert_eq!((without.stale_values, without.stale_total, without.ages_ns.gap), (0b10, 1, 101 * MS));
    assert_eq!(reading_at(201).stale_values, 0b10 | 1 << 4, "the camera, too");
    gap.send(at(202), [(0, 42.0)]);
    let back = reading_at(203);
    assert_eq!((back.gap_mm, back.stale_values, back.stale_total), (42.0, 1 << 4, 4));
    let stale = |at: usize| mixed.inputs[at].inbox.counters.stale.load(Ordering::Relaxed);
    assert_eq!([stale(0), stale(1), stale(2)], [0, 2, 2]);
}

/// Without the sensor that sets the pace a reading comes at its age limit, without its values, and continues from there.
#[test]
fn the_age_limit_takes_the_place_of_a_silent_pace() {
    let (mut mixed, mut gauge, mut gap, _camera) = bench();
    gauge.send(at(10), [(0, 0.03)]);
    assert_eq!(mixed.next_of(0, at(10)).unwrap().sample.status, 0);
    gap.send(at(55), [(0, 40.0)]);
    assert_eq!(mixed.next_of(0, at(59)), None);
    let alone = mixed.next_of(0, at(60) + 1).unwrap().sample;
    assert_eq!((alone.t_sensor_ns, alone.gap_mm, alone.ages_ns.gap), (at(60) + 1, 40.0, 5 * MS + 1));
    assert!(alone.pressure_mpa.is_nan());
    assert_eq!((alone.status, alone.stale_values & 1), (256, 1), "the pressure is marked as too old");
    assert_eq!(mixed.next_of(0, at(109)), None, "once in its age limit");
    assert!(mixed.next_of(0, at(111)).is_some());
    // Stamped before the last reading: no way back in time, but known from the next one on.
    gauge.send(at(100), [(0, 0.04)]);
    assert_eq!(mixed.next_of(0, at(112)), None);
    gauge.send(at(120), [(0, 0.05)]);
    let back = mixed.next_of(0, at(121)).unwrap().sample;
    assert_eq!((back.t_sensor_ns, back.pressure_mpa, back.status), (at(120), 0.05, 0));
}

#[test]
fn a_faulty_device_takes_away_its_own_values_only() {
    let (mut mixed, mut gauge, mut gap, mut camera) = bench();
    gap.send(at(1), [(0, 40.0)]);
    camera.send(at(1), [(0, 1.0), (1, f64::NAN), (2, 3.0)]);
    gauge.send(at(2), [(0, 0.03)]);
    let reading = mixed.next_of(0, at(2)).unwrap().sample;
    assert!(
        reading.markers_mm[1].y.is_nan() && reading.markers_mm[1].x == 1.0,
        "a coordinate that was not seen"
    );
    gap.fault(4);
    let t_ns = now_ns();
    gauge.send(t_ns, [(0, 0.03)]);
    let reading = mixed.next_of(0, t_ns).unwrap().sample;
    assert!(reading.gap_mm.is_nan() && reading.pressure_mpa == 0.03);
    assert_eq!((reading.status, reading.fault_values), (0, 0b10));
    gauge.fault(6);
    let reading = mixed.next_of(0, now_ns()).unwrap().sample;
    assert_eq!(
        (reading.status, reading.fault_values & 1),
        (6, 1),
        "without a pressure the reading is faulty"
    );
    assert!(reading.pressure_mpa.is_nan());
}

#[test]
fn before_the_first_answer_a_value_is_absent_and_flagged() {
    let (mut mixed, mut gauge, _gap, _camera) = bench();
    gauge.send(at(1), [(0, 0.03)]);
    let reading = mixed.next_of(0, at(1)).unwrap().sample;
    assert!(reading.gap_mm.is_nan() && reading.measured_force_n.is_nan());
    assert_eq!(reading.stale_values, 0b10 | 1 << 4, "not the force, which no sensor has");
}

/// A clock as the pace: due ticks, each with what was there at that time.
#[test]
fn a_fixed_rate_ticks_without_any_sensor() {
    let ((mut gauge, a), (_gap, b)) = (sensor("gauge", &[0], 50), sensor("gap", &[1], 100));
    let mut mixed = Mixed::new(vec![a, b], Pace::Period(10 * MS), &InputNames::default(), Devices::default());
    (mixed.start_ns, mixed.last_ns) = (now_ns() - 25 * MS, now_ns() - 25 * MS);
    let begin = mixed.last_ns;
    gauge.send(begin + 19 * MS, [(0, 0.03)]);
    let Poll::Reading(Reading { sample: reading, .. }) = mixed.poll(0.0) else { panic!("a tick is due") };
    let ticks = (reading.t_sensor_ns - begin) / (10 * MS);
    assert_eq!(reading.t_sensor_ns, begin + ticks * 10 * MS, "on the grid");
    assert!(ticks >= 2 && reading.pressure_mpa == 0.03);
    assert_eq!(reading.ages_ns.pressure, reading.t_sensor_ns - begin - 19 * MS);
    assert!(
        matches!(mixed.poll(7.0), Poll::Waiting { until_s } if (7.0..7.011).contains(&until_s)) || ticks > 2
    );
}

#[test]
fn named_inputs_have_ages_limits_and_faults_of_their_own() {
    let ((mut load, a), (mut shift, b)) = (sensor("load", &[NAMED], 50), sensor("shift", &[NAMED + 1], 20));
    let names = InputNames::new(["load_n", "shift_mm"]);
    let mut mixed = Mixed::new(vec![a, b], Pace::Sensor(0), &names, Devices::default());
    (mixed.start_ns, mixed.last_ns) = (1000 * MS, 1000 * MS);
    shift.send(at(1), [(0, 1.5)]);
    load.send(at(5), [(0, 2.0)]);
    let reading = mixed.next_of(0, at(6)).unwrap().sample;
    let named: Vec<(String, f64)> = reading.inputs().collect();
    assert_eq!(named, [("load_n".to_owned(), 2.0), ("shift_mm".to_owned(), 1.5)]);
    assert_eq!((reading.input_ages_ns[..2].to_vec(), reading.status), (vec![0, 4 * MS], 0));
    assert_eq!((reading.stale_values, reading.fault_values, reading.marker_values), (0, 0, 0));
    load.send(at(30), [(0, 2.5)]);
    let reading = mixed.next_of(0, at(31)).unwrap().sample;
    assert!(reading.inputs[0] == 2.5 && reading.inputs[1].is_nan(), "{reading:?}");
    assert_eq!((reading.stale_values, reading.stale_total), (value_bits::INPUT2, 1));
    load.fault(7);
    shift.send(now_ns(), [(0, 1.0)]);
    let reading = mixed.next_of(0, now_ns()).unwrap().sample;
    assert!(reading.inputs[0].is_nan() && reading.fault_values == value_bits::INPUT1, "{reading:?}");
}
