//! Recordings as tables.

use recording::message::{self, EncodeJson};
use recording::{Channel, Ending, RecordingReader, TableForm, Writer, export_csv};
use wire::{KeyExpr, Payload, SensorSample, State};

fn recording() -> Vec<u8> {
    let mut writer = Writer::new(Vec::new()).expect("memory");
    let mut bytes = Vec::new();
    let sensor =
        writer.channel(&message::channel(SensorSample::LAYOUT, "softtwin/finger/sensor")).expect("a channel");
    let state = writer.channel(&message::channel(State::LAYOUT, "softtwin/finger/state")).expect("a channel");
    for seq in 0..3u64 {
        let pressure_mpa = [0.1 + 0.2, f64::NAN, 0.05][seq as usize];
        SensorSample { seq, pressure_mpa, gap_mm: 40.0, ..SensorSample::default() }.view().encode(&mut bytes);
        writer.message(sensor, seq as u32, 100 + seq, 90 + seq, &bytes).expect("memory");
        let mut coefficients = [0.0f32; wire::layout::COEFFICIENTS_MAX];
        coefficients[0] = 0.5;
        let known = State { seq, coefficient_count: 2, coefficients, flags: 0b11, ..State::default() };
        known.view().encode(&mut bytes);
        writer.message(state, seq as u32, 100 + seq, 95 + seq, &bytes).expect("memory");
    }
    writer.finish().expect("memory")
}

#[test]
fn each_topic_becomes_a_table_that_reads_back_to_the_bit() {
    let folder = tempfile::tempdir().expect("a folder");
    let bytes = recording();
    let key = KeyExpr::new("softtwin/**").expect("a key");
    let mut reader = RecordingReader::new(bytes.as_slice()).expect("a recording");
    let exported = export_csv(&mut reader, folder.path(), &key, TableForm::Whole).expect("written");
    assert_eq!((exported.rows.len(), exported.left_out, reader.ending()), (2, 0, Some(&Ending::Complete)));
    let text = std::fs::read_to_string(folder.path().join("softtwin.finger.sensor.csv")).expect("there");
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(
        lines[0],
        "log_time_ns,publish_time_ns,seq,t_sensor_ns,pressure_mpa,gap_mm,measured_force_n,markers_mm,t_trace_s,status,ages_ns,stale_values,fault_values,stale_total,input_names,inputs,input_ages_ns,boot_id"
    );
    assert_eq!(lines.len(), 4);
    let cells: Vec<&str> = lines[1].split(',').collect();
    assert_eq!(cells[..3], ["100", "90", "0"]);
    assert_eq!(cells[4].parse::<f64>().expect("a number").to_bits(), (0.1f64 + 0.2).to_bits());
    assert_eq!(lines[2].split(',').nth(4), Some(""), "absent");
    let state = std::fs::read_to_string(folder.path().join("softtwin.finger.state.csv")).expect("there");
    assert!(state.contains("stale held") && state.contains(",0.5 0.0,"), "{state}");
}

#[test]
fn a_topic_cannot_lead_out_of_the_folder_and_texts_are_quoted() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut writer = Writer::new(Vec::new()).expect("memory");
    let odd = writer
        .channel(&Channel { topic: "../../x/a b".into(), ..message::channel(SensorSample::LAYOUT, "") })
        .expect("a channel");
    writer.message(odd, 0, 0, 0, br#"{"note":"a \"b\", c","list":[],"none":null}"#).expect("memory");
    writer.message(odd, 0, 0, 0, b"no object").expect("memory");
    let bytes = writer.finish().expect("memory");
    let key = KeyExpr::new("**").expect("a key");
    let mut reader = RecordingReader::new(bytes.as_slice()).expect("a recording");
    let exported = export_csv(&mut reader, folder.path(), &key, TableForm::Whole).expect("written");
    assert_eq!(exported.left_out, 1);
    let path = folder.path().join("x.a.b.csv");
    assert_eq!(exported.rows.get(&path), Some(&1));
    let text = std::fs::read_to_string(path).expect("there");
    assert_eq!(text.lines().nth(1), Some(r#"0,0,"a ""b"", c",,"#));
}

#[test]
fn tables_for_fmi_hold_time_and_numbers_only() {
    let folder = tempfile::tempdir().expect("a folder");
    let bytes = recording();
    let key = KeyExpr::new("softtwin/*/sensor").expect("a key");
    let mut reader = RecordingReader::new(bytes.as_slice()).expect("a recording");
    export_csv(&mut reader, folder.path(), &key, TableForm::Fmi).expect("written");
    let text = std::fs::read_to_string(folder.path().join("softtwin.finger.sensor.csv")).expect("there");
    assert!(
        text.starts_with("time,seq,t_sensor_ns,pressure_mpa,gap_mm,measured_force_n,t_trace_s"),
        "{text}"
    );
    assert!(!text.lines().next().expect("a head").contains("boot_id"), "strings are left out");
    let times: Vec<&str> = text.lines().skip(1).filter_map(|line| line.split(',').next()).collect();
    assert_eq!(times, ["0", "0.000000001", "0.000000002"]);
    for cell in text.lines().skip(1).flat_map(|line| line.split(',')) {
        assert!(cell.parse::<f64>().is_ok(), "{cell}");
    }
}

#[test]
fn times_of_tables_for_fmi_go_on_where_the_clock_was_set_back() {
    const SECOND_NS: u64 = 1_000_000_000;
    let folder = tempfile::tempdir().expect("a folder");
    let mut writer = Writer::new(Vec::new()).expect("memory");
    let sensor =
        writer.channel(&message::channel(SensorSample::LAYOUT, "softtwin/finger/sensor")).expect("a channel");
    // An hour is taken from the clock after three rows; one row was sent a little before the one before it.
    let stamps_ns = [4000, 4001, 4002, 400, 401, 402].map(|s: u64| s * SECOND_NS);
    let stamps_ns = stamps_ns.into_iter().chain([402 * SECOND_NS - 5_000_000, 403 * SECOND_NS]);
    for (seq, stamp_ns) in (0..).zip(stamps_ns) {
        let mut bytes = Vec::new();
        SensorSample { seq, ..SensorSample::default() }.view().encode(&mut bytes);
        writer.message(sensor, seq as u32, stamp_ns, stamp_ns, &bytes).expect("memory");
    }
    let bytes = writer.finish().expect("memory");
    let key = KeyExpr::new("softtwin/**").expect("a key");
    let mut reader = RecordingReader::new(bytes.as_slice()).expect("a recording");
    export_csv(&mut reader, folder.path(), &key, TableForm::Fmi).expect("written");
    let text = std::fs::read_to_string(folder.path().join("softtwin.finger.sensor.csv")).expect("there");
    let times: Vec<f64> =
        text.lines().skip(1).map(|line| line.split(',').next().unwrap().parse().unwrap()).collect();
    assert_eq!(times, [0.0, 1.0, 2.0, 2.0, 3.0, 4.0, 4.0, 5.0]);
}
