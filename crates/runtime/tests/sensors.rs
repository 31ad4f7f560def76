//! Sensors against the other end of the wire: a real Modbus server over TCP and over a pseudo-terminal, and one that
//! misbehaves in every way a cable and a device can.

use proptest::prelude::*;
use runtime::source::{
    ByteOrder, Cell, Devices, Encoding, FilterSpec, InputNames, LinesSensor, ModbusSensor, RegisterAt,
    SensorCounters, SensorSpec, Sensors, SerialSpec, Source, SourceReader, Table, ValueSpec, Values,
    open_sensors,
};
use std::fs::File;
use std::future::{Ready, ready};
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::os::fd::AsRawFd;
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU16, AtomicUsize, Ordering};
use std::sync::mpsc::sync_channel;
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};
use tokio_modbus::server::Service;
use tokio_modbus::{ExceptionCode, Request, Response, SlaveRequest};
use tokio_serial::{SerialPort, SerialStream};
use wire::SensorSample;

/// Longest wait for something that must come; a failing test ends there.
const PATIENCE: Duration = Duration::from_secs(20);

/// A device: pressure 0.1 kPa a step in input register 2, gap as little-word f32 in holding registers 10-11, force in
/// unit 7; `fault` is the exception it answers with, 0: none.
#[derive(Clone, Default)]
struct Device {
    steps: Arc<AtomicU16>,
    fault: Arc<AtomicU16>,
}

impl Service for Device {
    type Request = SlaveRequest<'static>;
    type Response = Response;
    type Exception = ExceptionCode;
    type Future = Ready<Result<Response, ExceptionCode>>;

    fn call(&self, request: Self::Request) -> Self::Future {
        let fault = self.fault.load(Ordering::SeqCst) as u8;
        if fault != 0 {
            return ready(Err(ExceptionCode::new(fault)));
        }
        let gap = 40.25f32.to_bits();
        ready(match (request.slave, request.request) {
            (1, Request::ReadInputRegisters(2, 1)) => {
                Ok(Response::ReadInputRegisters(vec![self.steps.load(Ordering::SeqCst)]))
            }
            (1, Request::ReadHoldingRegisters(10, 2)) => {
                Ok(Response::ReadHoldingRegisters(vec![gap as u16, (gap >> 16) as u16]))
            }
            (7, Request::ReadInputRegisters(0, 2)) => Ok(Response::ReadInputRegisters(vec![0xffff, 0xff9c])),
            _ => Err(ExceptionCode::IllegalDataAddress),
        })
    }
}

fn register(unit_id: u8, register: u16, table: Table, encoding: Encoding) -> RegisterAt {
    RegisterAt { unit_id, register, table, encoding, byte_order: ByteOrder::Abcd }
}

fn value<P>(from: P, scale: f64, unit: &str) -> ValueSpec<P> {
    let (offset, points, filter, unit) = (0.0, Vec::new(), FilterSpec::Off, Some(unit.to_owned()));
    ValueSpec { from, scale, offset, points, unit, filter, no_value: vec![], sigma: None }
}

fn pressure() -> ValueSpec<RegisterAt> {
    value(register(1, 2, Table::Input, Encoding::I16), 0.1, "kPa")
}

/// Polls fast and gives up fast, so that the tests do; no value is too old.
fn modbus() -> ModbusSensor {
    ModbusSensor {
        tcp: None,
        serial: None,
        rate_hz: 200.0,
        timeout_ms: 300.0,
        backoff_max_ms: 50.0,
        age_limit_ms: 600_000.0,
        values: Values::from([("pressure_mpa".to_owned(), pressure())]),
    }
}

fn open(spec: SensorSpec) -> Result<Box<dyn Source>, Vec<String>> {
    let sensors = Sensors::from([("device".to_owned(), spec)]);
    open_sensors(&sensors, None, Path::new(""), &Devices::default(), &InputNames::default())
}

fn start(spec: SensorSpec) -> SourceReader {
    SourceReader::start(open(spec).unwrap()).unwrap()
}

