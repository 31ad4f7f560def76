//! The bridge: takes readings from sources, stamps them, sends them. One thread, any number of actuators.

use crate::source::{Reading, Source};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;
use wire::{Bus, SensorSample, SensorWriter, Topic, WireError, boot_id, now_ns};

/// One actuator's way from source to topic.
#[derive(Debug)]
struct Line {
    writer: SensorWriter,
    source: Source,
    next: Option<Reading>,
    seq: u64,
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
}

impl Bridge {
    /// Becomes the sensor of every named actuator.
    ///
    /// # Errors
    /// [`WireError::AlreadyPublished`] when another bridge feeds one of them, and the other refusals of
    /// [`SensorWriter::create`].
    pub fn start(bus: &Bus, sources: Vec<(String, Source)>) -> Result<Self, WireError> {
        let lines = sources
            .into_iter()
            .map(|(actuator, mut source)| {
                let writer = SensorWriter::create(bus, &Topic::sensor(&actuator)?)?;
                let next = source.next_reading();
                Ok(Line { writer, source, next, seq: 0 })
            })
            .collect::<Result<_, WireError>>()?;
        Ok(Self { lines, boot_id: boot_id() })
    }

    /// Sends every reading when it is due, until all sources are at their end or `stop` is set. A bridge that was held up
    /// sends what is due at once and loses nothing.
    pub fn run(&mut self, stop: &AtomicBool, counters: &BridgeCounters) {
        let begin_ns = now_ns();
        while !stop.load(Ordering::Relaxed) {
            let next = self
                .lines
                .iter()
                .filter_map(|line| line.next)
                .map(|reading| due_ns(begin_ns, &reading))
                .min();
            let Some(next_ns) = next else { return };
            let now = now_ns();
            if next_ns > now {
                // The system may oversleep, never undersleep; long pauses are cut so that the flag is seen.
                std::thread::sleep(Duration::from_nanos(next_ns - now).min(MAX_SLEEP));
                continue;
            }
            for line in &mut self.lines {
                line.send_due(begin_ns, self.boot_id, counters);
            }
        }
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
            self.seq += 1;
            let sample = SensorSample {
                boot_id,
                seq: self.seq,
                t_sensor_ns,
                pressure_mpa: reading.pressure_mpa,
                gap_mm: reading.gap_mm,
                measured_force_n: reading.measured_force_n,
                t_trace_s: reading.t_trace_s,
                status: reading.status,
                reserved: 0,
            };
            let counter = if self.writer.publish(sample).is_ok() { &counters.sent } else { &counters.failed };
            counter.fetch_add(1, Ordering::Relaxed);
            if t_sensor_ns - due > LATE_NS {
                counters.late.fetch_add(1, Ordering::Relaxed);
            }
            self.next = self.source.next_reading();
        }
    }
}

/// When a reading is due on the wire's clock. A source that asks for the end of time gets it.
fn due_ns(begin_ns: u64, reading: &Reading) -> u64 {
    begin_ns.saturating_add((reading.due_s * 1e9) as u64)
}
