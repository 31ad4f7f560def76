//! Sensors of several kinds at once, over real sockets, pseudo-terminals, processes and files, with the other end in the test.

use runtime::config::Scene;
use runtime::source::{Devices, ModbusPath, SensorCounters, SourceReader};
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::os::fd::{AsRawFd, BorrowedFd};
use std::os::unix::fs::{OpenOptionsExt, symlink};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::sync_channel;
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};
use tokio_serial::{SerialPort, SerialStream};
use wire::SensorSample;
use wire::layout::{Ages, Marker};

/// Longest wait for something that must come; a failing test ends there.
const PATIENCE: Duration = Duration::from_secs(20);

/// A scene of one actuator for each text; models are not opened.
fn scene(folder: &Path, actuators: &[&str]) -> Result<Scene, String> {
    let mut text = "name = \"bench\"\n".to_owned();
    for (at, body) in actuators.iter().enumerate() {
        text += &format!("[[actuator]]\nname = \"finger{at}\"\nmodel = \"m.twin\"\n{body}\n");
    }
    let path = folder.join("scene.toml");
    fs::write(&path, text).unwrap();
    Scene::load(&path).map_err(|error| error.to_string())
}

/// The sources of all actuators, opened together and started.
fn start(scene: &Scene, devices: &Devices) -> Vec<SourceReader> {
    let open = |actuator: &runtime::config::ActuatorSpec| {
        actuator.open_source(&scene.folder, devices).expect("sensors").unwrap_or_else(|why| panic!("{why:?}"))
    };
    let opened: Vec<_> = scene.actuators.iter().map(open).collect();
    opened.into_iter().map(|source| SourceReader::start(source).unwrap()).collect()
}

fn start_one(folder: &Path, actuator: &str) -> SourceReader {
    start(&scene(folder, &[actuator]).unwrap(), &Devices::default()).remove(0)
}

/// The first reading that fits.
fn wait_for(source: &mut SourceReader, what: &str, fits: impl Fn(&SensorSample) -> bool) -> SensorSample {
    let end = Instant::now() + PATIENCE;
    let mut last = None;
    while let Some(reading) = source.next(end.saturating_duration_since(Instant::now())) {
        if fits(&reading) {
            return reading;
        }
        last = Some(reading);
        assert!(Instant::now() < end, "{what} did not come; the last: {last:?}; {}", summary(source));
    }
    panic!("{what} did not come; the last: {last:?}; {}", summary(source));
}

fn counters(source: &SourceReader, sensor: &str) -> Arc<SensorCounters> {
    source.devices().into_iter().find(|(name, _)| name == sensor).expect("a sensor").1
}

fn count(counters: &SensorCounters, name: &str) -> u64 {
    counters.all().into_iter().find(|(found, _)| *found == name).unwrap().1
}

fn summary(source: &SourceReader) -> String {
    source.devices().iter().map(|(name, device)| format!("{name}: {}; ", device.summary())).collect()
}

fn wait_until(what: &str, is_so: impl Fn() -> bool) {
    let end = Instant::now() + PATIENCE;
    while !is_so() {
        assert!(Instant::now() < end, "{what} within {PATIENCE:?}");
        thread::sleep(Duration::from_millis(2));
    }
}

/// Answer of a Modbus device to unit, function, register and written word.
type Answer = Arc<dyn Fn(u8, u8, u16, u16) -> u16 + Send + Sync>;

/// A Modbus TCP device that takes one request at a time; with the number of its connections, and whether a second request
/// ever came before the answer to the first.
fn modbus_tcp(answer: Answer) -> (SocketAddr, Arc<AtomicUsize>, Arc<AtomicBool>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    let (connections, overlapped) = (Arc::new(AtomicUsize::new(0)), Arc::new(AtomicBool::new(false)));
    let (counted, seen) = (connections.clone(), overlapped.clone());
    thread::spawn(move || {
        for mut stream in listener.incoming().flatten() {
            counted.fetch_add(1, Ordering::SeqCst);
            let (answer, seen) = (answer.clone(), seen.clone());
            thread::spawn(move || {
                let mut bytes = [0u8; 64];
                while let Ok(count) = stream.read(&mut bytes) {
                    if count != 12 {
                        seen.fetch_or(count > 12, Ordering::SeqCst);
                        return;
                    }
                    let word = |at: usize| u16::from_be_bytes([bytes[at], bytes[at + 1]]);
                    let (unit, function) = (bytes[6], bytes[7]);
                    let [high, low] = answer(unit, function, word(8), word(10)).to_be_bytes();
                    let reply = match function {
                        6 => bytes[..12].to_vec(),
                        _ => [&bytes[..4], &[0, 5, unit, function, 2, high, low]].concat(),
                    };
                    if stream.write_all(&reply).is_err() {
                        return;
                    }
                }
            });
        }
    });
    (address, connections, overlapped)
}