/// The first reading that fits; readings before it may be older news.
fn wait_for(source: &mut SourceReader, what: &str, fits: impl Fn(&SensorSample) -> bool) -> SensorSample {
    let end = Instant::now() + PATIENCE;
    loop {
        let left = end.saturating_duration_since(Instant::now());
        let reading = source.next(left).unwrap_or_else(|| panic!("{what}: nothing within {PATIENCE:?}"));
        if fits(&reading) {
            return reading;
        }
    }
}

fn device(source: &SourceReader) -> Arc<SensorCounters> {
    source.devices()[0].1.clone()
}

fn counter(source: &SourceReader, name: &str) -> u64 {
    device(source).all().iter().find(|(found, _)| *found == name).unwrap().1
}

fn wait_for_count(source: &SourceReader, name: &str) {
    let end = Instant::now() + PATIENCE;
    while counter(source, name) == 0 {
        assert!(Instant::now() < end, "{name} was never counted: {}", device(source).summary());
        thread::yield_now();
    }
}

fn runtime() -> tokio::runtime::Runtime {
    tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap()
}

/// Serves `device` on a free port until the test's process ends.
fn serve_tcp(device: Device) -> SocketAddr {
    let (sender, receiver) = sync_channel(1);
    thread::spawn(move || {
        runtime().block_on(async move {
            let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
            sender.send(listener.local_addr().unwrap()).unwrap();
            let server = tokio_modbus::server::tcp::Server::new(listener);
            let accept = |stream, _| ready(Ok(Some((device.clone(), stream))));
            server.serve(&accept, |_| ()).await.unwrap();
        });
    });
    receiver.recv_timeout(PATIENCE).unwrap()
}

#[test]
fn a_device_over_tcp_with_three_quantities_and_an_exception() {
    let device = Device::default();
    device.steps.store(450, Ordering::SeqCst);
    let mut spec = ModbusSensor { tcp: Some(serve_tcp(device.clone()).to_string()), ..modbus() };
    let gap = register(1, 10, Table::Holding, Encoding::F32);
    let gap = value(RegisterAt { byte_order: ByteOrder::Cdab, ..gap }, 1.0, "mm");
    let force = value(register(7, 0, Table::Input, Encoding::I32), 1.0, "mN");
    spec.values.extend([("gap_mm".to_owned(), gap), ("force_n".to_owned(), force)]);
    let mut source = start(SensorSpec::Modbus(spec));
    let reading = wait_for(&mut source, "first reading", |reading| reading.status == 0);
    assert!((reading.pressure_mpa - 0.045).abs() < 1e-15, "{reading:?}: 450 x 0.1 kPa");
    assert_eq!(reading.gap_mm, 40.25);
    assert!((reading.measured_force_n + 0.1).abs() < 1e-15, "{reading:?}: -100 mN");

    device.fault.store(4, Ordering::SeqCst);
    let faulty = wait_for(&mut source, "exception", |reading| reading.status != 0);
    assert!(
        faulty.status == 4 && faulty.pressure_mpa.is_nan(),
        "{faulty:?}: a device failure has its status"
    );
    device.fault.store(0, Ordering::SeqCst);
    device.steps.store((-30i16).cast_unsigned(), Ordering::SeqCst);
    wait_for(&mut source, "recovery", |reading| (reading.pressure_mpa + 0.003).abs() < 1e-15);
    assert!(counter(&source, "exceptions") > 0 && counter(&source, "disconnects") == 0);
}

/// A pseudo-terminal: the test holds one end, the sensor opens the other by its name.
fn pseudo_terminal() -> (SerialStream, File, SerialSpec) {
    let (ours, theirs) = SerialStream::pair().unwrap();
    let port = PathBuf::from(theirs.name().expect("a pseudo-terminal has a name"));
    // The other end stays open without the library's lock on it: a terminal that no process has open reports a hang-up.
    let held = File::options().read(true).custom_flags(libc::O_NOCTTY).open(&port).unwrap();
    drop(theirs);
    let spec = SerialSpec { port, baud: 115_200, data_bits: 8, parity: Default::default(), stop_bits: 1 };
    (ours, held, spec)
}

