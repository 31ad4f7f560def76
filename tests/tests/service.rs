//! The daemons as services: notifications, reload, watchdog.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};
use tests::http::{free_address, get, get_as};
use tests::skip::{Missing, skipped};
use tests::wait::wait_state;
use tests::{Manager, PATIENCE, Program, Stage};
use wire::layout::{Marker, field_id, flags};
use wire::{FieldReader, SensorSample, SensorWriter, State, StateReader, Topic, now_ns};

const STEADY: &str = r#"kind = "simulate"
rate_hz = 200.0
gap_mm = 30.0
profile = { shape = "sine", mean_mpa = 0.035, amplitude_mpa = 0.03, frequency_hz = 1.0 }"#;

fn notified(stage: &Stage, arguments: &[&str]) -> (Program, Manager) {
    let manager = Manager::new(stage);
    (Program::daemon_with(stage, arguments, &manager.environment()), manager)
}

/// Ready once everything is open, alive while the loop turns, stopping when asked.
#[test]
fn daemons_notify_the_service_manager() {
    for daemon in ["twin", "bridge"] {
        let stage = Stage::new("notify");
        let scene = stage.finger(STEADY).display().to_string();
        let (program, manager) = notified(&stage, &[daemon, "--scene", &scene]);
        let ready = manager.receive("READY=1");
        assert!(ready.last().unwrap().contains("STATUS="), "{daemon}: {ready:?}");
        assert!(
            !ready.iter().any(|message| message.contains("WATCHDOG=1")),
            "{daemon} is alive before it is ready: {ready:?}"
        );
        manager.receive("WATCHDOG=1");
        manager.receive("WATCHDOG=1");
        let (status, said) = program.stop();
        assert!(status.success(), "{daemon}: {said:?}");
        manager.receive("STOPPING=1");
    }
}

/// A manager may listen on a socket without a path.
#[test]
fn the_manager_is_notified_on_an_abstract_socket() {
    let stage = Stage::new("abstract");
    let scene = stage.finger(STEADY).display().to_string();
    let name = format!("softtwin-test-{}", std::process::id());
    let address = SocketAddr::from_abstract_name(&name).unwrap();
    let manager = UnixDatagram::bind_addr(&address).unwrap();
    manager.set_read_timeout(Some(PATIENCE)).unwrap();
    let environment = [("NOTIFY_SOCKET", format!("@{name}"))];
    let _bridge = Program::daemon_with(&stage, &["bridge", "--scene", &scene], &environment);
    let mut message = [0; 4096];
    let count = manager.recv(&mut message).expect("READY");
    assert!(String::from_utf8_lossy(&message[..count]).lines().any(|line| line == "READY=1"));
}

/// Exit code 1 when the twin could use no reading of a finite trace, 0 when it used some or there is no twin.
#[test]
fn a_bridge_ends_with_an_error_when_nothing_was_used() {
    let stage = Stage::new("unused");
    let scene = stage.finger(STEADY);
    let scene_text = scene.display().to_string();
    let good = stage.trace("good.csv", 100, 500.0, 0.03, 40.0).display().to_string();
    let absurd = stage.trace("absurd.csv", 100, 500.0, 0.03, 1e6).display().to_string();
    let code = |trace: &str| {
        let arguments = ["bridge", "--scene", &scene_text, "--trace", trace];
        Program::daemon(&stage, &arguments).ended().0.code()
    };
    assert_eq!(code(&absurd), Some(0), "no twin");
    let _twin = Program::twin(&stage, &scene);
    assert_eq!(code(&absurd), Some(1));
    assert_eq!(code(&good), Some(0));
    assert_eq!(code(&absurd), Some(1), "after another bridge");
    let repeated = ["bridge", "--scene", &scene_text, "--trace", &absurd, "--loop"];
    let mut bridge = Program::daemon(&stage, &repeated);
    bridge.wait_for("used no reading so far");
    assert!(bridge.stop().0.success(), "a signal is no end of the trace");
}