#[test]
fn two_actuators_and_a_writer_share_one_connection_to_several_units() {
    let written = Arc::new(Mutex::new(BTreeMap::new()));
    let noted = written.clone();
    let (address, connections, overlapped) = modbus_tcp(Arc::new(move |unit, function, register, word| {
        if function == 6 {
            noted.lock().unwrap().insert((unit, register), word);
        }
        u16::from(unit) * 100 + register
    }));
    let folder = tempfile::tempdir().unwrap();
    let actuator = |unit: u8| {
        format!(
            "pace = \"gauge\"\n[actuator.sensors.gauge]\nkind = \"modbus\"\ntcp = \"{address}\"\nrate_hz = 200\n\
             timeout_ms = 2000\nvalues.pressure_mpa = {{ from = {{ unit_id = {unit}, register = 1 }}, unit = \"Pa\" }}\n\
             [actuator.sensors.gap]\nkind = \"modbus\"\ntcp = \"{address}\"\nrate_hz = 100\ntimeout_ms = 2000\n\
             values.gap_mm = {{ from = {{ unit_id = {}, register = 5 }}, scale = 0.1 }}",
            unit + 10
        )
    };
    let scene = scene(folder.path(), &[&actuator(1), &actuator(2)]).unwrap();
    let devices = Devices::default();
    let writer = devices.modbus(&ModbusPath::Tcp(address.to_string())).unwrap();
    let mut sources = start(&scene, &devices);
    for (source, unit) in sources.iter_mut().zip([1.0, 2.0]) {
        let whole = |reading: &SensorSample| reading.stale_values == 0 && reading.status == 0;
        let reading = wait_for(source, "all values", whole);
        assert!((reading.pressure_mpa - (unit * 100.0 + 1.0) * 1e-6).abs() < 1e-15, "{reading:?}");
        assert!(
            (reading.gap_mm - (unit * 10.0 + 100.0 + 0.5)).abs() < 1e-9,
            "unit {}: {reading:?}",
            unit + 10.0
        );
    }
    for word in 1..20 {
        assert_eq!(writer.write(3, 7, &[word], PATIENCE), Ok(1), "confirmed on the first connection");
        assert_eq!(written.lock().unwrap()[&(3, 7)], word);
    }
    assert_eq!(connections.load(Ordering::SeqCst), 1, "one connection for four sensors and a writer");
    assert!(!overlapped.load(Ordering::SeqCst), "a request came before the answer to the one before");
    drop(sources.remove(0));
    wait_for(&mut sources[0], "readings after another source has ended", |reading| reading.status == 0);
    drop(sources);
    assert_eq!(writer.write(3, 7, &[9], PATIENCE), Ok(1), "a writer keeps the connection");
    let mut again = start(&scene, &devices);
    wait_for(&mut again[1], "readings of new sensors", |reading| reading.stale_values == 0);
    assert_eq!(connections.load(Ordering::SeqCst), 1, "they join the connection that the writer has kept");
}

/// The test's end of a pseudo-terminal, reading without a time-out, with what keeps the other end from hanging up.
fn terminal() -> (File, File, PathBuf) {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    let _inside = runtime.enter();
    let (ours, theirs) = SerialStream::pair().unwrap();
    let port = PathBuf::from(theirs.name().expect("a pseudo-terminal has a name"));
    let held = File::options().read(true).custom_flags(libc::O_NOCTTY).open(&port).unwrap();
    drop(theirs);
    // SAFETY: the descriptor is open for as long as `ours` is borrowed, and only duplicated here.
    let ours = File::from(unsafe { BorrowedFd::borrow_raw(ours.as_raw_fd()) }.try_clone_to_owned().unwrap());
    // SAFETY: the descriptor is open; waiting reads are all that the test does with it.
    assert_eq!(unsafe { libc::fcntl(ours.as_raw_fd(), libc::F_SETFL, 0) }, 0);
    (ours, held, port)
}