#[test]
fn a_device_over_a_serial_line() {
    let device = Device::default();
    device.steps.store(700, Ordering::SeqCst);
    let served = device.clone();
    let (sender, receiver) = sync_channel(1);
    thread::spawn(move || {
        runtime().block_on(async move {
            let (ours, held, spec) = pseudo_terminal();
            sender.send(spec).unwrap();
            tokio_modbus::server::rtu::Server::new(ours).serve_forever(served).await.unwrap();
            drop(held);
        });
    });
    let spec = receiver.recv_timeout(PATIENCE).unwrap();
    let mut source = start(SensorSpec::Modbus(ModbusSensor { serial: Some(spec), ..modbus() }));
    let reading = wait_for(&mut source, "first reading", |reading| reading.status == 0);
    assert!((reading.pressure_mpa - 0.07).abs() < 1e-15, "{reading:?}");
    device.fault.store(2, Ordering::SeqCst);
    wait_for(&mut source, "exception", |reading| reading.status == 2);
    device.fault.store(0, Ordering::SeqCst);
    wait_for(&mut source, "recovery", |reading| reading.status == 0);
}

/// Fault of a device on a connection.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Fault {
    CloseAtOnce,
    CloseInTheMiddle,
    Silence,
    Truncated,
    Slow,
    Flood,
    Garbage,
    WrongProtocol,
    WrongUnit,
    WrongFunction,
    UnknownFunction,
    LateAnswer,
    AnswersTwice,
    LengthZero,
    Oversized,
    WrongCount,
    ByteCountLies,
    NoData,
    OddBytes,
    EmptyException,
    UnknownException,
    Behave,
}

/// All but the last.
const MISCHIEFS: [Fault; 21] = [
    Fault::CloseAtOnce,
    Fault::CloseInTheMiddle,
    Fault::Silence,
    Fault::Truncated,
    Fault::Slow,
    Fault::Flood,
    Fault::Garbage,
    Fault::WrongProtocol,
    Fault::WrongUnit,
    Fault::WrongFunction,
    Fault::UnknownFunction,
    Fault::LateAnswer,
    Fault::AnswersTwice,
    Fault::LengthZero,
    Fault::Oversized,
    Fault::WrongCount,
    Fault::ByteCountLies,
    Fault::NoData,
    Fault::OddBytes,
    Fault::EmptyException,
    Fault::UnknownException,
];

/// A device over TCP that does one mischief with each connection of `plan`, and then behaves.
fn misbehave(plan: Vec<Fault>) -> (SocketAddr, Arc<AtomicUsize>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    let connections = Arc::new(AtomicUsize::new(0));
    let counted = connections.clone();
    let silent = Arc::new(Mutex::new(Vec::new()));
    thread::spawn(move || {
        for stream in listener.incoming().flatten() {
            let number = counted.fetch_add(1, Ordering::SeqCst);
            let mischief = plan.get(number).copied().unwrap_or(Fault::Behave);
            let silent = silent.clone();
            thread::spawn(move || answer(stream, mischief, &silent));
        }
    });
    (address, connections)
}

/// 45.0 kPa: what a device that behaves answers.
const GOOD: [u8; 3] = [2, 0x01, 0xc2];
/// 27.3 kPa: what no reading may ever show.
const WRONG: [u8; 3] = [2, 0x01, 0x11];

/// A frame of Modbus TCP.
fn frame(transaction: u16, protocol: u8, unit: u8, function: u8, data: &[u8]) -> Vec<u8> {
    let [high, low] = transaction.to_be_bytes();
    [&[high, low, 0, protocol, 0, data.len() as u8 + 2, unit, function], data].concat()
}

