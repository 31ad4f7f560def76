//! The one type of a reading, and the one trait of whatever gives readings.

use std::fmt::Debug;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::{Duration, Instant};
use wire::layout::{AGES_MAX, MARKERS_MAX, PARAMETERS_MAX};
use wire::{SensorSample, now_ns};

/// One reading of an actuator's sensors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    /// When it was taken, see [`wire::now_ns`].
    pub t_sensor_ns: u64,
    /// Seconds after the start of the source at which it is due; NaN for a device, which sends when it has something.
    pub due_s: f64,
    /// Time in the source's own trace, s; NaN when it has none.
    pub t_trace_s: f64,
    /// Gauge pressure, MPa. Any value that a gauge can send, NaN too: the twin validates it.
    pub pressure_mpa: f64,
    /// Gap, mm; NaN when the source does not measure it.
    pub gap_mm: f64,
    /// Measured contact force, N; NaN when there is no load cell.
    pub measured_force_n: f64,
    /// Measured x, y, z of each marker in the camera's frame, mm; NaN where there is none.
    pub markers_mm: [f64; 3 * MARKERS_MAX],
    /// Coordinates that the source has; 0 without markers.
    pub marker_values: u32,
    /// 0: good; anything else is a fault code, see [`SensorSample::status`].
    pub status: u32,
    /// Entries of `ages_ns` that count: 0, all values are as old as the reading.
    pub age_count: u32,
    /// Age of pressure, gap, force and each marker at `t_sensor_ns`, ns.
    pub ages_ns: [u64; AGES_MAX],
    /// Values that are absent because they are too old, see [`wire::layout::value_bits`].
    pub stale_values: u32,
    /// Values that are absent because of a fault of their sensor.
    pub fault_values: u32,
    /// Values left out because of their age since the source's start.
    pub stale_total: u64,
    /// Named inputs that the source has; 0 without any.
    pub input_count: u32,
    /// Measured values of further model inputs, in the unit at the end of their names; NaN where there is none.
    pub inputs: [f64; PARAMETERS_MAX],
    /// Their names, 32 bytes each, see [`SensorSample::input_names`].
    pub input_names: [u8; 32 * PARAMETERS_MAX],
    /// Their ages at `t_sensor_ns`, ns.
    pub input_ages_ns: [u64; PARAMETERS_MAX],
}

impl Reading {
    /// A reading with the time of now and nothing else.
    pub fn now() -> Self {
        Self { t_sensor_ns: now_ns(), ..Self::default() }
    }

    /// The reading as it goes on the wire.
    pub fn sample(&self, boot_id: u64, seq: u64) -> SensorSample {
        SensorSample {
            boot_id,
            seq,
            t_sensor_ns: self.t_sensor_ns,
            pressure_mpa: self.pressure_mpa,
            gap_mm: self.gap_mm,
            measured_force_n: self.measured_force_n,
            t_trace_s: self.t_trace_s,
            status: self.status,
            markers_mm: self.markers_mm,
            marker_values: self.marker_values,
            age_count: self.age_count,
            ages_ns: self.ages_ns,
            stale_values: self.stale_values,
            fault_values: self.fault_values,
            stale_total: self.stale_total,
            input_count: self.input_count,
            inputs: self.inputs,
            input_names: self.input_names,
            input_ages_ns: self.input_ages_ns,
            ..SensorSample::default()
        }
    }
}

/// A reading with nothing known.
impl Default for Reading {
    fn default() -> Self {
        Self {
            t_sensor_ns: 0,
            due_s: f64::NAN,
            t_trace_s: f64::NAN,
            pressure_mpa: f64::NAN,
            gap_mm: f64::NAN,
            measured_force_n: f64::NAN,
            markers_mm: [f64::NAN; 3 * MARKERS_MAX],
            marker_values: 0,
            status: 0,
            age_count: 0,
            ages_ns: [0; AGES_MAX],
            stale_values: 0,
            fault_values: 0,
            stale_total: 0,
            input_count: 0,
            inputs: [f64::NAN; PARAMETERS_MAX],
            input_names: [0; 32 * PARAMETERS_MAX],
            input_ages_ns: [0; PARAMETERS_MAX],
        }
    }
}

/// What a source has for the bridge.
#[derive(Debug, Clone, PartialEq)]
#[allow(clippy::large_enum_variant)] // copied once a reading; a box would allocate in the bridge's loop
pub enum Poll {
    /// A reading.
    Reading(Reading),
    /// Nothing before this time after the start, s; infinite for a device, which wakes the bridge when it has something.
    Waiting {
        /// Seconds after the start.
        until_s: f64,
    },
    /// Nothing more will come.
    End,
    /// The source failed and cannot go on; with the cause.
    Failed(String),
}

/// The sending side of the bridge's wake-up: capacity 1, a full one means that the bridge is woken already.
pub type BridgeWaker = SyncSender<()>;

