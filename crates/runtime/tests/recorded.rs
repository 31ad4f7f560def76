//! Recordings as traces are bit-identical to the published readings.

use recording::message::{EncodeJson, channel};
use recording::{RotateOptions, RotatingWriter};
use runtime::source::{InputNames, Poll, Reading, SensorTrace, SourceSpec, TraceError};
use std::path::{Path, PathBuf};
use wire::{Payload, SensorSample};

/// Values a gauge can say, the awkward ones included.
const PRESSURES_MPA: [f64; 6] = [0.0, 0.1 + 0.2, f64::NAN, f64::INFINITY, -0.0, 5e-324];

fn sample(seq: u64) -> SensorSample {
    SensorSample {
        seq,
        t_sensor_ns: 5_000_000_000 + seq * 5_000_000,
        pressure_mpa: PRESSURES_MPA[seq as usize % PRESSURES_MPA.len()],
        gap_mm: 40.0,
        status: u32::from(seq == 3),
        ..SensorSample::default()
    }
}

fn record(path: &Path, topics: &[&str], count: u64) {
    let mut writer = RotatingWriter::create(path, RotateOptions::default()).unwrap();
    let mut bytes = Vec::new();
    for seq in 0..count {
        for topic in topics {
            sample(seq).view().encode(&mut bytes);
            writer.message(&channel(SensorSample::LAYOUT, topic), seq as u32, seq, seq, &bytes).unwrap();
        }
    }
    writer.finish().unwrap();
}

fn recording(topics: &[&str], count: u64) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    record(&path, topics, count);
    (folder, path)
}

#[test]
fn a_recording_is_replayed_to_the_bit() {
    let (_folder, path) = recording(&["softtwin/finger/sensor"], 12);
    let mut source = SourceSpec::replay_of(path).open(Path::new("/"), &InputNames::default()).unwrap();
    for seq in 0..12 {
        let Poll::Reading(Reading { sample: reading, due_s }) = source.poll(f64::INFINITY) else {
            panic!("reading {seq} is missing")
        };
        let sent = sample(seq);
        assert_eq!(reading.pressure_mpa.to_bits(), sent.pressure_mpa.to_bits());
        assert_eq!((reading.gap_mm, reading.status), (sent.gap_mm, sent.status));
        assert!((due_s - seq as f64 * 0.005).abs() < 1e-9, "original timing, {due_s}");
    }
    assert_eq!(source.poll(f64::INFINITY), Poll::End);
}

/// A stamp from the future is left out alone, as by the twin; without it all later readings would be late.
#[test]
fn a_reading_stamped_in_its_future_costs_itself() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let mut writer = RotatingWriter::create(&path, RotateOptions::default()).unwrap();
    let offset_ns = 1_000_000_000_000;
    let about = [
        ("layout", wire::layout::LAYOUT_VERSION.to_string()),
        ("boot_id", "a".to_owned()),
        ("wall_minus_monotonic_ns", offset_ns.to_string()),
    ];
    let about = about.into_iter().map(|(key, value)| (key.to_owned(), value)).collect();
    writer.metadata("softtwin.recording", &about).unwrap();
    let mut bytes = Vec::new();
    for seq in 0..6 {
        let taken = sample(seq);
        let log_time_ns = taken.t_sensor_ns + 1_000_000 + offset_ns;
        let stamp = if seq == 2 { u64::MAX / 2 } else { taken.t_sensor_ns };
        SensorSample { t_sensor_ns: stamp, ..taken }.view().encode(&mut bytes);
        let channel = channel(SensorSample::LAYOUT, "softtwin/finger/sensor");
        writer.message(&channel, seq as u32, log_time_ns, log_time_ns, &bytes).unwrap();
    }
    writer.finish().unwrap();
    let times: Vec<f64> = SensorTrace::read(&path).unwrap().rows.iter().map(|row| row.t_trace_s).collect();
    assert_eq!(times.iter().map(|t_s| (t_s * 1e3).round()).collect::<Vec<_>>(), [0.0, 5.0, 15.0, 20.0, 25.0]);
}

#[test]
fn several_sensors_need_a_topic() {
    let (_folder, path) = recording(&["softtwin/left/sensor", "softtwin/right/sensor"], 4);
    let errors = SensorTrace::read(&path).unwrap_err();
    assert!(
        matches!(&errors[..], [TraceError::SeveralTopics { found }] if found.contains("softtwin/left/sensor")),
        "{errors:?}"
    );
    assert_eq!(
        SensorTrace::read_named(&path, Some("softtwin/right/sensor"), &InputNames::default())
            .unwrap()
            .rows
            .len(),
        4
    );
    let errors =
        SensorTrace::read_named(&path, Some("softtwin/middle/sensor"), &InputNames::default()).unwrap_err();
    assert!(errors[0].to_string().contains("softtwin/right/sensor"), "{errors:?}");
}

#[test]
fn truncated_recording_is_read_and_an_empty_one_refused() {
    let (_folder, path) = recording(&["softtwin/finger/sensor"], 50);
    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&path, &bytes[..bytes.len() - 20]).unwrap();
    assert_eq!(SensorTrace::read(&path).unwrap().rows.len(), 50);
    std::fs::write(&path, recording::MAGIC).unwrap();
    assert!(matches!(&SensorTrace::read(&path).unwrap_err()[..], [TraceError::Empty]));
}