fn answer(mut stream: TcpStream, mischief: Fault, silent: &Mutex<Vec<TcpStream>>) {
    if mischief == Fault::CloseAtOnce {
        return;
    }
    let mut request = [0u8; 12];
    while stream.read_exact(&mut request).is_ok() {
        let t = u16::from_be_bytes([request[0], request[1]]);
        let reply: Vec<u8> = match mischief {
            // Kept open and unanswered.
            Fault::Silence => return silent.lock().unwrap().push(stream),
            Fault::CloseInTheMiddle | Fault::Truncated => frame(t, 0, 1, 4, &WRONG)[..7].to_vec(),
            Fault::Garbage => b"\xde\xad\xbe\xef\xde\xad\xbe\xef\xde\xad\xbe\xef\xde\xad".to_vec(),
            Fault::WrongProtocol => frame(t, 7, 1, 4, &WRONG),
            Fault::WrongUnit => frame(t, 0, 9, 4, &WRONG),
            Fault::WrongFunction => frame(t, 0, 1, 3, &WRONG),
            Fault::UnknownFunction => frame(t, 0, 1, 0x55, &WRONG),
            Fault::LateAnswer => frame(t.wrapping_sub(1), 0, 1, 4, &WRONG),
            Fault::AnswersTwice => [frame(t, 0, 1, 4, &GOOD), frame(t, 0, 1, 4, &WRONG)].concat(),
            Fault::LengthZero => [&frame(t, 0, 1, 4, &[])[..4], &[0, 0, 1, 4]].concat(),
            Fault::Oversized => {
                [&frame(t, 0, 1, 4, &WRONG)[..4], &[0xff, 0xff, 1, 4], &[2; 70_000][..]].concat()
            }
            Fault::WrongCount => frame(t, 0, 1, 4, &[4, 1, 2, 3, 4]),
            Fault::ByteCountLies => frame(t, 0, 1, 4, &[200, 0x01, 0x11]),
            Fault::NoData => frame(t, 0, 1, 4, &[0]),
            Fault::OddBytes => frame(t, 0, 1, 4, &[3, 0x01, 0x11, 0]),
            Fault::EmptyException => frame(t, 0, 1, 0x84, &[]),
            Fault::UnknownException => frame(t, 0, 1, 0x84, &[0x63]),
            Fault::Slow => {
                // A byte now and then: the whole answer takes longer than the client waits.
                for byte in frame(t, 0, 1, 4, &WRONG) {
                    thread::sleep(Duration::from_millis(60));
                    if stream.write_all(&[byte]).is_err() {
                        return;
                    }
                }
                continue;
            }
            Fault::Flood => {
                while stream.write_all(&[0x04; 4096]).is_ok() {}
                return;
            }
            Fault::Behave | Fault::CloseAtOnce => frame(t, 0, 1, 4, &GOOD),
        };
        if stream.write_all(&reply).is_err() || mischief == Fault::CloseInTheMiddle {
            return;
        }
    }
}

/// With any bytes from a device the source continues, and no reading has a value that the device did not send as its answer.
#[test]
fn faults_of_a_device_end_in_good_readings() {
    for mischief in MISCHIEFS {
        let (address, _) = misbehave(vec![mischief; 2]);
        let spec = ModbusSensor { tcp: Some(address.to_string()), timeout_ms: 200.0, ..modbus() };
        let mut source = start(SensorSpec::Modbus(spec));
        let is_exception = mischief == Fault::UnknownException;
        let (end, mut good) = (Instant::now() + PATIENCE, 0);
        while good < 5 && !(is_exception && counter(&source, "exceptions") > 2) {
            let reading = source.next(end.saturating_duration_since(Instant::now()));
            let reading = reading.unwrap_or_else(|| panic!("{mischief:?}: nothing within {PATIENCE:?}"));
            if reading.status == 0 {
                assert!((reading.pressure_mpa - 0.045).abs() < 1e-15, "{mischief:?}: {reading:?}");
                good += 1;
            } else {
                assert!(reading.pressure_mpa.is_nan() && is_exception, "{mischief:?}: {reading:?}");
            }
        }
        let failures: u64 =
            device(&source).all().iter().filter(|(name, _)| *name != "readings").map(|(_, n)| n).sum();
        // A second answer is discarded before the next request, which is no failure.
        assert!(failures > 0 || mischief == Fault::AnswersTwice, "{mischief:?} was counted as nothing");
    }
}