fn crc(bytes: &[u8]) -> u16 {
    let step = |crc: u16| if crc & 1 == 1 { (crc >> 1) ^ 0xa001 } else { crc >> 1 };
    bytes.iter().fold(0xffff_u16, |crc, byte| (0..8).fold(crc ^ u16::from(*byte), |crc, _| step(crc)))
}

fn rtu(bytes: &[u8]) -> Vec<u8> {
    [bytes, &crc(bytes).to_le_bytes()].concat()
}

/// Fault of a device on the bus at a request for unit 2; unit 1 has none.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Fault {
    None,
    BadCrc,
    Half,
    WrongUnit,
    Silence,
    /// The answer comes when the one who asked has given up.
    Late,
}

/// A bus with a gauge (unit 1, 45 kPa) and a faulty gap sensor (unit 2, 40 mm). Every wrong answer contains 27.3, which no
/// reading may contain.
#[test]
fn faults_of_one_unit_on_a_bus_give_no_wrong_value_and_are_recovered() {
    let folder = tempfile::tempdir().unwrap();
    let (mut ours, _held, port) = terminal();
    let fault = Arc::new(Mutex::new(Fault::None));
    let gap_counters: Arc<Mutex<Option<Arc<SensorCounters>>>> = Arc::default();
    let (of_device, counted) = (fault.clone(), gap_counters.clone());
    thread::spawn(move || {
        let (mut bytes, mut byte) = (Vec::new(), [0u8; 1]);
        while ours.read_exact(&mut byte).is_ok() {
            bytes.push(byte[0]);
            // A request is eight bytes with their checksum; what is left of another is cut off.
            let Some(request) = bytes.len().checked_sub(8).map(|from| bytes[from..].to_vec()) else {
                continue;
            };
            if crc(&request) != 0 {
                continue;
            }
            bytes.clear();
            let (good, wrong) =
                (|unit, value: u16| rtu(&[unit, 4, 2, (value >> 8) as u8, value as u8]), 273u16);
            let reply = match (request[0], *of_device.lock().unwrap()) {
                (1, _) => good(1, 450),
                (2, Fault::None) => good(2, 400),
                (2, Fault::BadCrc) => [&good(2, wrong)[..5], &[0xde, 0xad]].concat(),
                (2, Fault::Half) => good(2, wrong)[..4].to_vec(),
                (2, Fault::WrongUnit) => good(1, wrong),
                (2, Fault::Late) => {
                    let counters = counted.lock().unwrap().clone().expect("a sensor");
                    let before = count(&counters, "timeouts");
                    wait_until("the question is given up", || count(&counters, "timeouts") > before);
                    good(1, wrong) // just what the next question waits for
                }
                _ => continue,
            };
            if ours.write_all(&reply).is_err() {
                return;
            }
        }
    });
    let port = port.display();
    let body = format!(
        "pace = \"gauge\"\n[actuator.sensors.gauge]\nkind = \"modbus\"\nserial = {{ port = \"{port}\", baud = 115200 }}\n\
         rate_hz = 100\nage_limit_ms = 2000\ntimeout_ms = 1000\n\
         values.pressure_mpa = {{ from = {{ unit_id = 1, register = 0 }}, scale = 0.1, unit = \"kPa\" }}\n\
         [actuator.sensors.gap]\nkind = \"modbus\"\nserial = {{ port = \"{port}\", baud = 115200 }}\nrate_hz = 100\n\
         age_limit_ms = 100\ntimeout_ms = 60\nbackoff_max_ms = 100\n\
         values.gap_mm = {{ from = {{ unit_id = 2, register = 0 }}, scale = 0.1 }}"
    );
    let mut source = start_one(folder.path(), &body);
    let gap = counters(&source, "gap");
    *gap_counters.lock().unwrap() = Some(gap.clone());
    let right = |reading: &SensorSample| {
        assert!((reading.pressure_mpa - 0.045).abs() < 1e-12 || reading.pressure_mpa.is_nan(), "{reading:?}");
        assert!((reading.gap_mm - 40.0).abs() < 1e-9 || reading.gap_mm.is_nan(), "{reading:?}");
    };
    for next in [Fault::BadCrc, Fault::Half, Fault::WrongUnit, Fault::Silence, Fault::Late] {
        wait_for(&mut source, "both values", |reading| {
            right(reading);
            reading.gap_mm.is_finite() && reading.pressure_mpa.is_finite()
        });
        let failures =
            || ["timeouts", "garbage", "disconnects"].map(|name| count(&gap, name)).iter().sum::<u64>();
        let before = failures();
        *fault.lock().unwrap() = next;
        let without = wait_for(&mut source, "a reading without the gap", |reading| {
            right(reading);
            reading.gap_mm.is_nan()
        });
        assert_eq!((without.stale_values, without.status), (0b10, 0), "{next:?}: the gauge continues");
        let pressures = wait_for(&mut source, "a reading of the gauge", |reading| {
            right(reading);
            reading.pressure_mpa.is_finite() && reading.t_sensor_ns > without.t_sensor_ns
        });
        assert!(pressures.ages_ns.gap > 100_000_000, "{next:?}: {pressures:?}");
        assert!(failures() > before, "{next:?} was counted as nothing");
        *fault.lock().unwrap() = Fault::None;
    }
    wait_for(&mut source, "the gap again", |reading| {
        right(reading);
        reading.gap_mm.is_finite()
    });
}

