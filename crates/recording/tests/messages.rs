//! The JSON form of every payload: validated by its schema, and read back bit-identical.

use proptest::prelude::*;
use recording::Channel;
use recording::message::{EncodeJson, FieldMessage, channel, decode, decode_field, decode_reading};
use serde_json::Value;
use wire::layout::{
    COEFFICIENTS_MAX, FINGERS_MAX, GROUPS_MAX, LAYOUT_VERSION, Layout, PARAMETERS_MAX, PAYLOADS, Payload,
    input_source, pack_name, set_slot, value_bits,
};
use wire::{
    Answer, Command, Estimate, FieldHeader, Grasp, Health, Query, SensorSample, Setpoint, State, Target,
    Valve,
};

fn json_schema(channel: &Channel) -> Value {
    let text = &channel.schema;
    serde_json::from_str(text).expect("a schema is JSON")
}

/// Violation of a schema by draft 7 of JSON Schema, for the keywords that our schemas use. `$ref` ignores its siblings.
fn violation(schema: &Value, root: &Value, value: &Value) -> Option<String> {
    if let Some(reference) = schema["$ref"].as_str() {
        let target = root.pointer(reference.trim_start_matches('#')).expect("a definition");
        return violation(target, root, value);
    }
    for word in schema.as_object().expect("an object").keys() {
        let known =
            ["$schema", "title", "description", "definitions", "contentEncoding", "type", "properties"];
        assert!(
            known.contains(&word.as_str()) || ["items", "anyOf", "enum"].contains(&word.as_str()),
            "{word}"
        );
    }
    if let Some(kind) = schema["type"].as_str() {
        let fits = match kind {
            "integer" => value.is_u64(),
            "number" => value.is_number(),
            "string" => value.is_string(),
            "array" => value.is_array(),
            "object" => value.is_object(),
            other => panic!("unexpected type {other}"),
        };
        if !fits {
            return Some(format!("expected {kind}, found {value}"));
        }
    }
    if let Some(values) = schema["enum"].as_array().filter(|values| !values.contains(value)) {
        return Some(format!("expected one of {values:?}, found {value}"));
    }
    if let Some(ways) = schema["anyOf"].as_array()
        && ways.iter().all(|way| violation(way, root, value).is_some())
    {
        return Some(format!("{value} fits nothing of {ways:?}"));
    }
    let items = value.as_array().into_iter().flatten();
    let inner = items.map(|item| (&schema["items"], item)).chain(
        value
            .as_object()
            .into_iter()
            .flatten()
            .filter_map(|(name, value)| Some((schema["properties"].get(name)?, value))),
    );
    inner.filter(|(schema, _)| schema.is_object()).find_map(|(schema, value)| violation(schema, root, value))
}

/// A message has the properties of its schema, each as the schema says.
fn check(layout: &Layout, message: &dyn EncodeJson) -> Value {
    let mut bytes = Vec::new();
    message.encode(&mut bytes);
    let value: Value = serde_json::from_slice(&bytes).expect("a message is JSON");
    let channel = channel(layout, "");
    let schema: Value = json_schema(&channel);
    assert_eq!(violation(&schema, &schema, &value), None, "{}: {value}", channel.schema_name);
    let properties = schema["properties"].as_object().expect("properties");
    assert!(value.as_object().expect("an object").keys().eq(properties.keys()), "{}", channel.schema_name);
    for (name, property) in properties {
        assert!(property["type"].is_string(), "{name}: viewers refuse what has no plain type");
    }
    value
}

/// A payload with every bit of every value set to something: `seed` decides.
fn filled<P: Payload>(seed: u64) -> P {
    let mut payload = P::default();
    let mut state = seed | 1;
    for byte in payload.bytes_mut() {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        *byte = (state >> 56) as u8;
    }
    payload
}

fn check_all<P: Payload>() {
    check(P::LAYOUT, &P::default().view());
    for seed in 0..50 {
        check(P::LAYOUT, &filled::<P>(seed).view());
    }
}