#[test]
fn each_fault_is_followed_by_a_new_connection() {
    let plan =
        [Fault::CloseAtOnce, Fault::Silence, Fault::Garbage, Fault::WrongCount, Fault::CloseInTheMiddle];
    let (address, connections) = misbehave(plan.to_vec());
    let mut source = start(SensorSpec::Modbus(ModbusSensor { tcp: Some(address.to_string()), ..modbus() }));
    let reading = source.next(PATIENCE).expect("a good reading in the end");
    assert!(
        (reading.pressure_mpa - 0.045).abs() < 1e-15 && reading.status == 0,
        "nothing wrong came first: {reading:?}"
    );
    assert_eq!(connections.load(Ordering::SeqCst), plan.len() + 1, "one connection for each mischief");
    let failures = ["timeouts", "garbage", "disconnects"].map(|name| counter(&source, name));
    assert_eq!(failures.iter().sum::<u64>(), plan.len() as u64, "{:?}", device(&source).all());
    assert!(failures[0] >= 1, "the silent one ran into the time-out: {:?}", device(&source).all());
}

/// The same on a serial line, where nothing but unit, function and checksum tell a good answer from another.
#[test]
fn a_serial_device_with_bad_frames_ends_in_good_readings() {
    let (sender, receiver) = sync_channel(1);
    thread::spawn(move || {
        let (ours, held, spec) = runtime().block_on(async { pseudo_terminal() });
        let mut ours = File::from(dup(&ours));
        // SAFETY: the descriptor is open; waiting reads are all that the test does with it.
        assert_eq!(unsafe { libc::fcntl(ours.as_raw_fd(), libc::F_SETFL, 0) }, 0);
        sender.send(spec).unwrap();
        let crc = |bytes: &[u8]| {
            let step = |crc: u16| if crc & 1 == 1 { (crc >> 1) ^ 0xa001 } else { crc >> 1 };
            bytes.iter().fold(0xffff_u16, |crc, byte| (0..8).fold(crc ^ u16::from(*byte), |crc, _| step(crc)))
        };
        let checked = |bytes: &[u8]| [bytes, &crc(bytes).to_le_bytes()].concat();
        let bad: [Vec<u8>; 6] = [
            [&[1, 4, 2, 0x01, 0x11][..], &[0xde, 0xad]].concat(), // checksum
            checked(&[9, 4, 2, 0x01, 0x11]),                      // unit
            checked(&[1, 3, 2, 0x01, 0x11]),                      // function
            vec![1, 4, 2],                                        // truncated
            vec![0xff; 300],                                      // noise
            checked(&[1, 4, 4, 0x01, 0x11, 0x01, 0x11]),          // two registers for one
        ];
        let mut request = [0u8; 1];
        let (mut bytes, mut answers) = (Vec::new(), bad.iter());
        while ours.read_exact(&mut request).is_ok() {
            bytes.push(request[0]);
            // A request is eight bytes with their checksum; what is left of another is cut off.
            if bytes.len() >= 8 && crc(&bytes[bytes.len() - 8..]) == 0 {
                bytes.clear();
                let good = checked(&[&[1, 4][..], &GOOD].concat());
                ours.write_all(answers.next().unwrap_or(&good)).unwrap();
            }
        }
        drop(held);
    });
    let serial = receiver.recv_timeout(PATIENCE).unwrap();
    let spec = ModbusSensor { serial: Some(serial), timeout_ms: 150.0, ..modbus() };
    let mut source = start(SensorSpec::Modbus(spec));
    let reading = source.next(PATIENCE).expect("a good reading in the end");
    assert!((reading.pressure_mpa - 0.045).abs() < 1e-15 && reading.status == 0, "{reading:?}");
    let failures = ["timeouts", "garbage", "disconnects"].map(|name| counter(&source, name));
    assert!(failures.iter().sum::<u64>() >= 6, "{:?}", device(&source).all());
}

#[test]
fn a_device_that_is_not_there_is_tried_again_until_it_is() {
    let reserved = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = reserved.local_addr().unwrap();
    drop(reserved);
    let mut source = start(SensorSpec::Modbus(ModbusSensor { tcp: Some(address.to_string()), ..modbus() }));
    wait_for_count(&source, "refusals");
    let listener = TcpListener::bind(address).unwrap();
    thread::spawn(move || {
        for stream in listener.incoming().flatten() {
            answer(stream, Fault::Behave, &Mutex::default());
        }
    });
    wait_for(&mut source, "first reading", |reading| reading.status == 0);
}

