//! The daemons as a service: told to the service manager, reloaded, watched, recorded, replayed.

use recording::message::{Recorded, SensorMessage, StateMessage};
use recording::{Ending, Item, Reader};
use softtwin_tests::{PATIENCE, Program, Stage};
use std::collections::BTreeMap;
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::os::unix::net::UnixDatagram;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};
use wire::{StateReader, Topic, WakeSet, Wakeable};

const STEADY: &str = r#"kind = "simulate"
rate_hz = 200.0
gap_mm = 30.0
profile = { shape = "sine", mean_mpa = 0.035, amplitude_mpa = 0.03, frequency_hz = 1.0 }"#;

/// What a program tells its service manager, up to the message with `text` in it.
fn told(socket: &UnixDatagram, text: &str) -> Vec<String> {
    socket.set_read_timeout(Some(PATIENCE)).unwrap();
    let mut messages = Vec::new();
    let mut bytes = [0; 4096];
    loop {
        let count = socket.recv(&mut bytes).unwrap_or_else(|_| panic!("`{text}` was not told: {messages:?}"));
        messages.push(String::from_utf8_lossy(&bytes[..count]).into_owned());
        if messages.last().is_some_and(|message| message.contains(text)) {
            return messages;
        }
    }
}

fn notified(stage: &Stage, arguments: &[&str]) -> (Program, UnixDatagram) {
    let path = stage.path("notify.sock");
    let _none_yet = std::fs::remove_file(&path);
    let socket = UnixDatagram::bind(&path).unwrap();
    let environment = [("NOTIFY_SOCKET", path.display().to_string()), ("WATCHDOG_USEC", "400000".to_owned())];
    (Program::daemon_with(stage, arguments, &environment), socket)
}

/// Ready once everything is open, alive while the loop turns, stopping when asked.
#[test]
fn both_daemons_tell_the_service_manager_how_they_are() {
    for daemon in ["twin", "bridge"] {
        let stage = Stage::new("notify");
        let scene = stage.finger(STEADY).display().to_string();
        let (program, socket) = notified(&stage, &[daemon, "--scene", &scene]);
        let ready = told(&socket, "READY=1");
        assert!(ready.last().unwrap().contains("STATUS="), "{daemon}: {ready:?}");
        assert!(
            !ready.iter().any(|message| message.contains("WATCHDOG=1")),
            "{daemon} is alive before it is ready: {ready:?}"
        );
        told(&socket, "WATCHDOG=1");
        told(&socket, "WATCHDOG=1");
        let (status, said) = program.stop();
        assert!(status.success(), "{daemon}: {said:?}");
        told(&socket, "STOPPING=1");
    }
}

/// A process that is stopped (SIGSTOP) feeds no watchdog: the manager would restart it.
#[test]
fn a_loop_without_progress_feeds_no_watchdog() {
    let stage = Stage::new("watchdog");
    let scene = stage.finger(STEADY).display().to_string();
    let (program, socket) = notified(&stage, &["twin", "--scene", &scene]);
    told(&socket, "WATCHDOG=1");
    program.signal(libc::SIGSTOP);
    socket.set_read_timeout(Some(Duration::from_millis(800))).unwrap();
    let mut bytes = [0; 4096];
    // One message may have been on its way.
    let silence = (0..3).any(|_| socket.recv(&mut bytes).is_err());
    program.signal(libc::SIGCONT);
    assert!(silence, "a stopped process went on telling that it is alive");
    told(&socket, "WATCHDOG=1");
}

#[test]
fn a_wrong_configuration_ends_with_78_and_never_says_ready() {
    let stage = Stage::new("config");
    let scene = stage.write("wrong.toml", "name = 3\n[[actuators]]\n").display().to_string();
    for daemon in ["twin", "bridge"] {
        let (mut program, socket) = notified(&stage, &[daemon, "--scene", &scene]);
        let (status, said) = program.end();
        assert_eq!(status.code(), Some(78), "{daemon}: {said:?}");
        socket.set_nonblocking(true).unwrap();
        let mut bytes = [0; 4096];
        while let Ok(count) = socket.recv(&mut bytes) {
            let message = String::from_utf8_lossy(&bytes[..count]).into_owned();
            assert!(!message.contains("READY"), "{daemon}: {message}");
        }
    }
}

