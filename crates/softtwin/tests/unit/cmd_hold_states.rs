use super::*;
use control::held::ControlledActuator;

/// Without a gap a force has none to be held at; what moves freely needs none, and an option or an estimate replaces the sensor.
#[test]
fn unknown_gap_is_none_for_a_force_only() {
    let model = rom::model::Model::from_bytes(::tests::stage::model_bytes()).unwrap();
    let held = |column| Held::new(&ControlledActuator::default(), model.clone(), column).unwrap();
    let (force, tip) = (held("force_n"), held("tip_y_mm"));
    let state = |gap_mm: f64| State { gap_mm, ..State::default() };
    assert_eq!(state_gap_mm(&state(f64::NAN), None, &force), None);
    assert_eq!(state_gap_mm(&state(f64::NAN), Some(30.0), &force), Some(30.0));
    assert_eq!(state_gap_mm(&state(25.0), Some(30.0), &force), Some(25.0));
    assert_eq!(state_gap_mm(&state(f64::NAN), None, &tip), Some(OUT_OF_REACH_MM));
}

/// A twin without its bridge goes on with states that hold the last reading: they are no reading.
#[test]
fn silence_counts_from_the_last_good_reading() {
    let state = |flags: u32| State { flags, ..State::default() };
    let mut silence = Silence::begin();
    assert!(silence.has_reading(&state(0)).unwrap());
    assert!(!silence.has_reading(&state(flags::HELD | flags::STALE)).unwrap());
    let old = Instant::now().checked_sub(2 * SILENCE).unwrap();
    let mut silence = Silence { since: old, ..silence };
    silence.has_reading(&state(flags::HELD)).unwrap_err();
    silence.left().unwrap_err();
    assert!(silence.has_reading(&state(0)).unwrap() && silence.left().is_ok());
}
