//! Recorder and player as processes: playback is bit-identical, and a kill loses at most the last second.

use recording::message::decode_reading;
use recording::{Ending, Item, RecordingReader};
use std::collections::BTreeMap;
use std::path::Path;
use tests::http::{free_address, metric};
use tests::wait::{wait_for, wait_state, wait_until};
use tests::{Program, Stage};
use wire::{Bus, KeyExpr, Payload, SensorReader, SensorSample, SensorWriter, State, StateReader, Topic};

const STEADY: &str = r#"kind = "simulate"
rate_hz = 200.0
gap_mm = 30.0
profile = { shape = "sine", mean_mpa = 0.035, amplitude_mpa = 0.03, frequency_hz = 1.0 }"#;

/// Bytes of a state without time stamps and numbers of the run.
fn essence(data: &[u8]) -> (u64, String) {
    let mut state: serde_json::Value = serde_json::from_slice(data).unwrap();
    let object = state.as_object_mut().unwrap();
    let seq = object["sensor_seq"].as_u64().unwrap();
    let late = wire::layout::flags::LATE;
    let bits = object["flag_bits"].as_u64().unwrap() & !u64::from(late);
    object.insert("flag_bits".into(), bits.into());
    for moment in ["seq", "t_sensor_ns", "t_publish_ns", "age_ns", "boot_id", "sensor_boot_id", "flags"] {
        object.remove(moment);
    }
    (seq, state.to_string())
}

/// Readings, and states that are not stale, of a recording, by the reading's number.
fn contents(path: &Path) -> (Vec<SensorSample>, BTreeMap<u64, String>, Ending) {
    let bytes = std::fs::read(path).unwrap();
    let mut reader = RecordingReader::new(bytes.as_slice()).unwrap();
    let (mut readings, mut states) = (Vec::new(), BTreeMap::new());
    while let Some(item) = reader.next_item().unwrap() {
        let Item::Message(message) = item else { continue };
        if message.channel.schema_name == SensorSample::LAYOUT.schema {
            readings.push(decode_reading(&message.data).unwrap());
        }
        if message.channel.schema_name == State::LAYOUT.schema {
            let text = String::from_utf8_lossy(&message.data);
            let (seq, essence) = essence(&message.data);
            if seq > 0 && !text.contains("stale") {
                states.entry(seq).or_insert(essence);
            }
        }
    }
    (readings, states, reader.ending().unwrap().clone())
}

/// Waits until `recorder` reads as many of the finger's topics.
fn wait_listening(bus: &Bus, recorder: &Program, topics: usize) {
    let all = KeyExpr::new("softtwin/finger/*").unwrap();
    wait_until("the recorder's subscriptions", || {
        let found = bus.topics(&all).unwrap();
        let reads = found.iter().filter(|info| info.readers.contains(&recorder.id()));
        (reads.count() >= topics).then_some(())
    });
}

/// Messages in what there is of a recording, and the times of the first and the last, ns.
fn count_and_span(path: &Path) -> (u64, u64, u64) {
    let bytes = std::fs::read(path).unwrap();
    let mut reader = RecordingReader::new(bytes.as_slice()).unwrap();
    let (mut count, mut first_ns, mut last_ns) = (0, u64::MAX, 0);
    while let Some(item) = reader.next_item().unwrap() {
        if let Item::Message(message) = item {
            (first_ns, last_ns) = (message.log_time_ns.min(first_ns), message.log_time_ns.max(last_ns));
            count += 1;
        }
    }
    (count, first_ns, last_ns)
}

