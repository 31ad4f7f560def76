//! The recorder on a real shared-memory domain.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use recording::message::decode_reading;
use recording::{Ending, Item, Recorder, RecorderOptions, RecordingReader, RotateOptions};
use wire::{Bus, Domain, KeyExpr, SensorSample, SensorWriter, State, StateWriter, Topic};

const READINGS: u64 = 2_000;

fn options(path: std::path::PathBuf) -> RecorderOptions {
    let keys = vec![KeyExpr::new("softtwin/**").expect("a key")];
    RecorderOptions {
        keys,
        with_fields: false,
        path,
        rotate: RotateOptions::default(),
        queue_bytes: 64 << 20,
    }
}

fn reading(seq: u64) -> SensorSample {
    SensorSample {
        boot_id: 7,
        seq,
        t_sensor_ns: seq * 1_000,
        pressure_mpa: seq as f64 * 1e-5,
        gap_mm: 40.0,
        ..SensorSample::default()
    }
}

fn wait_for(seen: &AtomicU64, count: u64) {
    let end = Instant::now() + Duration::from_secs(60);
    while seen.load(Ordering::Relaxed) < count {
        assert!(Instant::now() < end, "{} of {count} messages were recorded", seen.load(Ordering::Relaxed));
        thread::sleep(Duration::from_millis(2));
    }
}

/// Everything that is sent, with a jump in the numbers, and a state that names its model.
#[test]
fn published_samples_are_in_the_file() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("run.mcap");
    let domain = Domain::isolated("rec");
    let bus = Bus::open(&domain).expect("a bus");
    let mut sensor =
        SensorWriter::create(&bus, &Topic::sensor("finger").expect("a topic")).expect("a writer");
    let mut state = StateWriter::create(&bus, &Topic::state("finger").expect("a topic")).expect("a writer");
    let mut recorder = Recorder::start(&domain, options(path.clone())).expect("a recorder");

    let (seen, stop) = (AtomicU64::new(0), AtomicBool::new(false));
    thread::scope(|scope| {
        let running = scope.spawn(|| {
            recorder.run(&stop, |_, summary| seen.store(summary.messages.values().sum(), Ordering::Relaxed))
        });
        for index in 1..=READINGS {
            let jump = if index > 1_000 { 5 } else { 0 };
            sensor.publish(reading(index + jump)).expect("sent");
            // At most a thousand ahead of the recorder: the test is about the file, not about overflow.
            wait_for(&seen, index.saturating_sub(1_000));
        }
        let sample = State { boot_id: 9, seq: 1, model_hash: [0xab; 16], ..State::default() };
        state.publish(State { actuator: wire::layout::pack_name("finger"), ..sample }).expect("sent");
        wait_for(&seen, READINGS + 2);
        stop.store(true, Ordering::Relaxed);
        running.join().expect("no panic").expect("recorded");
    });
    let summary = recorder.finish().expect("written");
    assert_eq!((summary.missing, summary.dropped), (5, 0));
    assert_eq!(summary.messages["softtwin/finger/sensor"], READINGS);

    let bytes = std::fs::read(path).expect("there");
    let mut reader = RecordingReader::new(bytes.as_slice()).expect("a recording");
    let (mut readings, mut gaps, mut metadata) = (Vec::new(), 0, Vec::new());
    while let Some(item) = reader.next_item().expect("readable") {
        match item {
            Item::Message(message) => match message.channel.topic.as_str() {
                "softtwin/finger/sensor" => {
                    readings.push(decode_reading(&message.data).expect("a reading"));
                }
                "softtwin/recorder/gap" => {
                    gaps += 1;
                    let text = String::from_utf8(message.data).expect("text");
                    assert!(text.contains(r#""expected_seq":1001,"found_seq":1006,"missing":5"#), "{text}");
                }
                "softtwin/finger/state" => assert_eq!(message.channel.schema_name, "softtwin.State"),
                other => panic!("nothing was published on {other}"),
            },
            Item::Metadata { name, entries } => metadata.push((name, entries)),
        }
    }
    assert_eq!(reader.ending(), Some(&Ending::Complete));
    assert_eq!(gaps, 1);
    assert_eq!(readings.len() as u64, READINGS);
    for (index, found) in (1u64..).zip(&readings) {
        let seq = if index > 1_000 { index + 5 } else { index };
        assert_eq!((found.seq, found.pressure_mpa.to_bits()), (seq, reading(seq).pressure_mpa.to_bits()));
    }
    let model =
        metadata.iter().find(|(name, _)| name == "softtwin.model.finger").expect("the model is named");
    assert_eq!(model.1["model_hash"], "ab".repeat(16));
    let (_, about) = metadata.iter().find(|(name, _)| name == "softtwin.recording").expect("metadata");
    assert_eq!(about["layout"], wire::layout::LAYOUT_VERSION.to_string());
    drop((sensor, state, bus));
    domain.remove_leftovers().expect("removed");
}

/// A queue of no size: everything is dropped and counted, nothing is written, nothing breaks.
#[test]
fn samples_beyond_the_queue_are_counted() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("run.mcap");
    let domain = Domain::isolated("rec");
    let bus = Bus::open(&domain).expect("a bus");
    let mut sensor =
        SensorWriter::create(&bus, &Topic::sensor("finger").expect("a topic")).expect("a writer");
    let mut recorder =
        Recorder::start(&domain, RecorderOptions { queue_bytes: 0, ..options(path) }).expect("a recorder");
    sensor.publish(reading(1)).expect("sent");
    let stop = AtomicBool::new(false);
    recorder.run(&stop, |_, summary| stop.store(summary.dropped > 0, Ordering::Relaxed)).expect("recorded");
    let summary = recorder.finish().expect("written");
    assert_eq!((summary.dropped, summary.files.messages), (1, 0));
    drop((sensor, bus));
    domain.remove_leftovers().expect("removed");
}
