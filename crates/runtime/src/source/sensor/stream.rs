//! Lines of text from a serial line or standard input.

use super::device::{Backoff, Device, Feed, STOP_CHECK, Sensor};
use super::filter::{Filter, FilterSpec};
use super::lines::LineBuffer;
use super::register::Quantity;
use super::serial::SerialSpec;
use crate::source::reading::{Reading, Source};
use serde::{Deserialize, Serialize};
use std::io::Read;
use std::time::Duration;
use tokio::io::AsyncReadExt;
use tokio::runtime::Runtime;

/// A line sensor as written in a scene file.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LinesSpec {
    /// The serial line; without it, standard input is read.
    pub serial: Option<SerialSpec>,
    /// A comma between digits separates two numbers, although it may look like a decimal comma.
    pub comma_separates: bool,
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
const MAX_BACKOFF: Duration = Duration::from_secs(5);

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

    /// A source that is not started.
    ///
    /// # Errors
    /// [`Self::problems`].
    pub(crate) fn open(&self) -> Result<Box<dyn Source>, Vec<String>> {
        Sensor::open(self.clone(), self.problems())
    }
}

impl Device for LinesSpec {
    fn place(&self) -> String {
        self.serial.as_ref().map_or("standard input".into(), |serial| serial.port.display().to_string())
    }

    /// Reads until the stop flag is set, or to the end of standard input.
    fn run(&self, feed: Feed, runtime: &Runtime) {
        let mut reader = LineReader::new(self, feed);
        match &self.serial {
            Some(serial) => runtime.block_on(read_serial(serial, &mut reader)),
            None => read_stdin(&mut reader),
        }
    }
}

struct LineReader {
    feed: Feed,
    buffer: LineBuffer,
    filter: Filter,
    /// Of pressure, gap and force.
    factors: [f64; 3],
}

impl LineReader {
    fn new(spec: &LinesSpec, feed: Feed) -> Self {
        let factor =
            |quantity: Quantity, unit: &Option<String>| quantity.factor(unit.as_deref()).unwrap_or(f64::NAN);
        Self {
            feed,
            buffer: LineBuffer::new(spec.comma_separates),
            filter: Filter::new(spec.filter),
            factors: [
                factor(Quantity::Pressure, &spec.pressure_unit),
                factor(Quantity::Gap, &spec.gap_unit),
                factor(Quantity::Force, &spec.force_unit),
            ],
        }
    }

    fn push(&mut self, bytes: &[u8]) {
        let Self { feed, buffer, filter, factors: [to_mpa, to_mm, to_n] } = self;
        buffer.push(bytes, |line| match line {
            Ok(Some([pressure, gap, force])) => {
                let reading = Reading::now();
                feed.send(Reading {
                    pressure_mpa: filter.apply(reading.t_sensor_ns, pressure * *to_mpa),
                    gap_mm: gap * *to_mm,
                    measured_force_n: force * *to_n,
                    ..reading
                });
                feed.recovered();
            }
            Ok(None) => {}
            Err(error) => feed.failed(|c| &c.garbage, &error.to_string()),
        });
    }
}

async fn read_serial(serial: &SerialSpec, reader: &mut LineReader) {
    let mut backoff = Backoff::new(MAX_BACKOFF);
    while !reader.feed.is_stopped() {
        match serial.open() {
            Ok(mut port) => {
                let mut bytes = [0; 1024];
                while !reader.feed.is_stopped() {
                    match tokio::time::timeout(STOP_CHECK, AsyncReadExt::read(&mut port, &mut bytes)).await {
                        Err(_) => {} // nothing sent: check the stop flag, go on reading
                        Ok(Ok(count)) if count > 0 => {
                            reader.push(bytes.get(..count).unwrap_or_default());
                            backoff.reset();
                        }
                        Ok(end) => {
                            let cause = end.err().map_or("end of file".into(), |error| error.to_string());
                            reader.feed.failed(|c| &c.disconnects, &cause);
                            break;
                        }
                    }
                }
            }
            Err(error) => reader.feed.failed(|c| &c.refusals, &format!("cannot open it: {error}")),
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
            Err(error) => return reader.feed.failed(|c| &c.disconnects, &error.to_string()),
        }
    }
}
