//! Pictures and series of a recording.

use recording::{Channel, Store, Writer};
use serde_json::json;
use std::path::Path;
use std::process::{Command, Output};

/// Thirty states and, if wanted, fields of two nodes, 0.1 s apart.
fn record(path: &Path, with_fields: bool) {
    let file = std::fs::File::create(path).unwrap();
    let mut writer = Writer::new(file).unwrap();
    let channel = |topic: &str| Channel {
        topic: topic.into(),
        schema_name: "softtwin.Test".into(),
        schema: r#"{"type":"object"}"#.into(),
    };
    for k in 0..30_u32 {
        let time_ns = 1_000_000_000 + u64::from(k) * 100_000_000;
        let state = json!({
            "seq": k, "t_sensor_ns": 5, "t_publish_ns": 100_005, "pressure_mpa": 0.002 * f64::from(k), "gap_mm": 40.0,
            "contact_force_n": 0.1, "measured_force_n": "NaN", "onset_pressure_mpa": "Infinity", "regime": "free",
            "flags": ["held"], "outcome": "published", "model_hash": "00"
        });
        add(&mut writer, &channel("softtwin/finger/state"), k, time_ns, &state);
        if with_fields {
            let values = ["AADAPwAAAEA=", "AACAPwAAgD8="][(k % 2) as usize]; // 1.5, 2 and 1, 1
            let field = json!({
                "node_count": 2, "fields": ["x"], "values": values, "pressure_mpa": 0.01, "gap_mm": "Infinity"
            });
            let field = if k == 7 { json!({ "node_count": 2 }) } else { field };
            add(&mut writer, &channel("softtwin/finger/field"), k, time_ns, &field);
        }
    }
    writer.finish().unwrap();
}

fn add<S: Store>(
    writer: &mut Writer<S>,
    channel: &Channel,
    k: u32,
    time_ns: u64,
    message: &serde_json::Value,
) {
    let id = writer.channel(channel).unwrap();
    writer.message(id, k, time_ns, time_ns, message.to_string().as_bytes()).unwrap();
}

fn softtwin(dir: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_softtwin")).args(arguments).current_dir(dir).output().unwrap()
}

fn says(output: &Output, code: i32, text: &str) {
    let error = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{error}");
    assert!(error.contains(text), "{error}");
}

#[test]
fn recording_is_drawn() {
    let dir = tempfile::tempdir().unwrap();
    record(&dir.path().join("run.mcap"), false);
    let drawn = softtwin(dir.path(), &["draw", "run.mcap", "--out", "run.svg"]);
    says(&drawn, 0, "");
    let svg = std::fs::read_to_string(dir.path().join("run.svg")).unwrap();
    for text in
        ["run.mcap, 2.9 s", "pressure [MPa]", "contact force [N]", "latency, sensor to published [ms]"]
    {
        assert!(svg.contains(text), "{text}");
    }
    says(&softtwin(dir.path(), &["draw", "--out", "x.svg"]), 2, "<SOURCE>");
    std::fs::write(dir.path().join("no.mcap"), "not a recording").unwrap();
    let refused = softtwin(dir.path(), &["draw", "no.mcap", "--out", "x.svg"]);
    says(&refused, 78, "expected an MCAP recording");
    // A cause that is in the message already is not said once more.
    let refused = softtwin(dir.path(), &["export", "no.mcap", "--out", "x.npy"]);
    let said = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert_eq!((refused.status.code(), said.matches("MCAP recording").count()), (Some(78), 1), "{said}");
}

#[test]
fn export_of_a_recording_without_fields_needs_a_model() {
    let dir = tempfile::tempdir().unwrap();
    record(&dir.path().join("run.mcap"), false);
    says(&softtwin(dir.path(), &["export", "run.mcap", "--out", "run.npy"]), 2, "--model FILE.twin");
    says(
        &softtwin(dir.path(), &["export", "run.mcap", "--out", "run.npy", "--case", "A"]),
        2,
        "--case belongs to a database",
    );
    says(&softtwin(dir.path(), &["export", "run.txt", "--out", "run.npy"]), 2, "expected a model (.twin)");
}

#[test]
fn fields_without_coordinates_are_refused_as_a_series() {
    let dir = tempfile::tempdir().unwrap();
    record(&dir.path().join("run.mcap"), true);
    says(
        &softtwin(dir.path(), &["export", "run.mcap", "--out", "run.npy"]),
        78,
        "the coordinates x, y and z",
    );
}

#[test]
fn viewer_refuses_an_invalid_recording() {
    let dir = tempfile::tempdir().unwrap();
    says(
        &softtwin(dir.path(), &["view", "--port", "0", "--recording", "gone.mcap"]),
        1,
        "cannot read the recording gone.mcap",
    );
    says(
        &softtwin(dir.path(), &["view", "--port", "0", "--recording", "."]),
        1,
        "expected recordings (.mcap) in .",
    );
    record(&dir.path().join("run.mcap"), false);
    let both = ["view", "--port", "0", "--recording", "run.mcap", "--key", "softtwin/**"];
    says(&softtwin(dir.path(), &both), 2, "cannot be used with");
}