/// Records while `play` feeds the twin of `scene`; ends when the last reading's state is in the file.
fn record(stage: &Stage, scene: &Path, name: &str, play: &[&str], last: u64) -> std::path::PathBuf {
    let path = stage.path(name);
    let twin = Program::twin(stage, scene);
    let out = path.display().to_string();
    let mut recorder = Program::tool(stage, &["record", "--out", &out, "--json"]);
    let bus = stage.bus();
    let states = StateReader::open(&bus, &Topic::state("finger").unwrap()).unwrap();
    wait_listening(&bus, &recorder, 3);
    let mut player = match play {
        ["bridge", ..] => Program::daemon(stage, play),
        _ => Program::tool(stage, play),
    };
    wait_state(&states, "the last reading's state", |state| state.sensor_seq >= last);
    let (status, said) = player.end();
    assert!(status.success(), "{said:?}");
    recorder.signal(libc::SIGINT);
    let (status, said) = recorder.end();
    assert!(status.success(), "{said:?}");
    let report: serde_json::Value = serde_json::from_str(said.last().unwrap()).unwrap();
    assert_eq!((&report["missing"], &report["dropped"]), (&0.into(), &0.into()), "{report}");
    assert!(twin.stop().0.success());
    path
}

/// The same readings through the same model give bit-identical states.
#[test]
fn replaying_a_recording_gives_bit_identical_states() {
    const READINGS: u64 = 150;
    let stage = Stage::new("replay");
    // 100 Hz leaves a loaded machine the time to answer each reading by itself.
    let trace = stage.trace("trace.csv", READINGS as usize, 100.0, 0.069, 30.0);
    let scene = stage.finger("kind = \"replay\"\ntrace = \"trace.csv\"");
    let scene_text = scene.display().to_string();
    let first = record(&stage, &scene, "first.mcap", &["bridge", "--scene", &scene_text], READINGS);
    let played = first.display().to_string();
    let again = record(&stage, &scene, "again.mcap", &["replay", &played, "--actuator", "finger"], READINGS);
    drop(trace);
    let (readings_1, states_1, ending_1) = contents(&first);
    let (readings_2, states_2, ending_2) = contents(&again);
    assert_eq!((ending_1, ending_2), (Ending::Complete, Ending::Complete));
    assert_eq!((readings_1.len() as u64, readings_2.len() as u64), (READINGS, READINGS));
    for (one, two) in readings_1.iter().zip(&readings_2) {
        assert_eq!(one.pressure_mpa.to_bits(), two.pressure_mpa.to_bits());
    }
    let both: Vec<u64> = states_1.keys().filter(|seq| states_2.contains_key(seq)).copied().collect();
    assert!(both.len() as u64 >= READINGS / 2, "only {} readings were answered in both runs", both.len());
    for seq in both {
        assert_eq!(states_1[&seq], states_2[&seq], "reading {seq}");
    }
}

/// After `kill -9` the file has no end and is readable up to the last flush.
#[test]
fn killed_recorder_leaves_a_readable_file_without_gaps() {
    let stage = Stage::new("killrec");
    let scene = stage.finger(STEADY);
    let path = stage.path("killed.mcap");
    let bus = stage.bus();
    let readings = SensorReader::attach(&bus, &Topic::sensor("finger").unwrap()).unwrap();
    let mut recorder = Program::tool(&stage, &["record", "--out", &path.display().to_string()]);
    let bridge = Program::bridge(&stage, &scene);
    wait_listening(&bus, &recorder, 1);
    // Three seconds of readings at 200 Hz; the recorder flushes every second.
    let begin = readings.newest().unwrap().map_or(0, |reading| reading.seq);
    wait_for(&readings, "600 more readings", |readings| {
        readings.newest().unwrap().filter(|reading| reading.seq >= begin + 600)
    });
    recorder.signal(libc::SIGKILL);
    recorder.end();
    let (count, first_ns, last_ns) = count_and_span(&path);
    assert!(count >= 200, "{count} of 600 readings are on the disk");
    let span_s = (last_ns - first_ns) as f64 * 1e-9;
    assert!(
        (count as f64) > 0.95 * span_s * 200.0,
        "{count} readings in {span_s} s: nothing is missing between"
    );
    assert!(bridge.stop().0.success());
}

