//! Tests of `src/estimation.rs` that need its private parts.

use super::*;
use wire::layout::{AGES_MAX, Ages};

const ALL_NEW: NewValues = NewValues::ALL;

#[test]
fn measurement_repeated_in_later_readings_is_new_once() {
    let mut used = LastUsed::default();
    let mut reading =
        SensorSample { age_count: AGES_MAX as u32, t_sensor_ns: 1000, ..SensorSample::default() };
    (reading.ages_ns.force, reading.ages_ns.markers[1]) = (10, 300);
    assert_eq!(used.new_in(&reading), ALL_NEW);
    reading.t_sensor_ns = 1500;
    reading.ages_ns = Ages { pressure: 500, gap: 500, force: 510, markers: [500; MARKERS_MAX] };
    reading.ages_ns.markers[1] = 400; // measured again
    let new = used.new_in(&reading);
    assert_eq!((new.force, new.markers[1]), (false, true));
    let without_ages = SensorSample { t_sensor_ns: 10, ..SensorSample::default() };
    assert_eq!(used.new_in(&without_ages), ALL_NEW);
}
