//! Tests of `src/source/devices.rs` that need its private parts.

use super::*;
use crate::source::mixed::{Input, Mixed, Pace};
use crate::source::reading::{InputNames, Poll, Source};
use crate::source::serial::SerialSpec;
use std::sync::mpsc::sync_channel;
use std::time::Duration;

#[test]
fn thread_that_panics_hands_over_its_readings_and_is_reported() {
    let ended = Ended::default();
    let channels = vec![Channel::plain(0, 1.0)];
    let (mut feed, inbox) = connect("nowhere".into(), channels, Arc::default(), ended.clone());
    let input = Input { name: "gauge".into(), inbox, age_limit_ns: u64::MAX, ahead: None };
    let mut sensor = Mixed::new(vec![input], Pace::Sensor(0), &InputNames::default(), Devices::default());
    let run = move || {
        feed.send(wire::now_ns(), [(0, 0.5)]);
        panic!("the device driver failed");
    };
    let (waker, wakes) = sync_channel(1);
    sensor.start(&waker).unwrap();
    let wakes_bridge = Arc::new(OnceLock::from(waker));
    spawn(ended, wakes_bridge, run).unwrap();
    let mut pressures = Vec::new();
    loop {
        match sensor.poll(0.0) {
            Poll::Reading(reading) => pressures.push(reading.sample.pressure_mpa),
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
    assert!(problem.contains("/dev/ttyX"), "{problem}");
    let lines = devices
        .read_lines(&LinesPath::Serial(serial(9600)), Vec::new(), "gauge", |_| unreachable!("refused"));
    assert!(lines.unwrap_err().contains("/dev/ttyX"));
    assert!(devices.modbus(&ModbusPath::Tcp("host:502".into())).is_ok(), "another path is another thread");
}