/// Sends a line repeatedly until the source has a matching reading.
fn say_until(
    source: &mut SourceReader,
    mut say: impl FnMut(),
    what: &str,
    fits: impl Fn(&SensorSample) -> bool,
) -> SensorSample {
    let end = Instant::now() + PATIENCE;
    while Instant::now() < end {
        say();
        if let Some(reading) = source.next(Duration::from_millis(5)).filter(&fits) {
            return reading;
        }
    }
    panic!("{what} did not come; {}", summary(source));
}

/// Pressure by Modbus TCP, gap by a serial line, force by a TCP connection, a marker by UDP. One after the other is pulled
/// and plugged in again; the others go on.
#[test]
fn four_kinds_at_once_are_pulled_and_plugged_in_again() {
    let folder = tempfile::tempdir().unwrap();
    let (gauge, ..) = modbus_tcp(Arc::new(|_, _, _, _| 450));
    let link = folder.path().join("distance");
    let (mut distance, held, port) = terminal();
    symlink(&port, &link).unwrap();
    let scale = TcpListener::bind("127.0.0.1:0").unwrap();
    let scale_address = scale.local_addr().unwrap();
    let camera = UdpSocket::bind("127.0.0.1:0").unwrap();
    let camera_address = UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let body = format!(
        "pace = 200\n\
         [actuator.sensors.gauge]\nkind = \"modbus\"\ntcp = \"{gauge}\"\nrate_hz = 100\nage_limit_ms = 3000\ntimeout_ms = 2000\n\
         values.pressure_mpa = {{ from = {{ register = 2 }}, points = [[0, 0.0], [900, 90.0]], unit = \"kPa\" }}\n\
         [actuator.sensors.distance]\nkind = \"lines\"\nserial = {{ port = \"{}\", baud = 115200 }}\nage_limit_ms = 200\n\
         values.gap_mm = {{ from = 2, unit = \"um\", offset = 500 }}\n\
         [actuator.sensors.scale]\nkind = \"lines\"\ntcp = \"{scale_address}\"\nage_limit_ms = 200\n\
         values.force_n = {{ from = \"grams\", unit = \"gf\", filter = {{ median = 3 }} }}\n\
         [actuator.sensors.camera]\nkind = \"lines\"\nudp = \"{camera_address}\"\nage_limit_ms = 200\n\
         values.marker1_x_mm = {{ from = 1 }}\nvalues.marker1_y_mm = {{ from = 2 }}\nvalues.marker1_z_mm = {{ from = 3 }}",
        link.display()
    );
    let mut source = start_one(folder.path(), &body);
    let (mut weighing, _) = scale.accept().unwrap();
    let say = |distance: &mut File, weighing: &mut TcpStream| {
        let _maybe_pulled = distance.write_all(b"7; 39500\r\n");
        let _maybe_pulled = weighing.write_all(b"{\"grams\": 100.0}\n");
        camera.send_to(b"1.5; 2.5; -3.5", camera_address).unwrap();
    };
    let whole = |reading: &SensorSample| reading.stale_values == 0;
    let all = say_until(&mut source, || say(&mut distance, &mut weighing), "all values", whole);
    assert!((all.pressure_mpa - 0.045).abs() < 1e-12, "{all:?}");
    assert!((all.gap_mm - 40.0).abs() < 1e-9, "{all:?}: 39500 + 500 um");
    assert!((all.measured_force_n - 0.980_665).abs() < 1e-12, "{all:?}: 100 gf");
    assert_eq!((all.marker_values, all.markers_mm[0]), (3, Marker { x: 1.5, y: 2.5, z: -3.5 }));
    let Ages { pressure, gap, force, markers } = all.ages_ns;
    assert!(pressure.max(gap).max(force).max(markers[0]) <= 3_000_000_000 && all.status == 0);

    // The plug of the distance sensor is pulled, and put in again under the same name.
    drop((distance, held));
    let without = say_until(
        &mut source,
        || {
            weighing.write_all(b"{\"grams\": 100.0}\n").unwrap();
            camera.send_to(b"1.5; 2.5; -3.5", camera_address).unwrap();
        },
        "a reading without the gap",
        |reading| reading.stale_values == 0b10,
    );
    assert!(
        without.gap_mm.is_nan() && without.pressure_mpa.is_finite() && without.measured_force_n.is_finite()
    );
    assert!(
        (200_000_000..400_000_000).contains(&without.ages_ns.gap),
        "absent within its limit: {without:?}"
    );
    wait_until("the pulled plug is counted", || {
        let distance = counters(&source, "distance");
        count(&distance, "disconnects") + count(&distance, "refusals") > 0
    });
    let (mut distance, _held, port) = terminal();
    let renamed = folder.path().join("new");
    symlink(&port, &renamed).unwrap();
    fs::rename(&renamed, &link).unwrap();
    say_until(&mut source, || say(&mut distance, &mut weighing), "the gap again", whole);

    // The scale goes off and on again: a new connection.
    drop(weighing);
    let without_force = |reading: &SensorSample| reading.stale_values == 0b100;
    let quiet = |distance: &mut File| {
        distance.write_all(b"7; 39500\n").unwrap();
        camera.send_to(b"1.5; 2.5; -3.5", camera_address).unwrap();
    };
    say_until(&mut source, || quiet(&mut distance), "a reading without the force", without_force);
    let (mut weighing, _) = scale.accept().unwrap();
    say_until(&mut source, || say(&mut distance, &mut weighing), "the force again", whole);

    // The camera sees nothing, then says nonsense, then nothing at all.
    camera.send_to(b";;", camera_address).unwrap();
    let unseen =
        wait_for(&mut source, "a marker that is not seen", |reading| reading.markers_mm[0].x.is_nan());
    assert_eq!((unseen.stale_values & 0b1000, unseen.fault_values), (0, 0), "{unseen:?}");
    camera.send_to(b"1.5; two", camera_address).unwrap();
    wait_for(&mut source, "a silent camera", |reading| reading.stale_values & 0b1000 != 0);
    assert_eq!(count(&counters(&source, "camera"), "garbage"), 1);
}