/// A bridge whose readings are all rejected reports it within its first second: its line counts the readings that the twin had
/// rejected by then.
#[test]
fn a_bridge_reports_within_a_second_that_nothing_is_used() {
    let stage = Stage::new("rejected");
    let scene = stage.finger(STEADY);
    let absurd = stage.trace("absurd.csv", 100, 100.0, 0.03, 1e6).display().to_string();
    let _twin = Program::twin(&stage, &scene);
    let arguments = ["bridge", "--scene", &scene.display().to_string(), "--trace", &absurd, "--loop"];
    let mut bridge = Program::daemon(&stage, &arguments);
    let line = bridge.wait_for("used no reading so far");
    let rejected = line.split(&[' ', ','][..]).filter_map(|word| word.parse::<u32>().ok()).next();
    assert!(rejected.is_some_and(|count| (1..=100).contains(&count)), "of a second at 100 Hz: {line}");
}

/// A process that is stopped (SIGSTOP) feeds no watchdog: the manager would restart it.
#[test]
fn stopped_loop_stops_watchdog_notifications() {
    let stage = Stage::new("watchdog");
    let scene = stage.finger(STEADY).display().to_string();
    let (program, manager) = notified(&stage, &["twin", "--scene", &scene]);
    manager.receive("WATCHDOG=1");
    program.signal(libc::SIGSTOP);
    // One message may have been on its way.
    let silence = (0..3).any(|_| manager.next(Duration::from_millis(800)).is_none());
    program.signal(libc::SIGCONT);
    assert!(silence, "a stopped process still notified");
    manager.receive("WATCHDOG=1");
}

#[test]
fn wrong_configuration_ends_with_78_before_ready() {
    let stage = Stage::new("config");
    let scene = stage.write("wrong.toml", "name = 3\n[[actuators]]\n").display().to_string();
    for daemon in ["twin", "bridge"] {
        let (mut program, manager) = notified(&stage, &[daemon, "--scene", &scene]);
        let (status, said) = program.end();
        assert_eq!(status.code(), Some(78), "{daemon}: {said:?}");
        // It has ended, so all its notifications are in the socket.
        while let Some(message) = manager.next(Duration::from_millis(1)) {
            assert!(!message.contains("READY"), "{daemon}: {message}");
        }
    }
}

/// The first state whose model hash is `wanted`.
fn wait_for_model(reader: &StateReader, wanted: impl Fn(&[u8; 16]) -> bool) -> State {
    wait_state(reader, "a state of that model", |state| wanted(&state.model_hash))
}

/// SIGHUP swaps a good model between two readings, and keeps the old one when the new one is damaged, truncated, absent, or
/// of another shape; each refusal says why, and the stream continues without a jump in its numbers.
#[test]
fn reload_swaps_a_valid_model_and_keeps_the_old_one_otherwise() {
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
    for bytes in [&flipped[..], &good[..good.len() - 7], &[]] {
        std::fs::write(&model, bytes).unwrap();
        twin.signal(libc::SIGHUP);
        twin.wait_for("reload refused");
    }
    std::fs::remove_file(&model).unwrap();
    twin.signal(libc::SIGHUP);
    twin.wait_for("reload refused");
    std::fs::write(&model, &good).unwrap();
    let text = std::fs::read_to_string(&scene).unwrap();
    std::fs::write(&scene, text.replace("fields = [\"y\", \"displacement\"]", "fields = [\"y\"]")).unwrap();
    twin.signal(libc::SIGHUP);
    twin.wait_for("reload refused");
    std::fs::write(&scene, &text).unwrap();

    let other = tests::stage::other_model_bytes();
    assert_ne!(other, good, "the two models differ");
    std::fs::write(&model, other).unwrap();
    twin.signal(libc::SIGHUP);
    twin.wait_for("reloaded");
    let swapped = wait_for_model(&reader, |hash| *hash != first.model_hash);
    assert_eq!(swapped.boot_id, first.boot_id, "the same run of the twin");
    let next = wait_for_model(&reader, |hash| *hash == swapped.model_hash);
    assert_eq!(next.seq, swapped.seq + 1);
    // The query thread has the new model too.
    let hash: String = swapped.model_hash.iter().map(|byte| format!("{byte:02x}")).collect();
    let question = ["get", "softtwin/finger/whatif?pressure_mpa=0.04;gap_mm=30", "--json"];
    let end = Instant::now() + PATIENCE;
    while !Program::tool(&stage, &question).end().1.join("\n").contains(&hash) {
        assert!(Instant::now() < end, "answers are still of the old model");
    }
    let (status, said) = twin.stop();
    assert!(status.success() && bridge.stop().0.success(), "{said:?}");
}