/// The first state whose model hash is `wanted`.
fn wait_for_model(reader: &StateReader, wanted: impl Fn(&[u8; 16]) -> bool) -> wire::State {
    let mut wake = WakeSet::new([reader as &dyn Wakeable]);
    let end = Instant::now() + PATIENCE;
    loop {
        while let Some(state) = reader.next().unwrap() {
            if wanted(&state.model_hash) {
                return state;
            }
        }
        assert!(Instant::now() < end, "no state of that model came");
        wake.wait([reader as &dyn Wakeable], Duration::from_millis(200)).unwrap();
    }
}

/// SIGHUP swaps a good model between two readings, and keeps the old one when the new one is damaged, truncated, absent, or
/// of another shape; each refusal says why, and the stream goes on without a jump in its numbers.
#[test]
fn a_reload_swaps_a_good_model_and_keeps_the_old_one_otherwise() {
    let stage = Stage::new("reload");
    let scene = stage.finger(STEADY);
    let mut twin = Program::twin(&stage, &scene);
    let bridge = Program::bridge(&stage, &scene);
    let bus = stage.bus();
    let reader = StateReader::open(&bus, &Topic::state("finger").unwrap()).unwrap();
    let first = wait_for_model(&reader, |_| true);
    let model = stage.path("beam.twin");
    let good = std::fs::read(&model).unwrap();

    let mut flipped = good.clone();
    let middle = flipped.len() / 2;
    flipped[middle] ^= 0x10;
    for (what, bytes) in
        [("bit-flipped", &flipped[..]), ("truncated", &good[..good.len() - 7]), ("empty", &[])]
    {
        std::fs::write(&model, bytes).unwrap();
        twin.signal(libc::SIGHUP);
        let line = twin.wait_for("reload refused");
        assert!(line.contains("old scene and models go on"), "{what}: {line}");
    }
    std::fs::remove_file(&model).unwrap();
    twin.signal(libc::SIGHUP);
    twin.wait_for("reload refused");
    std::fs::write(&model, &good).unwrap();
    let text = std::fs::read_to_string(&scene).unwrap();
    std::fs::write(&scene, text.replace("fields = [\"y\", \"displacement\"]", "fields = [\"y\"]")).unwrap();
    twin.signal(libc::SIGHUP);
    let line = twin.wait_for("reload refused");
    assert!(line.contains("start the twin anew"), "{line}");
    std::fs::write(&scene, &text).unwrap();

    let other = softtwin_tests::stage::other_model_bytes();
    assert_ne!(other, good, "the two models differ");
    std::fs::write(&model, other).unwrap();
    twin.signal(libc::SIGHUP);
    twin.wait_for("reloaded");
    let swapped = wait_for_model(&reader, |hash| *hash != first.model_hash);
    assert_eq!(swapped.boot_id, first.boot_id, "the same run of the twin");
    let next = wait_for_model(&reader, |hash| *hash == swapped.model_hash);
    assert_eq!(next.seq, swapped.seq + 1);
    let (status, said) = twin.stop();
    assert!(status.success() && bridge.stop().0.success(), "{said:?}");
}

fn get(address: &str, path: &str) -> String {
    let mut stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    write!(stream, "GET {path} HTTP/1.1\r\nHost: x\r\n\r\n").unwrap();
    let mut reply = String::new();
    stream.read_to_string(&mut reply).unwrap();
    reply
}

fn free_address() -> String {
    TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().to_string()
}

