//! Tests of `src/source/sensor/device.rs` that need its private parts.

use super::*;

#[test]
fn pauses_double_up_to_the_limit_and_start_anew() {
    let mut backoff = Backoff::new(Duration::from_millis(100));
    let pauses: Vec<u128> = (0..5).map(|_| backoff.take().as_millis()).collect();
    assert_eq!(pauses, [20, 40, 80, 100, 100]);
    backoff.reset();
    assert_eq!(backoff.take().as_millis(), 20);
}

#[derive(Debug)]
struct Panics;

impl Device for Panics {
    fn place(&self) -> String {
        "nowhere".into()
    }
    fn run(&self, mut feed: Feed, _: &Runtime) {
        feed.send(Reading { pressure_mpa: 0.5, ..Reading::now() });
        panic!("the device driver failed");
    }
}

#[test]
fn a_device_thread_that_panics_hands_over_its_readings_and_is_reported() {
    let mut sensor = Sensor::open(Panics, Vec::new()).unwrap();
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
    assert_eq!(sensor.poll(0.0), Poll::End);
}