#[test]
fn every_payload_fits_its_schema_at_its_default_and_with_any_bits() {
    check_all::<SensorSample>();
    check_all::<State>();
    check_all::<Health>();
    check_all::<Grasp>();
    check_all::<Command>();
    check_all::<Estimate>();
    check_all::<Setpoint>();
    check_all::<Target>();
    check_all::<Valve>();
    check_all::<Query>();
    check_all::<Answer>();
    let header = FieldHeader { field_count: 2, ..FieldHeader::default() };
    check(FieldHeader::LAYOUT, &FieldMessage::new(&header, &[1.0, -2.5]));
    assert_eq!(PAYLOADS.len(), 12, "a new payload belongs into this test");
}

#[test]
fn non_finite_numbers_have_a_form_that_the_schema_allows() {
    let state = State { onset_pressure_mpa: f64::INFINITY, gap_mm: f64::NEG_INFINITY, ..State::default() };
    let value = check(State::LAYOUT, &state.view());
    assert_eq!(
        (&value["onset_pressure_mpa"], &value["gap_mm"], &value["force_halfwidth_n"]),
        (&"Infinity".into(), &"-Infinity".into(), &Value::Null)
    );
    let schema = json_schema(&channel(State::LAYOUT, ""));
    for wrong in ["\"nan\"", "\"NaN\"", "\"1.0\"", "[1.0]"] {
        let value = serde_json::from_str(&format!("{{\"gap_mm\":{wrong}}}")).expect("JSON");
        assert!(violation(&schema, &schema, &value).is_some(), "{wrong} must not fit");
    }
}

/// JSON form that recordings and scripts depend on.
#[test]
fn the_json_form_of_a_state_is_fixed() {
    let mut state = State {
        flags: 0b1000_0011,
        boot_id: 0x12,
        seq: 7,
        pressure_mpa: 0.1 + 0.2,
        force_halfwidth_n: 0.1,
        onset_pressure_mpa: f64::INFINITY,
        regime: 2,
        outcome: 4,
        domain_status: 1,
        coefficient_count: 2,
        actuator: pack_name("finger"),
        ..State::default()
    };
    (state.coefficients[0], state.coefficients[1], state.group_sizes[0]) = (0.5, -1.5, 2);
    (state.input_count, state.inputs[0], state.input_sources[0]) = (1, 2.5, input_source::GIVEN);
    set_slot(&mut state.input_names, 0, "gap_mm");
    let mut bytes = Vec::new();
    state.view().encode(&mut bytes);
    assert_eq!(
        String::from_utf8(bytes).expect("text"),
        "{\"seq\":7,\"sensor_seq\":0,\"t_sensor_ns\":0,\"t_publish_ns\":0,\"age_ns\":0,\
         \"pressure_mpa\":0.30000000000000004,\"gap_mm\":null,\"regime\":\"contact\",\"contact_force_n\":null,\
         \"force_halfwidth_n\":0.1,\"force_by_pressure_n_per_mpa\":null,\"force_by_gap_n_per_mm\":null,\
         \"onset_pressure_mpa\":\"Infinity\",\"displacement_halfwidth_mm\":null,\"von_mises_halfwidth_mpa\":null,\
         \"domain_distance\":null,\"domain_status\":1,\"input_names\":[\"gap_mm\"],\"inputs\":[2.5],\"outside_by\":[null],\
         \"force_by_input\":[null],\"observable_names\":[],\"observables\":[],\"observable_halfwidths\":[],\"observable_offsets\":[],\"group_sizes\":[2],\"coefficients\":[0.5,-1.5],\"measured_force_n\":null,\
         \"outcome\":\"held: stale\",\"flags\":[\"stale\",\"held\",\"no-data\"],\"flag_bits\":131,\"input_sources\":[\"given\"],\
         \"actuator\":\"finger\",\"model_hash\":\"00000000000000000000000000000000\",\
         \"boot_id\":\"0000000000000012\",\"sensor_boot_id\":\"0000000000000000\"}"
    );
}