/// Twin of the finger without a bridge, and the way of one reading to its state.
struct Answering {
    twin: Program,
    states: StateReader,
    fields: FieldReader,
    sensor: SensorWriter,
    seq: u64,
}

impl Answering {
    /// Stamps of the past stand for time that passes; a loaded machine must not make them too old.
    fn start(stage: &Stage, scene: &Path) -> Self {
        let settings = stage.write("twin.toml", "[limits]\nmax_age_ms = 60000.0\n").display().to_string();
        let scene = scene.display().to_string();
        let mut twin = Program::daemon(stage, &["twin", "--scene", &scene, "--config", &settings]);
        twin.wait_for("ready:");
        let bus = stage.bus();
        Self {
            twin,
            states: StateReader::open(&bus, &Topic::state("finger").unwrap()).unwrap(),
            fields: FieldReader::open(&bus, &Topic::field("finger", None).unwrap()).unwrap(),
            sensor: SensorWriter::create(&bus, &Topic::sensor("finger").unwrap()).unwrap(),
            seq: 0,
        }
    }

    /// State of a reading taken this long ago.
    fn state(&mut self, ago_ms: u64, of_reading: SensorSample) -> State {
        self.seq += 1;
        let (seq, t_sensor_ns) = (self.seq, now_ns() - ago_ms * 1_000_000);
        let reading = SensorSample { boot_id: 4, seq, t_sensor_ns, ..of_reading };
        self.sensor.publish(SensorSample { pressure_mpa: 0.06, gap_mm: 30.0, ..reading }).unwrap();
        wait_state(&self.states, "the reading's state", |state| state.sensor_seq == seq)
    }
}

/// A measured force that stays beyond the half-width raises the alarm, in the state and in the log; one that fits ends it.
#[test]
fn contradicting_measured_force_raises_the_alarm() {
    let stage = Stage::new("force");
    let mut finger = Answering::start(&stage, &stage.finger(STEADY));
    let mut answer = |ago_ms: u64, measured_force_n: f64| {
        finger.state(ago_ms, SensorSample { measured_force_n, ..SensorSample::default() })
    };
    let blind = answer(990, f64::NAN);
    assert_eq!(blind.flags & (flags::FORCE_MEASURED | flags::FORCE_MISMATCH), 0, "{blind:?}");
    let fitting = answer(950, blind.contact_force_n);
    assert_eq!(fitting.flags & flags::FORCE_MISMATCH, 0, "{fitting:?}");
    assert_ne!(fitting.flags & flags::FORCE_MEASURED, 0);
    let beyond_n = blind.contact_force_n + 100.0 * f64::from(blind.force_halfwidth_n.max(0.01));
    for ago_ms in [900, 700, 600, 500] {
        assert_eq!(answer(ago_ms, beyond_n).flags & flags::FORCE_MISMATCH, 0, "for a moment is no alarm");
    }
    // Half a second of stamps later it is one.
    let alarm = answer(300, beyond_n);
    assert_ne!(alarm.flags & flags::FORCE_MISMATCH, 0, "{alarm:?}");
    assert_eq!(alarm.measured_force_n, beyond_n);
    assert_eq!(alarm.contact_force_n, blind.contact_force_n, "the prediction stands");
    finger.twin.wait_for("MEASURED FORCE DIFFERS");
    let again = SensorSample { measured_force_n: blind.contact_force_n, ..SensorSample::default() };
    assert_eq!(finger.state(200, again).flags & flags::FORCE_MISMATCH, 0, "it fits again");
    finger.twin.wait_for("agree again");
    assert!(finger.twin.stop().0.success());
}

