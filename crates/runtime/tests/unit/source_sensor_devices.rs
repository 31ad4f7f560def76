//! Tests of `src/source/sensor/devices.rs` that need its private parts.

use super::*;
use crate::source::reading::Poll;
use crate::source::sensor::mixed::Mixed;
use crate::source::sensor::serial::SerialSpec;
use std::sync::mpsc::sync_channel;
use std::time::Duration;

#[derive(Debug)]
struct Panics;

impl Device for Panics {
    fn run(self: Box<Self>, mut feed: Feed, _: &Runtime) {
        feed.send(wire::now_ns(), [(0, 0.5)]);
        panic!("the device driver failed");
    }
}

#[test]
fn a_device_thread_that_panics_hands_over_its_readings_and_is_reported() {
    let devices = Devices::default();
    let inbox = devices.own("nowhere", vec![Channel::plain(0, 1.0)], "", Panics);
    let mut sensor = Mixed::single(inbox, &devices);
    let (waker, wakes) = sync_channel(1);
    sensor.start(&waker).unwrap();
    let mut pressures = Vec::new();
    loop {
        match sensor.poll(0.0) {
            Poll::Reading(reading) => pressures.push(reading.pressure_mpa),
            Poll::Waiting { .. } => drop(wakes.recv_timeout(Duration::from_millis(10))),
            end => {
                assert_eq!(end, Poll::Failed("the device driver failed".into()));
                break;
            }
        }
    }
    assert_eq!(pressures, [0.5]);
    assert_eq!(sensor.poll(0.0), Poll::Failed("the device driver failed".into()), "it stays failed");
}

/// A port is one thing: two speeds on it, or two protocols, cannot both be meant.
#[test]
fn a_path_has_one_kind_and_one_setting() {
    let serial = |baud| SerialSpec {
        port: "/dev/ttyX".into(),
        baud,
        data_bits: 8,
        parity: Default::default(),
        stop_bits: 1,
    };
    let devices = Devices::default();
    let first = devices.modbus(&ModbusPath::Serial(serial(9600)));
    assert!(first.is_ok() && devices.modbus(&ModbusPath::Serial(serial(9600))).is_ok());
    let problem = devices.modbus(&ModbusPath::Serial(serial(19_200))).unwrap_err();
    assert!(problem.contains("expected the same settings") && problem.contains("/dev/ttyX"), "{problem}");
    let lines = devices
        .read_lines(&LinesPath::Serial(serial(9600)), Vec::new(), "gauge", |_| unreachable!("refused"));
    assert!(lines.unwrap_err().contains("/dev/ttyX"));
    assert!(devices.modbus(&ModbusPath::Tcp("host:502".into())).is_ok(), "another path is another thread");
}
