//! Tests of `src/twin/ingest.rs` that need its private parts.

use super::*;

const NOW: u64 = 10_000_000_000;

fn good(seq: u64) -> SensorSample {
    SensorSample {
        boot_id: 7,
        seq,
        t_sensor_ns: NOW - 1_000_000 + seq,
        pressure_mpa: 0.03,
        gap_mm: 40.0,
        ..SensorSample::default()
    }
}

fn validator() -> Validator {
    let mut validator = Validator::new(Limits::default(), Gap::Range { min: 30.0, max: 60.0 });
    assert_eq!(
        validator.validate(&good(10), NOW),
        SampleCheck { rejection: None, missed: 0, restarted: true }
    );
    validator
}

#[test]
fn every_bad_reading_has_its_outcome() {
    let cases: [(&str, SensorSample, Outcome); 13] = [
        ("NaN pressure", SensorSample { pressure_mpa: f64::NAN, ..good(11) }, Outcome::HeldNotFinite),
        (
            "infinite pressure",
            SensorSample { pressure_mpa: f64::INFINITY, ..good(11) },
            Outcome::HeldNotFinite,
        ),
        ("NaN gap", SensorSample { gap_mm: f64::NAN, ..good(11) }, Outcome::HeldNotFinite),
        ("negative pressure", SensorSample { pressure_mpa: -0.02, ..good(11) }, Outcome::HeldAbsurd),
        ("absurd pressure", SensorSample { pressure_mpa: 5.0, ..good(11) }, Outcome::HeldAbsurd),
        ("negative gap", SensorSample { gap_mm: -1.0, ..good(11) }, Outcome::HeldAbsurd),
        ("absurd gap", SensorSample { gap_mm: 1e6, ..good(11) }, Outcome::HeldAbsurd),
        ("gap beyond the scene", SensorSample { gap_mm: 61.0, ..good(11) }, Outcome::HeldOutsideScene),
        ("sensor fault", SensorSample { status: 3, ..good(11) }, Outcome::HeldSensorFault),
        ("late", SensorSample { t_sensor_ns: NOW - 990_000, ..good(11) }, Outcome::HeldStale),
        ("from the future", SensorSample { t_sensor_ns: NOW + 200_000_000, ..good(11) }, Outcome::HeldFuture),
        ("repeated", good(10), Outcome::DroppedDuplicate),
        ("earlier sequence", good(9), Outcome::DroppedBackInTime),
    ];
    for (name, sample, expected) in cases {
        // "late": the same stamp, looked at two seconds later.
        let now = if expected == Outcome::HeldStale { NOW + 2_000_000_000 } else { NOW };
        assert_eq!(validator().validate(&sample, now).rejection, Some(expected), "{name}");
    }
    let mut validator = validator();
    let earlier = SensorSample { t_sensor_ns: NOW - 2_000_000, ..good(11) };
    assert_eq!(
        validator.validate(&earlier, NOW).rejection,
        Some(Outcome::DroppedBackInTime),
        "time goes back"
    );
    assert_eq!(validator.validate(&good(12), NOW).rejection, None, "the next good reading is accepted");
}

#[test]
fn jumps_are_counted_and_restarts_begin_anew() {
    let mut validator = validator();
    assert_eq!(validator.validate(&good(15), NOW).missed, 4);
    let restarted = SensorSample { boot_id: 8, seq: 1, t_sensor_ns: NOW - 5_000_000, ..good(1) };
    assert_eq!(
        validator.validate(&restarted, NOW),
        SampleCheck { rejection: None, missed: 0, restarted: true }
    );
}

/// One wrong number, however large, costs that reading and no other; a pause of any length costs two.
#[test]
fn a_jump_of_the_sequence_is_a_fault_of_that_reading_alone() {
    for wrong in [u64::MAX, u64::MAX - 1, 1 << 40, 11 + MAX_JUMP] {
        let mut validator = validator();
        let jump = SensorSample { seq: wrong, ..good(11) };
        let check = validator.validate(&jump, NOW);
        assert_eq!((check.rejection, check.missed), (Some(Outcome::DroppedSequenceJump), 0), "{wrong}");
        assert_eq!(validator.validate(&good(12), NOW).missed, 1, "{wrong}");
        assert_eq!(validator.validate(&good(13), NOW).rejection, None);
    }
    let mut validator = validator();
    let after = |seq: u64| SensorSample { seq: 1_000_000 + seq, ..good(20 + seq) };
    let expected = [Some(Outcome::DroppedSequenceJump), Some(Outcome::DroppedSequenceJump), None, None];
    for (seq, expected) in (0..).zip(expected) {
        let check = validator.validate(&after(seq), NOW);
        assert_eq!(check.rejection, expected, "{seq}");
        assert_eq!(check.missed, if seq == 2 { 999_989 } else { 0 }, "10 was the last before 1000000");
    }
}

#[test]
fn a_run_that_begins_with_a_wrong_number_recovers() {
    let mut validator = validator();
    let first = SensorSample { boot_id: 8, seq: 1 << 40, ..good(11) };
    assert_eq!(validator.validate(&first, NOW).rejection, None);
    let rejections: Vec<bool> = (1..6)
        .map(|seq| SensorSample { boot_id: 8, seq, ..good(20 + seq) })
        .map(|sample| validator.validate(&sample, NOW).rejection.is_some())
        .collect();
    assert!(!rejections[2..].contains(&true), "{rejections:?}");
}

#[test]
fn a_stamp_from_the_future_does_not_age_the_readings_after_it() {
    let mut validator = validator();
    let future = SensorSample { t_sensor_ns: NOW + 3_600_000_000_000, ..good(11) };
    assert_eq!(validator.validate(&future, NOW).rejection, Some(Outcome::HeldFuture));
    assert_eq!(validator.validate(&good(12), NOW).rejection, None);
}

#[test]
fn a_fixed_gap_needs_no_measured_one() {
    let mut validator = Validator::new(Limits::default(), Gap::Fixed(40.0));
    let blind = SensorSample { gap_mm: f64::NAN, ..good(1) };
    assert_eq!(validator.validate(&blind, NOW).rejection, None);
    assert_eq!(validator.gap_mm(&blind), 40.0);
}
