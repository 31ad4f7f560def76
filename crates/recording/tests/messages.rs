//! The JSON form of every payload against its schema, and readings back to the bit.

use std::collections::BTreeSet;

use proptest::prelude::*;
use recording::message::{FieldMessage, HealthMessage, Recorded, SensorMessage, StateMessage};
use serde_json::Value;
use wire::{FieldHeader, Health, SensorSample, State};

/// Same properties in message and schema, each of the type the schema promises. Numbers may be texts: not finite.
fn check<M: Recorded>(message: &M) {
    let mut bytes = Vec::new();
    message.encode(&mut bytes);
    let value: Value = serde_json::from_slice(&bytes).expect("a message is JSON");
    let schema: Value = serde_json::from_str(&M::schema_json()).expect("a schema is JSON");
    let promised = schema["properties"].as_object().expect("properties");
    let found = value.as_object().expect("an object");
    let names = |map: &serde_json::Map<String, Value>| map.keys().cloned().collect::<BTreeSet<_>>();
    assert_eq!(names(found), names(promised), "{}", M::SCHEMA_NAME);
    for (name, value) in found {
        let kind = promised[name]["type"].as_str().expect("a type");
        let fits = match kind {
            "integer" => value.is_u64(),
            "number" => {
                value.is_f64()
                    || value.is_u64()
                    || matches!(value.as_str(), Some("NaN" | "Infinity" | "-Infinity"))
            }
            "string" => value.is_string(),
            "array" => value.is_array(),
            "object" => value.is_object(),
            other => panic!("{name}: {other} is no type this project promises"),
        };
        assert!(fits, "{} {name}: expected {kind}, found {value}", M::SCHEMA_NAME);
    }
}

#[test]
fn every_message_is_what_its_schema_promises() {
    check(&SensorMessage::from(&SensorSample::default()));
    check(&StateMessage::from(&State { onset_pressure_mpa: f64::INFINITY, flags: 0xff, ..State::default() }));
    check(&HealthMessage::from(&Health { flags: 3, ..Health::default() }));
    check(&FieldMessage::new(&FieldHeader { field_count: 2, ..FieldHeader::default() }, &[1.0, -2.5]));
}

proptest! {
    /// Any bits: what is replayed is what was read (one NaN is as good as another).
    #[test]
    fn a_reading_comes_back_to_the_bit(numbers in prop::array::uniform4(any::<u64>()), ids in prop::array::uniform3(any::<u64>()), status in any::<u32>()) {
        let [pressure_mpa, gap_mm, measured_force_n, t_trace_s] = numbers.map(f64::from_bits);
        let [boot_id, seq, t_sensor_ns] = ids;
        let sample = SensorSample { boot_id, seq, t_sensor_ns, pressure_mpa, gap_mm, measured_force_n, t_trace_s, status, reserved: 0 };
        let mut bytes = Vec::new();
        SensorMessage::from(&sample).encode(&mut bytes);
        let back = SensorMessage::decode(&bytes).expect("readable").sample();
        let bits = |sample: &SensorSample| [sample.pressure_mpa, sample.gap_mm, sample.measured_force_n, sample.t_trace_s]
            .map(|value| if value.is_nan() { u64::MAX } else { value.to_bits() });
        prop_assert_eq!(bits(&back), bits(&sample));
        prop_assert_eq!((back.boot_id, back.seq, back.t_sensor_ns, back.status), (boot_id, seq, t_sensor_ns, status));
    }

    /// Anything at all where a reading should be: an error or a reading, never a panic.
    #[test]
    fn noise_is_no_reading(noise in prop::collection::vec(any::<u8>(), 0..200)) {
        prop_assert!(SensorMessage::decode(&noise).is_err());
    }
}
