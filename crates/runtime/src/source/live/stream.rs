//! Lines of text from a serial line or standard input.

use super::decode::Quantity;
use super::filter::{Filter, FilterSpec};
use super::lines::{LineBuffer, LineError, LineReading};
use super::serial::SerialSpec;
use super::{Backoff, Feed, LOOK, LiveReading, blank};
use serde::{Deserialize, Serialize};
use std::io::Read;
use std::time::Duration;
use tokio::io::AsyncReadExt;

/// A line sensor as written in a scene file.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LinesSpec {
    /// The serial line; without it, standard input is read.
    pub serial: Option<SerialSpec>,
    /// Unit of the pressure; default MPa.
    pub pressure_unit: Option<String>,
    /// Unit of the gap; default mm.
    pub gap_unit: Option<String>,
    /// Unit of the force; default N.
    pub force_unit: Option<String>,
    /// Smoothing of the pressure.
    pub filter: FilterSpec,
}

/// Longest pause between attempts to open the line again.
const BACKOFF_MAX: Duration = Duration::from_secs(5);

impl LinesSpec {
    /// Everything that is wrong with it.
    pub fn problems(&self) -> Vec<String> {
        let mut problems = Vec::new();
        if let Some(serial) = &self.serial {
            serial.problems("source.serial", &mut problems);
        }
        Quantity::Pressure.check_unit("source.pressure_unit", self.pressure_unit.as_deref(), &mut problems);
        Quantity::Gap.check_unit("source.gap_unit", self.gap_unit.as_deref(), &mut problems);
        Quantity::Force.check_unit("source.force_unit", self.force_unit.as_deref(), &mut problems);
        self.filter.problems("source.filter", &mut problems);
        problems
    }
}

/// Reads until told to stop, or to the end of standard input.
pub(super) fn run(spec: &LinesSpec, feed: Feed, runtime: &tokio::runtime::Runtime) {
    let mut reader = LineReader::new(spec, feed);
    match &spec.serial {
        Some(serial) => runtime.block_on(read_serial(serial, &mut reader)),
        None => read_stdin(&mut reader),
    }
}

struct LineReader {
    feed: Feed,
    buffer: LineBuffer,
    filter: Filter,
    factors: [f64; 3],
}

impl LineReader {
    fn new(spec: &LinesSpec, feed: Feed) -> Self {
        let factor =
            |quantity: Quantity, unit: &Option<String>| quantity.factor(unit.as_deref()).unwrap_or(f64::NAN);
        Self {
            feed,
            buffer: LineBuffer::default(),
            filter: Filter::new(spec.filter),
            factors: [
                factor(Quantity::Pressure, &spec.pressure_unit),
                factor(Quantity::Gap, &spec.gap_unit),
                factor(Quantity::Force, &spec.force_unit),
            ],
        }
    }

    fn push(&mut self, bytes: &[u8]) {
        let Self { feed, buffer, filter, factors } = self;
        buffer.push(bytes, |line| match line {
            Ok(Some(line)) => send(feed, filter, factors, line),
            Ok(None) => {}
            Err(error) => garbage(feed, &error),
        });
    }
}

fn send(feed: &mut Feed, filter: &mut Filter, factors: &[f64; 3], line: LineReading) {
    let [pressure, gap, force] = factors;
    let reading = blank();
    let pressure_mpa = filter.apply(reading.t_sensor_ns, line.pressure * pressure);
    feed.send(LiveReading {
        pressure_mpa,
        gap_mm: line.gap * gap,
        measured_force_n: line.force * force,
        ..reading
    });
    feed.well();
}

fn garbage(feed: &mut Feed, error: &LineError) {
    feed.trouble(|c| &c.garbage, error.to_string());
}

async fn read_serial(serial: &SerialSpec, reader: &mut LineReader) {
    let mut backoff = Backoff::new(BACKOFF_MAX);
    while !reader.feed.is_stopped() {
        match serial.open() {
            Ok(mut port) => {
                let mut bytes = [0; 1024];
                while !reader.feed.is_stopped() {
                    match tokio::time::timeout(LOOK, AsyncReadExt::read(&mut port, &mut bytes)).await {
                        Err(_) => {} // silence: look at the stop flag, go on listening
                        Ok(Ok(count)) if count > 0 => {
                            reader.push(bytes.get(..count).unwrap_or_default());
                            backoff.reset();
                        }
                        Ok(end) => {
                            let cause = end.err().map_or("end of file".into(), |error| error.to_string());
                            reader
                                .feed
                                .trouble(|c| &c.disconnects, format!("{}: {cause}", serial.port.display()));
                            break;
                        }
                    }
                }
            }
            Err(error) => {
                reader
                    .feed
                    .trouble(|c| &c.refusals, format!("cannot open {}: {error}", serial.port.display()));
            }
        }
        backoff.wait(&reader.feed).await;
    }
}

fn read_stdin(reader: &mut LineReader) {
    let mut bytes = [0; 1024];
    let mut input = std::io::stdin().lock();
    while !reader.feed.is_stopped() {
        match input.read(&mut bytes) {
            Ok(0) => return,
            Ok(count) => reader.push(bytes.get(..count).unwrap_or_default()),
            Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
            Err(error) => return reader.feed.trouble(|c| &c.disconnects, format!("standard input: {error}")),
        }
    }
}