/// A topic from a program of another version: every command names it and continues with the other topics.
#[test]
fn topic_of_another_layout_is_named_and_skipped() {
    let stage = Stage::new("foreign");
    let scene = stage.finger(STEADY);
    let _bridge = Program::bridge(&stage, &scene);
    let bus = stage.bus();
    let foreign = Topic::state("foreign").unwrap();
    let _foreign = SensorWriter::create(&bus, &foreign).unwrap();
    let out = stage.path("run.mcap").display().to_string();
    for arguments in [
        &["record", "--out", &out, "--seconds", "1"][..],
        &["echo", "softtwin/**", "--count", "3"],
        &["list", "--rate", "--seconds", "1"],
        &["top", "--once"],
    ] {
        let (status, said) = Program::tool(&stage, arguments).end();
        let said = said.join("\n");
        assert!(status.success(), "{arguments:?}: {said}");
        assert!(said.contains(foreign.name()), "{arguments:?} does not name it: {said}");
    }
    assert!(count_and_span(Path::new(&out)).0 > 0, "the healthy topic is recorded");
    let (status, said) = Program::tool(&stage, &["echo", foreign.name()]).end();
    assert_eq!(status.code(), Some(1), "{said:?}");
}

/// A recorder of the stage's domain that reads the bridge's readings, with the given suffix of its shell command line.
fn recorder(stage: &Stage, path: &Path, redirect: &str) -> Program {
    let line = format!("exec softtwin record --out '{}' {redirect}", path.display());
    let recorder = Program::shell(stage, &line);
    wait_listening(&stage.bus(), &recorder, 1);
    recorder
}

/// Waits until more of the file can be read than now.
fn wait_recorded(path: &Path) {
    let before = count_and_span(path).0;
    wait_until("100 more readings in the file", || (count_and_span(path).0 > before + 100).then_some(()));
}

#[test]
fn recorder_survives_closed_terminal_and_unwritable_log() {
    let stage = Stage::new("hangup");
    let _bridge = Program::bridge(&stage, &stage.finger(STEADY));
    for (name, redirect) in [("full", "2>/dev/full"), ("closed", "2>&-")] {
        let path = stage.path(&format!("{name}.mcap"));
        let mut recorder = recorder(&stage, &path, redirect);
        recorder.signal(libc::SIGHUP);
        wait_recorded(&path);
        // Two requests at once, as `timeout` and a terminal make them: the file is finished all the same.
        recorder.signal(libc::SIGINT);
        recorder.signal(libc::SIGTERM);
        let (status, said) = recorder.end();
        assert!(status.success(), "{name}: {status}, {said:?}");
        assert_eq!(contents(&path).2, Ending::Complete);
    }
}

/// The limit on the size of a file (SIGXFSZ) is a full disk: reported, and what is written stays readable.
#[test]
fn file_size_limit_ends_the_recorder_like_a_full_disk() {
    let stage = Stage::new("filesize");
    let _bridge = Program::bridge(&stage, &stage.finger(STEADY));
    let path = stage.path("run.mcap");
    let mut recorder = recorder(&stage, &path, "");
    wait_recorded(&path);
    let length = std::fs::metadata(&path).unwrap().len() + 4096;
    let limit = libc::rlimit { rlim_cur: length, rlim_max: length };
    // SAFETY: the process is our own child and not yet waited for; the limit lives across the call.
    let set =
        unsafe { libc::prlimit(recorder.id() as i32, libc::RLIMIT_FSIZE, &limit, std::ptr::null_mut()) };
    assert_eq!(set, 0, "the limit can be set");
    let (status, said) = recorder.end();
    assert_eq!(status.code(), Some(1), "{status}, {said:?}");
    assert!(said.iter().any(|line| line.contains("recording stopped: File too large")), "{said:?}");
    let (readings, _, ending) = contents(&path);
    assert!(readings.len() > 100 && matches!(ending, Ending::Truncated { .. }), "{ending:?}");
}

#[test]
fn deleted_recording_ends_the_recorder() {
    let stage = Stage::new("deleted");
    let _bridge = Program::bridge(&stage, &stage.finger(STEADY));
    let path = stage.path("run.mcap");
    let mut recorder = recorder(&stage, &path, "");
    wait_recorded(&path);
    std::fs::remove_file(&path).unwrap();
    let (status, said) = recorder.end();
    assert_eq!(status.code(), Some(1), "{status}, {said:?}");
    assert!(said.iter().any(|line| line.contains("run.mcap")), "{said:?}");
}