#[test]
fn metrics_are_served_on_loopback_when_asked_for() {
    let stage = Stage::new("metrics");
    let scene = stage.finger(STEADY).display().to_string();
    let (twin_at, bridge_at) = (free_address(), free_address());
    let mut twin = Program::daemon(&stage, &["twin", "--scene", &scene, "--metrics", &twin_at]);
    twin.wait_for("ready:");
    let mut bridge = Program::daemon(&stage, &["bridge", "--scene", &scene, "--metrics", &bridge_at]);
    bridge.wait_for("ready:");
    let end = Instant::now() + PATIENCE;
    loop {
        let page = get(&twin_at, "/metrics");
        assert!(page.starts_with("HTTP/1.1 200 OK"), "{page}");
        let readings =
            page.lines().find_map(|line| line.strip_prefix("softtwin_readings_total{actuator=\"finger\"} "));
        if readings.is_some_and(|count| count.parse::<f64>().unwrap() > 0.0) {
            break;
        }
        assert!(Instant::now() < end, "no readings on the page:\n{page}");
    }
    assert!(get(&bridge_at, "/metrics").contains("\nsofttwin_bridge_failed_total 0\n"));
    assert!(get(&bridge_at, "/").starts_with("HTTP/1.1 404"));
    // A visitor who says nothing holds nobody up for long.
    let _silent = TcpStream::connect(&twin_at).unwrap();
    assert!(get(&twin_at, "/metrics").contains("softtwin_flag"));
    let mut open = Program::daemon(&stage, &["twin", "--scene", &scene, "--metrics", "0.0.0.0:9464"]);
    let (status, said) = open.end();
    assert_eq!(status.code(), Some(2), "the page has no guard, so no other address: {said:?}");
}

/// What a state says of its reading, without time stamps and numbers of the run.
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

/// Readings and fresh states of a recording, by the reading's number.
fn contents(path: &Path) -> (Vec<SensorMessage>, BTreeMap<u64, String>, Ending) {
    let bytes = std::fs::read(path).unwrap();
    let mut reader = Reader::new(bytes.as_slice()).unwrap();
    let (mut readings, mut states) = (Vec::new(), BTreeMap::new());
    while let Some(item) = reader.next_item().unwrap() {
        let Item::Message(message) = item else { continue };
        if message.channel.schema_name == SensorMessage::SCHEMA_NAME {
            readings.push(SensorMessage::decode(&message.data).unwrap());
        }
        if message.channel.schema_name == StateMessage::SCHEMA_NAME {
            let text = String::from_utf8_lossy(&message.data);
            let (seq, essence) = essence(&message.data);
            if seq > 0 && !text.contains("stale") {
                states.entry(seq).or_insert(essence);
            }
        }
    }
    (readings, states, reader.ending().unwrap().clone())
}

/// Records while `play` feeds the twin of `scene`; ends when the last reading's state is in the file.
fn record(stage: &Stage, scene: &Path, name: &str, play: &[&str], last: u64) -> std::path::PathBuf {
    let path = stage.path(name);
    let twin = Program::twin(stage, scene);
    let out = path.display().to_string();
    let mut recorder = Program::tool(stage, &["record", "--out", &out, "--json"]);
    let bus = stage.bus();
    let states = StateReader::open(&bus, &Topic::state("finger").unwrap()).unwrap();
    // The recorder reads the state topic once it is there as a second reader.
    let end = Instant::now() + PATIENCE;
    let all = wire::KeyExpr::new("softtwin/finger/*").unwrap();
    loop {
        let topics = bus.topics(&all).unwrap();
        if topics.iter().filter(|info| info.readers.contains(&recorder.id())).count() >= 3 {
            break;
        }
        assert!(Instant::now() < end, "the recorder does not listen: {topics:?}");
        std::thread::yield_now();
    }
    let mut player = match play {
        ["bridge", ..] => Program::daemon(stage, play),
        _ => Program::tool(stage, play),
    };
    let mut wake = WakeSet::new([&states as &dyn Wakeable]);
    let end = Instant::now() + PATIENCE;
    'heard: loop {
        while let Some(state) = states.next().unwrap() {
            if state.sensor_seq >= last {
                break 'heard;
            }
        }
        assert!(Instant::now() < end, "reading {last} was not answered");
        wake.wait([&states as &dyn Wakeable], Duration::from_millis(200)).unwrap();
    }
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

