use super::*;
use crate::problems::Problems;
use crate::source::{Devices, ModbusPath};
use std::future::{Ready, ready};
use std::io::{BufRead, BufReader};
use std::net::TcpListener;
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, Mutex};
use tokio_modbus::server::Service;
use tokio_modbus::{ExceptionCode, Request, Response, SlaveRequest};

fn device(text: &str, devices: &Devices) -> Device {
    let spec: ValveSpec = toml::from_str(&format!("range_mpa = [0.0, 0.08]\n{text}")).unwrap();
    let mut problems = Vec::new();
    spec.problems(&mut Problems::new(&mut problems, "actuator[0].valve"));
    assert!(problems.is_empty(), "{problems:?}");
    let path = spec
        .modbus
        .as_ref()
        .and_then(|modbus| ModbusPath::new(modbus.tcp.as_deref(), modbus.serial.as_ref()));
    Device::new(&spec, path.map(|path| devices.modbus(&path).unwrap())).unwrap().unwrap()
}

#[test]
fn all_errors_are_listed() {
    let spec: ValveSpec = toml::from_str(
        "range_mpa = [0.0, 0.9]\nsafe_mpa = 2.0\nwrite_hz = 0.0\nforce_max_n = -1.0\n\
         [modbus]\nvalue = { from = { register = 3, encoding = \"u16\" }, scale = 1e-6 }\n\
         [lines]\ntcp = \"here\"\nformat = \"P\"\n[iio]\ndevice = \"\"\nscale = 0.0\nraw_max = 4095",
    )
    .unwrap();
    let mut problems = Vec::new();
    spec.problems(&mut Problems::new(&mut problems, "actuator[0] `f`.valve"));
    let all = problems.join("\n");
    for expected in [
        "valve.safe_mpa: expected a value of range_mpa, found 2",
        "valve.write_hz: expected 1 to 2000, found 0",
        "valve.force_max_n: expected more than 0, found -1",
        "valve: expected exactly one of modbus, lines and iio",
        "valve.modbus.tcp, serial: expected exactly one of them",
        "valve.modbus.value: 0.9 MPa of range_mpa does not fit",
        "valve.lines.tcp: expected `host:port`",
        "valve.lines.format: expected a line with {value} and its ending",
        "valve.iio.device: expected a name",
        "valve.iio.scale",
    ] {
        assert!(all.contains(expected), "`{expected}` is missing in\n{all}");
    }
    assert!(toml::from_str::<ValveSpec>("range_mpa = [0.0, 0.1]\nsave_mpa = 0.0").is_err(), "an unknown key");
}

#[test]
fn a_converter_gets_its_number_or_the_write_fails() {
    let root = tempfile::tempdir().unwrap();
    let folder = root.path().join("iio:device3");
    std::fs::create_dir(&folder).unwrap();
    let text = format!(
        "[iio]\nroot = \"{}\"\ndevice = \"iio:device3\"\nchannel = 1\nscale = 2e-5\noffset = -1e-3\nraw_max = 4095",
        root.path().display()
    );
    let mut device = device(&text, &Devices::default());
    let missing = device.write(0.04).unwrap_err();
    assert!(missing.contains("out_voltage1_raw"), "{missing}");
    let file = folder.join("out_voltage1_raw");
    std::fs::write(&file, "0\n").unwrap();
    device.write(0.04).unwrap();
    assert_eq!(std::fs::read_to_string(&file).unwrap(), "2050\n", "(0.04 + 0.001) / 0.00002");
    device.write(0.0).unwrap();
    assert_eq!(std::fs::read_to_string(&file).unwrap(), "50\n");
}

/// Takes lines and answers each with the next reply; an empty reply is silence. Gives what came, with the connection's number.
fn line_device(replies: &'static [&'static str]) -> (String, Receiver<(usize, String)>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let (sender, lines) = channel();
    std::thread::spawn(move || {
        let mut replies = replies.iter();
        for (number, stream) in listener.incoming().enumerate() {
            let mut stream = stream.unwrap();
            for line in BufReader::new(stream.try_clone().unwrap()).lines().map_while(Result::ok) {
                let _test_is_over = sender.send((number, line));
                write!(stream, "{}", replies.next().unwrap_or(&"")).unwrap();
            }
        }
    });
    (address, lines)
}