fn runs(pid: u32) -> bool {
    fs::read_to_string(format!("/proc/{pid}/stat")).is_ok_and(|stat| !stat.contains(") Z "))
}

/// A program that prints lines: restarted when it ends, and killed, with what it has started, when the source ends.
#[test]
fn a_program_that_prints_lines_is_restarted_and_ends_with_the_source() {
    let folder = tempfile::tempdir().unwrap();
    let script = folder.path().join("sensor.sh");
    // Its number, that of a program it starts, then the end as soon as a file asks for it.
    let text = "#!/bin/sh\nsleep 1000 &\necho \"fault\" >&2\nwhile [ ! -e stop ]; do echo \"0.03; $$; $!\"; sleep 0.01; done\nkill $!; rm stop\n";
    fs::write(&script, text).unwrap();
    let body = "[actuator.sensors.own]\nkind = \"lines\"\ncommand = [\"/bin/sh\", \"sensor.sh\"]\nage_limit_ms = 300\n\
         values.pressure_mpa = { from = 1 }\nvalues.gap_mm = { from = 2 }\nvalues.force_n = { from = 3 }";
    let mut source = start_one(folder.path(), body);
    let first = wait_for(&mut source, "a line", |reading| reading.status == 0);
    let first_pid = first.gap_mm as u32;
    assert!(runs(first_pid) && first.pressure_mpa == 0.03);
    fs::write(folder.path().join("stop"), "").unwrap();
    let second = wait_for(&mut source, "a line of another start", |reading| {
        reading.status == 0 && reading.gap_mm as u32 != first_pid
    });
    assert!(!runs(first_pid) && count(&counters(&source, "own"), "disconnects") > 0);
    let started = [second.gap_mm as u32, second.measured_force_n as u32];
    assert!(started.iter().all(|pid| runs(*pid)));
    drop(source);
    wait_until("the program and what it has started are gone", || !started.iter().any(|pid| runs(*pid)));
}