/// A steady difference of a marker from its predicted position by more than its standard deviation allows raises the alarm; noise,
/// a moment, or a marker that no camera sees raise none.
#[test]
fn contradicting_marker_raises_the_alarm() {
    let stage = Stage::new("marker");
    let scene = std::fs::read_to_string(stage.finger(STEADY)).unwrap();
    let marker = "[[actuator.marker]]\nname = \"tip\"\nnode = 119\n[actuator.sigma]\nmarker_mm = 0.2\n";
    let scene = stage.write("marker.toml", &format!("{scene}{marker}"));
    let mut finger = Answering::start(&stage, &scene);
    let first = finger.state(30_000, SensorSample::default());
    let [x, y, z] = {
        let fields = &finger.fields;
        let field = tests::wait::wait_for(fields, "the field", |fields| fields.newest().unwrap());
        [field_id::X, field_id::Y, field_id::Z].map(|id| f64::from(field.field(id).unwrap()[119]))
    };
    let mut answer = |ago_ms: u64, off_mm: f64| {
        let mut sample = SensorSample { marker_values: 3, ..SensorSample::default() };
        sample.markers_mm[0] = Marker { x, y: y + off_mm, z };
        finger.state(ago_ms, sample)
    };
    let raised = |state: State| state.flags & flags::MARKER_MISMATCH != 0;
    assert!(!raised(first), "no camera");
    let noise_mm = [0.3, -0.2, 0.1, -0.3, 0.25, -0.15, 0.2, -0.2];
    for (k, off_mm) in noise_mm.into_iter().enumerate() {
        assert!(!raised(answer(29_900 - 100 * k as u64, off_mm)), "noise of 0.2 mm at reading {k}");
    }
    let beyond_mm = 2.0 + f64::from(2.0 * first.displacement_halfwidth_mm);
    for ago_ms in [900, 800, 700, 600, 500] {
        assert!(!raised(answer(ago_ms, beyond_mm)), "for a moment is no alarm");
    }
    let alarm = answer(300, beyond_mm);
    assert!(raised(alarm), "{alarm:?}");
    assert!(f64::from(alarm.displacement_halfwidth_mm) > beyond_mm - 0.6, "{alarm:?}");
    assert!(!raised(answer(200, 0.0)), "it fits again");
    for line in ["MEASURED MARKER DIFFERS", "markers and predicted positions agree again"] {
        finger.twin.wait_for(line);
    }
    assert!(finger.twin.stop().0.success());
}

#[test]
fn metrics_are_served_on_loopback() {
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
        assert!(Instant::now() < end, "no readings in the metrics:\n{page}");
    }
    assert!(get(&bridge_at, "/metrics").contains("\nsofttwin_bridge_failed_total 0\n"));
    assert!(get(&bridge_at, "/").starts_with("HTTP/1.1 404"));
    let mut head = TcpStream::connect(&bridge_at).unwrap();
    let host = "Host: localhost\r\nConnection: close";
    write!(head, "HEAD /metrics HTTP/1.1\r\n{host}\r\n\r\n").unwrap();
    let mut reply = String::new();
    head.read_to_string(&mut reply).unwrap();
    assert!(reply.starts_with("HTTP/1.1 200 OK") && reply.ends_with("\r\n\r\n"), "no body: {reply}");
    let foreign = get_as("twin.example", &twin_at, "/metrics");
    assert!(foreign.starts_with("HTTP/1.1 403"), "a page of another name reads the metrics: {foreign}");
    // More clients than fit at a time send nothing or half a request; others are still served.
    let _silent: Vec<TcpStream> = (0..400).map(|_| TcpStream::connect(&twin_at).unwrap()).collect();
    for mut half in &_silent[..50] {
        half.write_all(b"GET /metrics HTTP/1.1\r\nHost:").unwrap();
    }
    assert!(get(&twin_at, "/metrics").contains("softtwin_flag"));
    let mut open = Program::daemon(&stage, &["twin", "--scene", &scene, "--metrics", "0.0.0.0:9464"]);
    let (status, said) = open.end();
    assert_eq!(status.code(), Some(2), "loopback addresses only: {said:?}");
}