#[test]
fn a_line_protocol_over_a_serial_line_with_garbage_between() {
    let (sender, receiver) = sync_channel(1);
    let (say, said) = sync_channel::<&'static [u8]>(0);
    thread::spawn(move || {
        let (ours, held, spec) = runtime().block_on(async { pseudo_terminal() });
        let mut ours = File::from(dup(&ours));
        sender.send(spec).unwrap();
        said.iter().for_each(|bytes| ours.write_all(bytes).unwrap());
        drop(held);
    });
    let serial = receiver.recv_timeout(PATIENCE).unwrap();
    let spec = LinesSensor {
        serial: Some(serial),
        tcp: None,
        udp: None,
        command: None,
        comma_separates: false,
        age_limit_ms: 600_000.0,
        values: Values::from([
            ("pressure_mpa".to_owned(), value(Cell::Number(1), 1.0, "bar")),
            ("gap_mm".to_owned(), value(Cell::Number(2), 1.0, "mm")),
        ]),
    };
    let mut source = start(SensorSpec::Lines(spec));
    // What is sent before the sensor has opened the line is cleared away; so the first line is repeated until heard.
    let first = loop {
        say.send(b"0.31,40\n").unwrap();
        if let Some(reading) = source.next(Duration::from_millis(20)) {
            break reading;
        }
    };
    assert!((first.pressure_mpa - 0.031).abs() < 1e-15 && first.gap_mm == 40.0, "{first:?}");
    say.send(b"E\xfcRR 99\n\n# note\n").unwrap();
    say.send(b"0.5; 15\r\n").unwrap();
    let second = wait_for(&mut source, "the line after the garbage", |reading| reading.gap_mm == 15.0);
    assert!((second.pressure_mpa - 0.05).abs() < 1e-15);
    assert!(counter(&source, "garbage") >= 1);
}

fn dup(stream: &SerialStream) -> std::os::fd::OwnedFd {
    use std::os::fd::BorrowedFd;
    // SAFETY: the descriptor is open for as long as `stream` is borrowed, and only duplicated here.
    unsafe { BorrowedFd::borrow_raw(stream.as_raw_fd()) }.try_clone_to_owned().unwrap()
}

#[test]
fn a_specification_tells_all_its_problems_at_once() {
    let mut bad =
        ModbusSensor { tcp: Some("nowhere".into()), rate_hz: f64::NAN, timeout_ms: -1.0, ..modbus() };
    let wrong = ValueSpec { filter: FilterSpec::Median(4), unit: Some("N".into()), ..pressure() };
    bad.values.insert("pressure_mpa".to_owned(), wrong);
    let problems = open(SensorSpec::Modbus(bad)).unwrap_err();
    assert_eq!(problems.len(), 5, "{problems:#?}");
    let neither = open(SensorSpec::Modbus(modbus())).unwrap_err();
    assert!(neither.len() == 1 && neither[0].contains("tcp"), "{neither:?}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    /// Any bytes as the answer to a request, then the end of the connection: no panic, no reading made of noise that the
    /// protocol does not carry, and a new connection afterwards.
    #[test]
    fn any_answer_of_a_device_is_survived(noise in prop::collection::vec(any::<u8>(), 0..64)) {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let server = thread::spawn(move || {
            let (mut stream, _) = listener.accept().unwrap();
            let mut request = [0u8; 12];
            stream.read_exact(&mut request).unwrap();
            stream.write_all(&noise).unwrap();
            drop(stream);
            let (stream, _) = listener.accept().unwrap();
            answer(stream, Fault::Behave, &Mutex::default());
        });
        let spec = ModbusSensor { tcp: Some(address.to_string()), ..modbus() };
        let mut source = start(SensorSpec::Modbus(spec));
        let good = wait_for(&mut source, "a good reading", |reading| (reading.pressure_mpa - 0.045).abs() < 1e-15);
        prop_assert_eq!(good.status, 0);
        drop(source);
        server.join().unwrap();
    }
}
