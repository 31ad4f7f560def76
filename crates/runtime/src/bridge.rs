//! The bridge: takes readings from sources, stamps them, sends them. One thread, any number of actuators.

use crate::source::live::{self, LiveReading, LiveSource, SensorCounters};
use crate::source::{Reading, Source};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::time::Duration;
use wire::{Bus, SensorSample, SensorWriter, Topic, WireError, boot_id, now_ns};

/// One actuator's way from source to topic.
#[derive(Debug)]
struct Line {
    writer: SensorWriter,
    origin: Origin,
    next: Option<Reading>,
    seq: u64,
}

/// Where a line's readings come from.
#[derive(Debug)]
enum Origin {
    /// Readings are asked for and are due at a known time.
    Scheduled(Source),
    /// Readings come when the sensor has them.
    Live(LiveSource),
}

/// What the bridge has done so far; readable from other threads while it runs.
#[derive(Debug, Default)]
pub struct BridgeCounters {
    /// Readings sent.
    pub sent: AtomicU64,
    /// Readings that could not be sent (reported by the loop's owner, not in the loop).
    pub failed: AtomicU64,
    /// Readings sent later than one millisecond after they were due.
    pub late: AtomicU64,
    /// Turns of the loop, so that a watchdog can see that it lives.
    pub turns: AtomicU64,
}

/// A reading sent so much after its due time is counted as late.
const LATE_NS: u64 = 1_000_000;
/// Longest sleep: the shutdown flag is looked at that often.
const MAX_SLEEP: Duration = Duration::from_millis(100);

/// The bridge with all its sources and topics open.
#[derive(Debug)]
pub struct Bridge {
    lines: Vec<Line>,
    boot_id: u64,
    /// Readings of all sensors; `None` when there is no sensor.
    live: Option<Receiver<LiveReading>>,
}

/// Why a bridge cannot start.
#[derive(Debug, thiserror::Error)]
pub enum BridgeError {
    /// The topics.
    #[error(transparent)]
    Wire(#[from] WireError),
    /// The system refuses a thread for a sensor.
    #[error("no thread for the sensor of `{actuator}`: {cause}")]
    Sensor {
        /// The actuator.
        actuator: String,
        /// The system's word for it.
        cause: std::io::Error,
    },
}

impl Bridge {
    /// Becomes the sensor of every named actuator, then starts the sensors' threads.
    ///
    /// # Errors
    /// [`WireError::AlreadyPublished`] when another bridge feeds one of them, the other refusals of
    /// [`SensorWriter::create`], [`BridgeError::Sensor`].
    pub fn start(bus: &Bus, sources: Vec<(String, Source)>) -> Result<Self, BridgeError> {
        let writers = sources
            .iter()
            .map(|(actuator, _)| SensorWriter::create(bus, &Topic::sensor(actuator)?))
            .collect::<Result<Vec<_>, WireError>>()?;
        let (sender, receiver) = sync_channel(live::QUEUE);
        let mut lines = Vec::new();
        for (number, (writer, (actuator, mut source))) in writers.into_iter().zip(sources).enumerate() {
            let next = source.next_reading();
            let origin = match source {
                Source::Live(spec) => Origin::Live(
                    LiveSource::start(spec, number, sender.clone())
                        .map_err(|cause| BridgeError::Sensor { actuator, cause })?,
                ),
                source => Origin::Scheduled(source),
            };
            lines.push(Line { writer, origin, next, seq: 0 });
        }
        let has_live = lines.iter().any(|line| matches!(line.origin, Origin::Live(_)));
        Ok(Self { lines, boot_id: boot_id(), live: has_live.then_some(receiver) })
    }

    /// What became of each sensor's answers, with the number of its actuator in the order given to [`Bridge::start`].
    pub fn sensors(&self) -> impl Iterator<Item = (usize, &Arc<SensorCounters>)> {
        self.lines.iter().enumerate().filter_map(|(number, line)| match &line.origin {
            Origin::Live(source) => Some((number, source.counters())),
            Origin::Scheduled(_) => None,
        })
    }