/// Without a free file descriptor the log names the cause, and the endpoint answers again when one is free.
#[test]
fn exhausted_file_descriptors_of_the_metrics_endpoint_are_named() {
    let stage = Stage::new("descriptors");
    let scene = stage.finger(STEADY).display().to_string();
    let address = free_address();
    let mut twin = Program::daemon(&stage, &["twin", "--scene", &scene, "--metrics", &address]);
    twin.wait_for("ready:");
    assert!(get(&address, "/metrics").starts_with("HTTP/1.1 200"));
    let open = std::fs::read_dir(format!("/proc/{}/fd", twin.id())).unwrap().count() as u64;
    let usual = limit_open_files(&twin, None);
    limit_open_files(&twin, Some(libc::rlimit { rlim_cur: open, ..usual }));
    let waiting: Vec<TcpStream> = (0..8).map(|_| TcpStream::connect(&address).unwrap()).collect();
    let line = twin.wait_for("http: connections cannot be accepted");
    assert!(line.contains("Too many open files") && line.contains("LimitNOFILE"), "{line}");
    limit_open_files(&twin, Some(usual));
    assert!(get(&address, "/metrics").starts_with("HTTP/1.1 200"), "with {} idle clients", waiting.len());
    assert!(twin.stop().0.success());
}

/// Sets the limit of open files of a running program, if there is a new one; returns the old one.
fn limit_open_files(program: &Program, new: Option<libc::rlimit>) -> libc::rlimit {
    let mut old = libc::rlimit { rlim_cur: 0, rlim_max: 0 };
    let new = new.as_ref().map_or(std::ptr::null(), std::ptr::from_ref);
    // SAFETY: both pointers are null or to local values that live across the call.
    let result = unsafe { libc::prlimit(program.id() as i32, libc::RLIMIT_NOFILE, new, &raw mut old) };
    assert_eq!(result, 0, "{}", std::io::Error::last_os_error());
    old
}

/// The units of `config/systemd` as systemd reads them, with our own binaries in the place where they are installed.
#[test]
fn systemd_accepts_the_units() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../config/systemd");
    if Command::new("systemd-analyze").arg("--version").output().is_err() {
        return skipped(Missing::SystemdAnalyze);
    }
    let copies = tempfile::tempdir().unwrap();
    let mut units = Vec::new();
    for entry in std::fs::read_dir(&folder).unwrap().flatten() {
        let text = std::fs::read_to_string(entry.path()).unwrap();
        for daemon in ["softtwind", "softtwin"] {
            assert!(tests::process::binary(daemon).is_file());
        }
        let bin = tests::process::binary("softtwind").parent().unwrap().display().to_string();
        let path = copies.path().join(entry.file_name());
        // The gateway is in no everyday build, so any program stands for it.
        let runnable = text.replace("/usr/local/bin/softtwin-gateway", "/bin/true");
        std::fs::write(&path, runnable.replace("/usr/local/bin", &bin)).unwrap();
        units.push(path);
        if text.contains("Type=notify") {
            // A network may hold the gateway up for longer than anything may hold up a daemon.
            // A disk may hold a recorder up for longer still.
            let (exits, watchdog) = if text.contains("softtwin-gateway --config") {
                ("RestartPreventExitStatus=2 78", "WatchdogSec=10s")
            } else if text.contains("softtwin record") {
                ("RestartPreventExitStatus=2 78", "WatchdogSec=120s")
            } else {
                ("RestartPreventExitStatus=78", "WatchdogSec=2s")
            };
            for line in [exits, watchdog, "RemoveIPC=no", "PrivateTmp=no", "DynamicUser=no"] {
                let is_there = text.lines().any(|found| found == line);
                assert!(is_there, "{line} is missing in {}", entry.path().display());
            }
        }
    }
    assert!(units.len() >= 4, "{units:?}");
    let output = Command::new("systemd-analyze").arg("verify").args(&units).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    let ours: Vec<&str> = said.lines().filter(|line| line.contains("softtwin")).collect();
    assert!(output.status.success() && ours.is_empty(), "{said}");
}