/// Whether all threads of a program are stopped.
fn is_stopped(program: &Program) -> bool {
    let stat =
        |task: std::fs::DirEntry| std::fs::read_to_string(task.path().join("stat")).unwrap_or_default();
    let tasks = std::fs::read_dir(format!("/proc/{}/task", program.id())).unwrap();
    tasks.flatten().map(stat).all(|stat| stat.contains(") T "))
}

/// Metrics: messages per topic, lost messages, removed files, flushes.
#[test]
fn recorder_metrics_count_messages_losses_and_flushes() {
    const OVERRUN: u64 = 300;
    let stage = Stage::new("recmetrics");
    let (bus, page) = (stage.bus(), free_address());
    let topic = Topic::sensor("finger").unwrap();
    let mut sensor = SensorWriter::create(&bus, &topic).unwrap();
    let mut seq = 0;
    let mut send = |count: u64| {
        for _ in 0..count {
            seq += 1;
            sensor.publish(SensorSample { boot_id: 5, seq, ..SensorSample::default() }).unwrap();
        }
    };
    let folder = stage.path("recordings");
    std::fs::create_dir(&folder).unwrap();
    let out = folder.join("run.mcap").display().to_string();
    let keep = ["--rotate-minutes", "60", "--keep", "2", "--metrics", &page, "--json"];
    let mut recorder = Program::tool(&stage, &[&["record", "--out", &out][..], &keep].concat());
    wait_listening(&bus, &recorder, 1);
    let value = |name: &str| metric(&page, &format!("softtwin_recorder_{name}"));
    let reaches = |name: &str, wanted: u64| {
        wait_until(&format!("{name} {wanted}"), || value(name).filter(|found| *found == wanted as f64));
    };
    let messages = "messages_total{topic=\"softtwin/finger/sensor\"}";
    send(100);
    reaches(messages, 100);
    assert_eq!((value("missing"), value("dropped_total")), (Some(0.0), Some(0.0)));
    assert_eq!((value("errors"), value("skipped")), (Some(0.0), Some(0.0)));
    // While it does not run, its buffer keeps the newest readings; how many it gave up shows in the next number.
    let buffer = wire::qos::of(topic.kind()).buffer as u64;
    recorder.signal(libc::SIGSTOP);
    wait_until("a stopped recorder", || is_stopped(&recorder).then_some(()));
    send(buffer + OVERRUN);
    recorder.signal(libc::SIGCONT);
    reaches("missing", OVERRUN);
    let mut count = 100 + buffer;
    reaches(messages, count);
    for removed in 0..3 {
        let before = value("flushes_total");
        recorder.signal(libc::SIGHUP);
        reaches("files", 2);
        reaches("removed_files_total", removed);
        wait_until("a flush", || (value("flushes_total") > before).then_some(()));
        send(1);
        count += 1;
        reaches(messages, count);
    }
    let file = |file: std::io::Result<std::fs::DirEntry>| file.unwrap().metadata().unwrap().len();
    let lengths = || std::fs::read_dir(&folder).unwrap().map(file).collect::<Vec<u64>>();
    assert_eq!(lengths().len(), 2);
    wait_until("the bytes of both files", || {
        value("bytes").filter(|bytes| *bytes == lengths().iter().sum::<u64>() as f64)
    });
    assert!(value("free_bytes").is_some_and(|bytes| bytes > 0.0));
    // A topic of another layout is skipped, and said so.
    let _foreign = SensorWriter::create(&bus, &Topic::state("foreign").unwrap()).unwrap();
    reaches("skipped", 1);
    recorder.signal(libc::SIGINT);
    let (status, said) = recorder.end();
    assert!(status.success(), "{said:?}");
    let report: serde_json::Value = serde_json::from_str(said.last().unwrap()).unwrap();
    let recorded = &report["messages"]["softtwin/finger/sensor"];
    assert_eq!((recorded, &report["missing"]), (&count.into(), &OVERRUN.into()), "{report}");
}