#[test]
fn a_program_that_does_not_start_is_tried_again() {
    let folder = tempfile::tempdir().unwrap();
    let body = "[actuator.sensors.own]\nkind = \"lines\"\ncommand = [\"./sensor\"]\nage_limit_ms = 50\n\
         values.pressure_mpa = { from = \"p\" }";
    let mut source = start_one(folder.path(), body);
    let without = wait_for(&mut source, "a reading without a value", |_| true);
    assert!(without.status == 256 && without.stale_values == 1);
    wait_until("a refusal", || count(&counters(&source, "own"), "refusals") > 0);
    let program = folder.path().join("new");
    fs::write(&program, "#!/bin/sh\nwhile echo '{\"p\": 0.02}'; do sleep 0.01; done\n").unwrap();
    let executable = std::os::unix::fs::PermissionsExt::from_mode(0o755);
    fs::set_permissions(&program, executable).unwrap();
    fs::rename(&program, folder.path().join("sensor")).unwrap();
    wait_for(&mut source, "its first line", |reading| reading.pressure_mpa == 0.02);
}

/// Two actuators take their own cells out of the same datagrams.
#[test]
fn two_actuators_read_the_same_lines() {
    let folder = tempfile::tempdir().unwrap();
    let address = UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let body = |cell: u8| {
        format!(
            "[actuator.sensors.board]\nkind = \"lines\"\nudp = \"{address}\"\nvalues.pressure_mpa = {{ from = {cell} }}"
        )
    };
    let scene = scene(folder.path(), &[&body(1), &body(2)]).unwrap();
    let mut sources = start(&scene, &Devices::default());
    let (sender, (stop, stopped)) = (UdpSocket::bind("127.0.0.1:0").unwrap(), sync_channel::<()>(0));
    let board = thread::spawn(move || {
        while stopped.try_recv() != Err(std::sync::mpsc::TryRecvError::Disconnected) {
            sender.send_to(b"0.01; 0.02\n0.01; 0.02", address).unwrap();
            thread::sleep(Duration::from_millis(2));
        }
    });
    for (source, expected) in sources.iter_mut().zip([0.01, 0.02]) {
        let reading = wait_for(source, "a line", |reading| reading.status == 0);
        assert_eq!(reading.pressure_mpa, expected);
    }
    drop(stop);
    board.join().unwrap();
}