/// The criterion of recording: the same readings through the same model give the same states, to the bit.
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
    assert!(
        both.len() as u64 >= READINGS * 9 / 10,
        "only {} readings were answered in both runs",
        both.len()
    );
    for seq in both {
        assert_eq!(states_1[&seq], states_2[&seq], "reading {seq}");
    }
}

/// `kill -9` of the recorder: the file ends in the middle and holds all but the last second.
#[test]
fn a_killed_recorder_leaves_all_but_the_last_second() {
    let stage = Stage::new("killrec");
    let scene = stage.finger(STEADY);
    let path = stage.path("killed.mcap");
    let mut recorder = Program::tool(&stage, &["record", "--out", &path.display().to_string()]);
    let bridge = Program::bridge(&stage, &scene);
    let readings = |path: &Path| {
        let Ok(bytes) = std::fs::read(path) else { return (0, 0, 0) };
        let Ok(mut reader) = Reader::new(bytes.as_slice()) else { return (0, 0, 0) };
        let (mut count, mut first_ns, mut last_ns) = (0u64, 0, 0);
        while let Some(item) = reader.next_item().unwrap() {
            if let Item::Message(message) = item {
                first_ns = if count == 0 { message.log_time_ns } else { first_ns };
                last_ns = message.log_time_ns;
                count += 1;
            }
        }
        (count, first_ns, last_ns)
    };
    let end = Instant::now() + PATIENCE;
    while readings(&path).0 < 300 {
        assert!(Instant::now() < end, "300 readings did not reach the disk");
        std::thread::sleep(Duration::from_millis(100));
    }
    let wall = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap();
    recorder.signal(libc::SIGKILL);
    recorder.end();
    let (count, first_ns, last_ns) = readings(&path);
    let lost = Duration::from_nanos((wall.as_nanos() as u64).saturating_sub(last_ns));
    assert!(lost < Duration::from_secs(1), "{lost:?} of readings are gone");
    let span_s = (last_ns - first_ns) as f64 * 1e-9;
    assert!(
        (count as f64) > 0.95 * span_s * 200.0,
        "{count} readings in {span_s} s: nothing is missing between"
    );
    assert!(bridge.stop().0.success());
}

/// The units of `config/systemd` as systemd reads them, with our own binaries in the place where they are installed.
#[test]
fn systemd_accepts_the_units() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../config/systemd");
    if Command::new("systemd-analyze").arg("--version").output().is_err() {
        println!("SKIPPED: systemd-analyze is not installed on this machine");
        return;
    }
    let copies = tempfile::tempdir().unwrap();
    let mut units = Vec::new();
    for entry in std::fs::read_dir(&folder).unwrap().flatten() {
        let text = std::fs::read_to_string(entry.path()).unwrap();
        for daemon in ["softtwind", "softtwin"] {
            assert!(softtwin_tests::process::binary(daemon).is_file());
        }
        let bin = softtwin_tests::process::binary("softtwind").parent().unwrap().display().to_string();
        let path = copies.path().join(entry.file_name());
        std::fs::write(&path, text.replace("/usr/local/bin", &bin)).unwrap();
        units.push(path);
        if text.contains("Type=notify") {
            for line in [
                "RestartPreventExitStatus=78",
                "RemoveIPC=no",
                "PrivateTmp=no",
                "DynamicUser=no",
                "WatchdogSec=2s",
            ] {
                assert!(
                    text.lines().any(|found| found == line),
                    "{line} is missing in {}",
                    entry.path().display()
                );
            }
        }
    }
    assert!(units.len() >= 3, "{units:?}");
    let output = Command::new("systemd-analyze").arg("verify").args(&units).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    let ours: Vec<&str> = said.lines().filter(|line| line.contains("softtwin")).collect();
    assert!(output.status.success() && ours.is_empty(), "{said}");
}