    /// Sends every reading when it is due or when its sensor has it, until all sources are at their end or `stop` is set. A
    /// bridge that was held up sends what is due at once and loses nothing.
    pub fn run(&mut self, stop: &AtomicBool, counters: &BridgeCounters) {
        let begin_ns = now_ns();
        while !stop.load(Ordering::Relaxed) {
            counters.turns.fetch_add(1, Ordering::Relaxed);
            let next = self.lines.iter().filter_map(|line| line.next);
            let next_ns = next.map(|reading| due_ns(begin_ns, &reading)).min();
            if next_ns.is_none() && self.lines.iter().all(Line::is_finished) {
                // A sensor that ended has handed over all it had.
                self.take_live(Duration::ZERO, counters);
                return;
            }
            let now = now_ns();
            let wait = Duration::from_nanos(next_ns.map_or(u64::MAX, |next| next.saturating_sub(now)));
            if !wait.is_zero() {
                // The system may oversleep, never undersleep; long pauses are cut so that the flag is seen.
                self.take_live(wait.min(MAX_SLEEP), counters);
                continue;
            }
            for line in &mut self.lines {
                line.send_due(begin_ns, self.boot_id, counters);
            }
        }
    }

    /// Waits for the sensors' next reading, or simply waits; then sends all that has come.
    fn take_live(&mut self, wait: Duration, counters: &BridgeCounters) {
        let Some(live) = &self.live else {
            std::thread::sleep(wait);
            return;
        };
        let first = match live.recv_timeout(wait) {
            Ok(reading) => Some(reading),
            Err(RecvTimeoutError::Timeout) => None,
            Err(RecvTimeoutError::Disconnected) => {
                // All sensors have ended, at once: the wait is still owed.
                std::thread::sleep(wait);
                None
            }
        };
        let waiting: Vec<LiveReading> = first.into_iter().chain(live.try_iter().take(live::QUEUE)).collect();
        for reading in waiting {
            if let Some(line) = self.lines.get_mut(reading.line) {
                line.send(self.boot_id, counters, sample_of(&reading));
            }
        }
    }
}

/// A sensor's reading as it goes on the wire.
fn sample_of(reading: &LiveReading) -> SensorSample {
    SensorSample {
        t_sensor_ns: reading.t_sensor_ns,
        pressure_mpa: reading.pressure_mpa,
        gap_mm: reading.gap_mm,
        measured_force_n: reading.measured_force_n,
        status: reading.status,
        ..SensorSample::default()
    }
}

impl Line {
    fn send_due(&mut self, begin_ns: u64, boot_id: u64, counters: &BridgeCounters) {
        while let Some(reading) = self.next {
            let t_sensor_ns = now_ns();
            let due = due_ns(begin_ns, &reading);
            if due > t_sensor_ns {
                return;
            }
            let sample = SensorSample {
                t_sensor_ns,
                pressure_mpa: reading.pressure_mpa,
                gap_mm: reading.gap_mm,
                measured_force_n: reading.measured_force_n,
                t_trace_s: reading.t_trace_s,
                status: reading.status,
                ..SensorSample::default()
            };
            self.send(boot_id, counters, sample);
            if t_sensor_ns - due > LATE_NS {
                counters.late.fetch_add(1, Ordering::Relaxed);
            }
            self.next = match &mut self.origin {
                Origin::Scheduled(source) => source.next_reading(),
                Origin::Live(_) => None,
            };
        }
    }

    /// Numbers and sends.
    fn send(&mut self, boot_id: u64, counters: &BridgeCounters, sample: SensorSample) {
        self.seq += 1;
        let sent = self.writer.publish(SensorSample { boot_id, seq: self.seq, ..sample });
        let counter = if sent.is_ok() { &counters.sent } else { &counters.failed };
        counter.fetch_add(1, Ordering::Relaxed);
    }

    /// Whether nothing more will come.
    fn is_finished(&self) -> bool {
        match &self.origin {
            Origin::Scheduled(_) => self.next.is_none(),
            Origin::Live(source) => source.is_finished(),
        }
    }
}

/// When a reading is due on the wire's clock. A source that asks for the end of time gets it.
fn due_ns(begin_ns: u64, reading: &Reading) -> u64 {
    begin_ns.saturating_add((reading.due_s * 1e9) as u64)
}