#[test]
fn all_errors_in_the_sensors_of_a_scene_are_listed() {
    let folder = tempfile::tempdir().unwrap();
    let first = "pace = \"gouge\"\nsensor = \"other\"\n\
        [actuator.sensors.gauge]\nkind = \"modbus\"\ntcp = \"here\"\nserial = { port = \"/dev/ttyX\", baud = 7 }\nrate_hz = 5\n\
        values.pressure = { from = { unit_id = 0, register = 1 } }\n\
        [actuator.sensors.gap]\nkind = \"lines\"\ntcp = \"a:1\"\nudp = \"b\"\nvalues.gap_mm = { from = 0, unit = \"bar\" }\n\
        [actuator.sensors.cell]\nkind = \"lines\"\ncommand = []\nvalues.gap_mm = { from = 1 }\n\
        [actuator.sensors.adc]\nkind = \"modbus\"\ntcp = \"a:1\"\nrate_hz = 0\nvalues.force_n = { from = { register = 1 } }";
    let text = scene(folder.path(), &[first]).unwrap_err();
    for (key, found) in [
        ("pace", "found `gouge`"),
        ("sensors.gauge.tcp, ", "found both"),
        ("sensors.gauge.tcp: expected `host:port`", "found `here`"),
        ("sensors.gauge.serial.baud", "found 7"),
        ("sensors.gauge.values.pressure", "`pressure_mpa`"),
        ("sensors.gauge.values.pressure.from.unit_id", "found 0"),
        ("sensors.gauge.age_limit_ms", "200 ms between"),
        ("sensors.gap: expected at most one", "found tcp, udp"),
        ("sensors.gap.udp", "found `b`"),
        ("sensors.gap.values.gap_mm.from", "found 0"),
        ("sensors.gap.values.gap_mm.unit", "found `bar`"),
        ("sensors.gap.values.gap_mm", "`cell` too"),
        ("sensors.cell.command", "found nothing"),
        ("sensors.adc.rate_hz", "found 0"),
        ("sensors: expected a sensor with pressure_mpa", "found none"),
        ("listens to another's", "its own sensors"),
    ] {
        let said =
            text.lines().any(|line| line.contains(key) && line.contains(found) && line.contains("`finger0`"));
        assert!(said, "{key} ... {found} is missing:\n{text}");
    }
    let port = |baud: u32, name: &str| {
        format!(
            "[actuator.sensors.{name}]\nkind = \"modbus\"\nserial = {{ port = \"/dev/ttyX\", baud = {baud} }}\n\
             values.pressure_mpa = {{ from = {{ register = 1 }} }}"
        )
    };
    assert!(scene(folder.path(), &[&port(9600, "a"), &port(9600, "b")]).is_ok(), "one bus for both");
    let text = scene(folder.path(), &[&port(9600, "a"), &port(19_200, "b")]).unwrap_err();
    assert!(text.contains("finger1") && text.contains("sensors.b"), "{text}");
    let valve = "[actuator.valve]\nrange_mpa = [0.0, 0.1]\n[actuator.valve.modbus]\nserial = { port = \"/dev/ttyX\", baud = 300 }\n\
         value = { from = { register = 3, encoding = \"f32\" } }";
    let text = scene(folder.path(), &[&format!("{}\n{valve}", port(9600, "a"))]).unwrap_err();
    assert!(text.contains("valve.modbus"), "{text}");
    let text = scene(folder.path(), &["pace = 3"]).unwrap_err();
    assert!(text.contains("pace"), "{text}");
    let text = scene(folder.path(), &["[actuator.sensors.a]\nkind = \"modbus\"\nrate = 3\nvalues = {}"])
        .unwrap_err();
    assert!(text.contains("`rate`"), "{text}");
}

/// Inputs of a model that is no actuator's come from devices by their names; no sensor has a pressure.
#[test]
fn measured_inputs_come_from_devices_and_need_no_pressure() {
    let (address, ..) = modbus_tcp(Arc::new(|_, _, register, _| 100 * register));
    let folder = tempfile::tempdir().unwrap();
    let command = "sh\", \"-c\", \"echo '{\\\"shift\\\": 12.5}'; exec sleep 600";
    let actuator = |inputs: &str| {
        format!(
            "pace = \"cell\"\n[actuator.inputs]\n{inputs}\nwidth_mm = 20\n[actuator.sensors.cell]\nkind = \"modbus\"\n\
             tcp = \"{address}\"\nrate_hz = 200\ntimeout_ms = 2000\nage_limit_ms = 5000\n\
             values.load_n = {{ from = {{ register = 26 }}, unit = \"mN\" }}\n\
             [actuator.sensors.ruler]\nkind = \"lines\"\ncommand = [\"{command}\"]\nage_limit_ms = 600000\n\
             values.shift_mm = {{ from = \"shift\", scale = 0.1 }}\n"
        )
    };
    let mut source = start_one(folder.path(), &actuator("load_n = \"measured\"\nshift_mm = { min = 0 }"));
    let reading = wait_for(&mut source, "both inputs", |reading| reading.stale_values == 0);
    let named: Vec<(String, f64)> = reading.inputs().collect();
    assert_eq!(named.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>(), ["load_n", "shift_mm"]);
    assert!((named[0].1 - 2.6).abs() < 1e-12 && (named[1].1 - 1.25).abs() < 1e-12, "{named:?}");
    assert!(reading.status == 0 && reading.pressure_mpa.is_nan() && reading.age_count == 11);
    let refused = |inputs: &str| scene(folder.path(), &[&actuator(inputs)]).unwrap_err();
    let text = refused("load_n = 2.0\nshift_mm = 1.0");
    assert!(text.contains("values.load_n"), "{text}");
    let text = refused("load_n = \"measured\"\nshift_mm = \"measured\"\ntorque_nmm = \"measured\"");
    assert!(text.contains("torque_nmm"), "{text}");
}