#[test]
fn a_line_counts_when_its_reply_is_the_right_one() {
    let (address, lines) = line_device(&["OK 1\r\n", "ERR\r\n", "", "OK 2\r\n"]);
    let text = format!(
        "[lines]\ntcp = \"{address}\"\nformat = \"SP {{value}}\\n\"\nunit = \"kPa\"\ndecimals = 2\nreply = \"OK\"\ntimeout_ms = 2000.0"
    );
    let mut device = device(&text, &Devices::default());
    assert_eq!(device.write(0.045), Ok(()));
    assert_eq!(lines.recv().unwrap(), (0, "SP 45.00".to_owned()));
    let refused = device.write(0.05).unwrap_err();
    assert!(refused.contains("`OK`") && refused.contains("`ERR`"), "{refused}");
    let silent = device.write(0.05).unwrap_err();
    assert!(silent.contains("2000 ms"), "{silent}");
    assert_eq!(device.write(0.05), Ok(()));
    let connections: Vec<usize> = lines.try_iter().map(|(number, _)| number).collect();
    assert_eq!(connections, [0, 1, 2], "after a failure the connection is reopened");
}

/// Unit, register, values of a write.
type RegisterWrite = (u8, u16, Vec<u16>);

/// Takes writes and remembers them; refuses values of unit 9.
#[derive(Clone, Default)]
struct Registers(Arc<Mutex<Vec<RegisterWrite>>>);

impl Service for Registers {
    type Request = SlaveRequest<'static>;
    type Response = Response;
    type Exception = ExceptionCode;
    type Future = Ready<Result<Response, ExceptionCode>>;

    fn call(&self, SlaveRequest { slave, request }: Self::Request) -> Self::Future {
        let mut writes = self.0.lock().unwrap();
        ready(match (slave, request) {
            (9, _) => Err(ExceptionCode::IllegalDataValue),
            (_, Request::WriteSingleRegister(register, word)) => {
                writes.push((slave, register, vec![word]));
                Ok(Response::WriteSingleRegister(register, word))
            }
            (_, Request::WriteMultipleRegisters(register, words)) => {
                writes.push((slave, register, words.to_vec()));
                Ok(Response::WriteMultipleRegisters(register, words.len() as u16))
            }
            _ => Err(ExceptionCode::IllegalFunction),
        })
    }
}

#[test]
fn registers_are_written_with_the_devices_own_time_out() {
    let registers = Registers::default();
    let served = registers.clone();
    let (sender, address) = channel();
    std::thread::spawn(move || {
        tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap().block_on(async {
            let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
            sender.send(listener.local_addr().unwrap()).unwrap();
            let accept = |stream, _| ready(Ok(Some((served.clone(), stream))));
            tokio_modbus::server::tcp::Server::new(listener).serve(&accept, |_| ()).await.unwrap();
        });
    });
    let address = address.recv().unwrap();
    let devices = Devices::default();
    let modbus = |unit_id: u8| {
        format!(
            "[modbus]\ntcp = \"{address}\"\ntimeout_ms = 5000.0\nwatchdog = {{ register = 7, raw = 80 }}\n\
             value = {{ from = {{ unit_id = {unit_id}, register = 2, encoding = \"u16\" }}, scale = 0.1, unit = \"mbar\" }}"
        )
    };
    let (mut valve, mut refusing) = (device(&modbus(4), &devices), device(&modbus(9), &devices));
    devices.start(None).unwrap();
    assert_eq!(valve.write(0.05), Ok(()));
    assert_eq!(valve.write(0.06), Ok(()));
    let written = registers.0.lock().unwrap().clone();
    assert_eq!(written, [(4, 7, vec![80]), (4, 2, vec![5000]), (4, 2, vec![6000])]);
    let refused = refusing.write(0.05).unwrap_err();
    assert!(refused.contains("exception 3"), "{refused}");
}
