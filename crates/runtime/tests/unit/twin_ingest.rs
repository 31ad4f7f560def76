//! Tests of `src/twin/ingest.rs` that need its private parts.

use super::*;
use rom::inputs::InputSpec;

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

/// A model over pressure and gap.
fn needed(gap: Gap) -> Needed {
    Needed { gap, depends: Needs { pressure: true, gap: true }, measured: MeasuredInputs::default() }
}

fn validator() -> Validator {
    let mut validator = Validator::new(Limits::default(), needed(Gap::Range { min: 30.0, max: 60.0 }));
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
        // "late": the same stamp, checked two seconds later.
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
fn jumps_are_counted_and_restarts_reset_the_numbers() {
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

/// A sender that begins to count elsewhere has lost nothing.
#[test]
fn a_jump_beyond_what_a_pause_can_lose_is_a_restart() {
    let mut validator = validator();
    let after = |seq: u64| SensorSample { seq: (1 << 40) + seq, ..good(20 + seq) };
    let checks = [0, 1, 2, 3].map(|seq| validator.validate(&after(seq), NOW));
    assert!(checks.iter().all(|check| check.missed == 0), "{checks:?}");
    assert_eq!(checks.map(|check| check.restarted), [false, false, true, false]);
    assert_eq!(checks[2].rejection, None);
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
    // Also where the reading is rejected for something else.
    for (seq, spoilt) in [
        (13, SensorSample { status: 1, ..future }),
        (15, SensorSample { pressure_mpa: f64::NAN, ..future }),
        (17, SensorSample { pressure_mpa: 1e9, ..future }),
    ] {
        let spoilt = SensorSample { seq, t_sensor_ns: u64::MAX, ..spoilt };
        assert!(validator.validate(&spoilt, NOW).rejection.is_some());
        assert_eq!(validator.validate(&good(seq + 1), NOW).rejection, None, "{spoilt:?}");
    }
}

#[test]
fn a_fixed_gap_needs_no_measured_one() {
    let mut validator = Validator::new(Limits::default(), needed(Gap::Fixed(40.0)));
    let blind = SensorSample { gap_mm: f64::NAN, ..good(1) };
    assert_eq!(validator.validate(&blind, NOW).rejection, None);
    assert_eq!(validator.gap_mm(&blind), 40.0);
}

/// A model over load and thickness alone: the load is measured, within a range.
fn structure() -> Validator {
    let spec = toml::from_str(
        "name = \"beam\"\nmodel = \"beam.twin\"\n[inputs]\nload_n = { min = 0, max = 4 }\nthickness_mm = 7.3\n",
    )
    .expect("an actuator");
    let input = |name: &str, unit: &str, value, range| InputSpec {
        name: name.into(),
        unit: unit.into(),
        range,
        value,
    };
    let nowhere = [f64::NEG_INFINITY, f64::INFINITY];
    let inputs = [
        input("pressure", "MPa", None, nowhere),
        input("gap", "mm", None, nowhere),
        input("thickness_mm", "mm", Some(7.0), [6.0, 9.0]),
        input("load_n", "N", Some(2.0), [1.0, 4.0]),
    ];
    let measured = MeasuredInputs::new(&spec, &inputs);
    Validator::new(
        Limits::default(),
        Needed { gap: spec.gap_mm, depends: Needs { pressure: false, gap: false }, measured },
    )
}

/// A reading of that structure, with other values before the load.
fn loaded(load_n: f64) -> SensorSample {
    let mut sample = SensorSample { pressure_mpa: f64::NAN, gap_mm: f64::NAN, ..good(11) };
    assert!(sample.add_input("shift_mm", 0.5) && sample.add_input("load_n", load_n));
    sample
}

#[test]
fn a_measured_input_is_validated_as_the_pressure_is() {
    let check = |sample: SensorSample| structure().validate(&sample, NOW).rejection;
    assert_eq!(check(loaded(2.5)), None);
    for (load_n, outcome) in [
        (f64::NAN, Outcome::HeldNotFinite),
        (f64::INFINITY, Outcome::HeldNotFinite),
        (-0.01, Outcome::HeldInputOutsideScene),
        (4.01, Outcome::HeldInputOutsideScene),
    ] {
        assert_eq!(check(loaded(load_n)), Some(outcome), "{load_n}");
        assert!(outcome.is_held());
    }
    let nameless = SensorSample { input_count: 0, ..loaded(2.5) };
    assert_eq!(check(nameless), Some(Outcome::HeldNotFinite), "a reading without it");
    let stale = SensorSample { t_sensor_ns: NOW - 2_000_000_000, ..loaded(2.5) };
    assert_eq!(check(stale), Some(Outcome::HeldStale));
    assert_eq!(check(SensorSample { status: 3, ..loaded(2.5) }), Some(Outcome::HeldSensorFault));
    let inputs = structure().inputs(&loaded(2.5));
    assert_eq!((inputs.pressure_mpa(), inputs.gap_mm(), inputs.values()[3]), (0.0, f64::INFINITY, 2.5));
    assert!(inputs.values()[2].is_nan(), "the given one is the model's business");
}

#[test]
fn irrelevant_inputs_may_be_absent_but_not_absurd() {
    let check = |sample: SensorSample| structure().validate(&sample, NOW).rejection;
    let with = SensorSample { pressure_mpa: 0.03, gap_mm: 40.0, ..loaded(2.5) };
    assert_eq!(check(with), None);
    let inputs = structure().inputs(&with);
    assert_eq!((inputs.pressure_mpa(), inputs.gap_mm()), (0.03, 40.0), "published unchanged");
    assert_eq!(check(SensorSample { pressure_mpa: 5.0, ..loaded(2.5) }), Some(Outcome::HeldAbsurd));
    assert_eq!(check(SensorSample { gap_mm: -1.0, ..loaded(2.5) }), Some(Outcome::HeldAbsurd));
    assert_eq!(check(SensorSample { gap_mm: f64::INFINITY, ..loaded(2.5) }), Some(Outcome::HeldNotFinite));
}