/// A source of readings.
///
/// The contract of every source, which a conformance test checks: [`Self::poll`] does not block; readings come in order of
/// `due_s`, beginning at or after 0; after [`Poll::End`] it stays at the end. A source without a device gives the same
/// readings, bit for bit, for the same specification (but for the time stamp).
pub trait Source: Debug + Send {
    /// Starts what the source needs beside the bridge; called once, before the first poll.
    ///
    /// # Errors
    /// The system's refusal to start a thread.
    fn start(&mut self, waker: &BridgeWaker) -> std::io::Result<()> {
        let _none_needed = waker;
        Ok(())
    }

    /// The next reading that is due `elapsed_s` after the start; infinity takes readings ahead of their time.
    fn poll(&mut self, elapsed_s: f64) -> Poll;

    /// The devices behind the source: name of the sensor, empty where the scene names none, and its counters.
    fn devices(&self) -> Vec<(String, Arc<SensorCounters>)> {
        Vec::new()
    }
}

/// A source whose readings are known ahead: sends each when it is due.
#[derive(Debug)]
pub(super) struct Scheduled<I> {
    readings: I,
    next: Option<Reading>,
}

impl<I: Iterator<Item = Reading>> Scheduled<I> {
    pub(super) fn new(mut readings: I) -> Self {
        let next = readings.next();
        Self { readings, next }
    }
}

impl<I: Iterator<Item = Reading> + Debug + Send> Source for Scheduled<I> {
    fn poll(&mut self, elapsed_s: f64) -> Poll {
        let Some(next) = self.next else { return Poll::End };
        if next.due_s > elapsed_s {
            return Poll::Waiting { until_s: next.due_s };
        }
        self.next = self.readings.next();
        Poll::Reading(Reading { t_sensor_ns: now_ns(), ..next })
    }
}

/// Longest wait of a reader without a look at its source.
const LOOK: Duration = Duration::from_millis(10);

/// Reads a source without a bridge, every reading ahead of its time.
#[derive(Debug)]
pub struct SourceReader {
    source: Box<dyn Source>,
    wakes: Receiver<()>,
}

impl SourceReader {
    /// Starts the source.
    ///
    /// # Errors
    /// The system's refusal to start a thread.
    pub fn start(mut source: Box<dyn Source>) -> std::io::Result<Self> {
        let (waker, wakes) = sync_channel(1);
        source.start(&waker)?;
        Ok(Self { source, wakes })
    }

    /// The next reading; `None` at the end, or when a device sends none within `patience`.
    pub fn next(&mut self, patience: Duration) -> Option<Reading> {
        let end = Instant::now() + patience;
        loop {
            match self.source.poll(f64::INFINITY) {
                Poll::Reading(reading) => return Some(reading),
                Poll::Waiting { .. } => {
                    let left = end.saturating_duration_since(Instant::now());
                    // The device's end wakes without a reading; the channel closes with the device. A reading that is due by
                    // a clock wakes nobody.
                    if self.wakes.recv_timeout(left.min(LOOK)).is_err() && Instant::now() >= end {
                        return None;
                    }
                }
                Poll::End | Poll::Failed(_) => return None,
            }
        }
    }

    /// The devices behind the source, see [`Source::devices`].
    pub fn devices(&self) -> Vec<(String, Arc<SensorCounters>)> {
        self.source.devices()
    }
}

/// What became of a device's answers.
#[derive(Debug, Default)]
pub struct SensorCounters {
    /// Readings handed to the bridge.
    pub readings: AtomicU64,
    /// Requests without an answer in time.
    pub timeouts: AtomicU64,
    /// Answers with a fault code instead of values (Modbus exceptions).
    pub exceptions: AtomicU64,
    /// Answers that could not be understood.
    pub garbage: AtomicU64,
    /// Connections that broke.
    pub disconnects: AtomicU64,
    /// Connections that could not be made.
    pub refusals: AtomicU64,
    /// Readings discarded because the bridge did not take them.
    pub overflows: AtomicU64,
    /// Readings sent without a value of this sensor because it was too old.
    pub stale: AtomicU64,
}

impl SensorCounters {
    /// Names and values, in a fixed order.
    pub fn all(&self) -> [(&'static str, u64); 8] {
        [
            ("readings", &self.readings),
            ("timeouts", &self.timeouts),
            ("exceptions", &self.exceptions),
            ("garbage", &self.garbage),
            ("disconnects", &self.disconnects),
            ("refusals", &self.refusals),
            ("overflows", &self.overflows),
            ("stale", &self.stale),
        ]
        .map(|(name, counter)| (name, counter.load(Ordering::Relaxed)))
    }

    /// Names and values for people, without the zeros.
    pub fn summary(&self) -> String {
        let counted = self.all().into_iter().filter(|(name, count)| *count > 0 || *name == "readings");
        counted.map(|(name, count)| format!("{count} {name}")).collect::<Vec<_>>().join(", ")
    }
}
