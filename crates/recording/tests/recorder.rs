//! The recorder on a real shared-memory domain.

mod common;

use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

use softtwin_recording::message::SensorMessage;
use softtwin_recording::{Ending, Item, Reader, Recorder, RecorderOptions, RotateOptions};
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

/// Everything that is sent, with a jump in the numbers, and a state that names its model.
#[test]
fn what_is_published_is_in_the_file() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("run.mcap");
    let domain = Domain::isolated("rec");
    let bus = Bus::open(&domain).expect("a bus");
    let mut sensor =
        SensorWriter::create(&bus, &Topic::sensor("finger").expect("a topic")).expect("a writer");
    let mut state = StateWriter::create(&bus, &Topic::state("finger").expect("a topic")).expect("a writer");
    let mut recorder = Recorder::start(&bus, options(path.clone())).expect("a recorder");

    let stop = AtomicBool::new(false);
    thread::scope(|scope| {
        let stop = &stop;
        let (go, turn) = std::sync::mpsc::sync_channel::<u64>(0);
        // The wire's ports stay in their thread: this one only says when the recorder has caught up.
        scope.spawn(move || turn.iter().for_each(|seen| stop.store(seen >= READINGS + 2, Ordering::Relaxed)));
        let mut next = 1u64;
        recorder
            .run(stop, |summary| {
                // At most a queue's worth ahead of the recorder: the test is about the file, not about overflow.
                for _ in 0..32 {
                    if next <= READINGS {
                        let jump = if next > 1_000 { 5 } else { 0 };
                        sensor.publish(reading(next + jump)).expect("sent");
                        next += 1;
                    } else if next == READINGS + 1 {
                        let sample = State { boot_id: 9, seq: 1, model_hash: [0xab; 16], ..State::default() };
                        state
                            .publish(State { actuator: wire::layout::pack_name("finger"), ..sample })
                            .expect("sent");
                        next += 1;
                    }
                }
                go.send(summary.messages.values().sum()).expect("listened to");
            })
            .expect("recorded");
        drop(go);
    });
    let summary = recorder.finish().expect("written");
    assert_eq!((summary.missing, summary.dropped), (5, 0));
    assert_eq!(summary.messages["softtwin/finger/sensor"], READINGS);

    let bytes = std::fs::read(path).expect("there");
    let mut reader = Reader::new(bytes.as_slice()).expect("a recording");
    let (mut readings, mut gaps, mut metadata) = (Vec::new(), 0, Vec::new());
    while let Some(item) = reader.next_item().expect("readable") {
        match item {
            Item::Message(message) => match message.channel.topic.as_str() {
                "softtwin/finger/sensor" => {
                    readings.push(SensorMessage::decode(&message.data).expect("a reading").sample());
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
    assert!(metadata.iter().any(|(name, _)| name == "softtwin.recording"));
}

/// A queue of no size: everything is dropped and counted, nothing is written, nothing breaks.
#[test]
fn what_does_not_fit_into_the_queue_is_counted() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("run.mcap");
    let bus = Bus::open(&Domain::isolated("rec")).expect("a bus");
    let mut sensor =
        SensorWriter::create(&bus, &Topic::sensor("finger").expect("a topic")).expect("a writer");
    let mut recorder =
        Recorder::start(&bus, RecorderOptions { queue_bytes: 0, ..options(path) }).expect("a recorder");
    sensor.publish(reading(1)).expect("sent");
    let stop = AtomicBool::new(false);
    recorder.run(&stop, |summary| stop.store(summary.dropped > 0, Ordering::Relaxed)).expect("recorded");
    let summary = recorder.finish().expect("written");
    assert_eq!((summary.dropped, summary.files.messages), (1, 0));
}