#[test]
fn ages_and_faults_of_a_reading_come_back() {
    let mut aged =
        SensorSample { age_count: 11, stale_values: 0b1010, fault_values: 1, ..SensorSample::default() };
    (aged.ages_ns.force, aged.stale_total, aged.boot_id, aged.gap_mm) = (7_000_000, 12, 255, 40.0);
    let mut bytes = Vec::new();
    aged.view().encode(&mut bytes);
    let value: Value = serde_json::from_slice(&bytes).expect("JSON");
    assert_eq!(value["stale_values"], serde_json::json!(["gap", "marker1"]));
    assert_eq!(value["fault_values"], serde_json::json!(["pressure"]));
    let back = decode_reading(&bytes).expect("a reading");
    assert_eq!((back.ages_ns, back.stale_values, back.age_count), (aged.ages_ns, 0b1010, 11));
    assert_eq!((back.stale_total, back.boot_id, back.gap_mm), (12, 255, 40.0));
}

/// Named inputs of a reading come back with their names and ages.
#[test]
fn named_inputs_of_a_reading_come_back() {
    let old = br#"{"seq":3,"t_sensor_ns":9,"pressure_mpa":"NaN","gap_mm":"NaN"}"#;
    let mut reading = decode_reading(old).expect("a reading");
    assert_eq!((reading.input_count, reading.inputs().count()), (0, 0));
    assert!(reading.add_input("load_n", 2.6) && reading.add_input("thickness_mm", f64::NAN));
    (reading.input_ages_ns[1], reading.stale_values) = (7_000_000, value_bits::INPUT2);
    let mut bytes = Vec::new();
    reading.view().encode(&mut bytes);
    let text = String::from_utf8(bytes.clone()).expect("text");
    let inputs = r#""input_names":["load_n","thickness_mm"],"inputs":[2.6,null],"input_ages_ns":[0,7000000]"#;
    assert!(text.contains(inputs) && text.contains(r#""stale_values":["input2"]"#), "{text}");
    let back = decode_reading(&bytes).expect("a reading");
    let named: Vec<(String, u64)> = back.inputs().map(|(name, value)| (name, value.to_bits())).collect();
    assert_eq!(named[0], ("load_n".to_owned(), 2.6_f64.to_bits()));
    assert!(named[1].0 == "thickness_mm" && f64::from_bits(named[1].1).is_nan(), "{named:?}");
    assert_eq!((back.input_ages_ns, back.stale_values), (reading.input_ages_ns, value_bits::INPUT2));
    for number in 2..PARAMETERS_MAX {
        assert!(reading.add_input(&format!("x{number}_n"), 0.0));
    }
    assert!(!reading.add_input("too_many_n", 0.0), "no room for more");
}

#[test]
fn wrong_property_is_named_with_the_expected_value() {
    let error = decode::<State>(br#"{"pressure_mpa":"much"}"#).expect_err("not a number").to_string();
    assert!(error.contains("`pressure_mpa`"), "{error}");
    let error =
        decode_reading(br#"{"seq":1,"t_sensor_ns":2,"pressure_mpa":0.1}"#).expect_err("no gap").to_string();
    assert!(error.contains("`gap_mm`"), "{error}");
}

/// Payloads are read back unchanged; NaN payloads are not preserved.
#[test]
fn states_healths_grasps_and_headers_come_back() {
    let mut bytes = Vec::new();
    let mut state = State {
        layout_version: LAYOUT_VERSION,
        coefficient_count: COEFFICIENTS_MAX as u32,
        ..State::default()
    };
    for (index, coefficient) in state.coefficients.iter_mut().enumerate() {
        *coefficient = f32::from_bits(0x3f00_0001 + 0x0101_7f3b_u32.wrapping_mul(index as u32) % 0x3000_0000);
    }
    state.group_sizes = [16; GROUPS_MAX];
    (state.pressure_mpa, state.model_hash, state.flags) = (0.1, [0xab; 16], 0b11);
    state.view().encode(&mut bytes);
    let back: State = decode(&bytes).expect("a state");
    assert_eq!(back.coefficients.map(f32::to_bits), state.coefficients.map(f32::to_bits));
    assert_eq!(
        (back.group_sizes, back.model_hash, back.flags),
        (state.group_sizes, state.model_hash, state.flags)
    );
    let mut health = Health { received: 9, rate_hz: 12.5, ..Health::default() };
    health.outcomes[13] = 4;
    health.view().encode(&mut bytes);
    assert_eq!(decode::<Health>(&bytes).expect("health"), Health { sensor_boot_id: 0, ..health });
    let mut grasp = Grasp { finger_count: 2, scene: pack_name("grip"), mass_kg: 0.1, ..Grasp::default() };
    (grasp.forces_n[1], grasp.pressures_mpa[FINGERS_MAX - 1]) = (0.5, 0.0);
    grasp.view().encode(&mut bytes);
    let back: Grasp = decode(&bytes).expect("a grasp");
    assert_eq!((back.forces_n, back.finger_count, back.scene), (grasp.forces_n, 2, grasp.scene));
    let mut header = FieldHeader { field_count: 2, node_count: 3, ..FieldHeader::default() };
    (header.field_ids[0], header.field_ids[1]) = (1, 5);
    FieldMessage::new(&header, &[0.0; 6]).encode(&mut bytes);
    let (back, values) = decode_field(&bytes).expect("a field");
    assert_eq!((back.field_ids, back.entries(), values), (header.field_ids, 6, vec![0.0; 6]));
    FieldMessage::new(&header, &[0.0; 5]).encode(&mut bytes);
    assert!(decode_field(&bytes).is_err(), "fewer values than in the header");
}

proptest! {
    /// Any bits are read back identical; NaN payloads are not preserved.
    #[test]
    fn a_reading_is_read_back_bit_identical(numbers in prop::array::uniform4(any::<u64>()), ids in prop::array::uniform3(any::<u64>()), status in any::<u32>()) {
        let [pressure_mpa, gap_mm, measured_force_n, t_trace_s] = numbers.map(f64::from_bits);
        let [boot_id, seq, t_sensor_ns] = ids;
        let sample = SensorSample { boot_id, seq, t_sensor_ns, pressure_mpa, gap_mm, measured_force_n, t_trace_s, status, ..SensorSample::default() };
        let mut bytes = Vec::new();
        sample.view().encode(&mut bytes);
        let back = decode_reading(&bytes).expect("readable");
        let bits = |sample: &SensorSample| [sample.pressure_mpa, sample.gap_mm, sample.measured_force_n, sample.t_trace_s]
            .map(|value| if value.is_nan() { u64::MAX } else { value.to_bits() });
        prop_assert_eq!(bits(&back), bits(&sample));
        prop_assert_eq!((back.boot_id, back.seq, back.t_sensor_ns, back.status), (boot_id, seq, t_sensor_ns, status));
    }

    /// Markers come back with their count; one that was not seen stays NaN.
    #[test]
    fn markers_are_read_back_bit_identical(values in prop::collection::vec(any::<u64>(), 0..=24)) {
        let mut sample = SensorSample { seq: 1, marker_values: values.len() as u32, ..SensorSample::default() };
        let coordinates = sample.markers_mm.iter_mut().flat_map(|marker| [&mut marker.x, &mut marker.y, &mut marker.z]);
        for (to, from) in coordinates.zip(&values) {
            *to = f64::from_bits(*from);
        }
        let mut bytes = Vec::new();
        sample.view().encode(&mut bytes);
        let back = decode_reading(&bytes).expect("readable");
        prop_assert_eq!(back.marker_values, sample.marker_values);
        let coordinates = |sample: &SensorSample| sample.markers_mm.map(|marker| [marker.x, marker.y, marker.z]);
        for (back, was) in coordinates(&back).as_flattened().iter().zip(coordinates(&sample).as_flattened()) {
            prop_assert!(back.to_bits() == was.to_bits() || (back.is_nan() && was.is_nan()));
        }
    }

    /// Any `f32`, too.
    #[test]
    fn a_half_width_is_read_back_bit_identical(bits in any::<u32>()) {
        let force_halfwidth_n = f32::from_bits(bits);
        let mut bytes = Vec::new();
        State { force_halfwidth_n, ..State::default() }.view().encode(&mut bytes);
        let back = decode::<State>(&bytes).expect("readable").force_halfwidth_n;
        prop_assert!(back.to_bits() == bits || (back.is_nan() && force_halfwidth_n.is_nan()));
    }

    /// Anything at all where a reading should be: an error or a reading, never a panic.
    #[test]
    fn noise_is_no_reading(noise in prop::collection::vec(any::<u8>(), 0..200)) {
        prop_assert!(decode_reading(&noise).is_err());
    }
}
