//! The bridge: takes readings from sources, numbers them, sends them. One thread, any number of actuators.

use crate::source::{BridgeWaker, Poll, SensorCounters, Source};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel, sync_channel};
use std::time::Duration;
use wire::{Bus, SensorSample, SensorWriter, Topic, WireError, boot_id, now_ns};

/// The devices behind a bridge's sources: actuator, name of the sensor (empty where the scene names none), counters.
pub type BridgeDevices = Vec<(String, String, Arc<SensorCounters>)>;

/// The source and the topic of one actuator.
#[derive(Debug)]
struct Line {
    actuator: String,
    source: Box<dyn Source>,
    writer: SensorWriter,
    seq: u64,
    has_ended: bool,
    /// When its source began, s after the bridge.
    begin_s: f64,
}

/// Sources by the name of their actuator.
pub type Sources = Vec<(String, Box<dyn Source>)>;

/// Counters of the bridge; readable from other threads.
#[derive(Debug, Default)]
pub struct BridgeCounters {
    pub sent: AtomicU64,
    /// Readings that could not be sent (reported by the loop's owner, not in the loop).
    pub failed: AtomicU64,
    /// Readings sent later than one millisecond after they were due.
    pub late: AtomicU64,
    /// Iterations of the loop, for the watchdog.
    pub turns: AtomicU64,
}

/// Delay from which a reading counts as late, s.
const LATE_S: f64 = 1e-3;
/// Longest sleep, s: the stop flag is checked that often.
const MAX_SLEEP_S: f64 = 0.1;
/// Largest number of readings of one source per iteration, so that a source that is always due delays neither the stop flag nor
/// other sources.
const MAX_BATCH: usize = 64;

/// The bridge with all its sources started and topics open.
#[derive(Debug)]
pub struct Bridge {
    lines: Vec<Line>,
    boot_id: u64,
    wakes: Receiver<()>,
    /// Kept, so that the channel stays open without a device.
    waker: BridgeWaker,
    /// Sources that take the place of others.
    replacements: Option<Receiver<Sources>>,
}

/// Why a bridge cannot start, or cannot go on.
#[derive(Debug, thiserror::Error)]
pub enum BridgeError {
    #[error(transparent)]
    Wire(#[from] WireError),
    /// The system refuses a thread for a sensor.
    #[error("no thread for the sensor of `{actuator}`: {cause}")]
    Sensor { actuator: String, cause: std::io::Error },
    /// A source failed while the bridge ran.
    #[error("the source of `{actuator}` failed: {cause}; start the bridge again and report this")]
    Source { actuator: String, cause: String },
}

impl Bridge {
    /// Becomes the sensor of every named actuator, then starts the sources.
    ///
    /// # Errors
    /// [`WireError::AlreadyPublished`] when another bridge feeds one of them, the other refusals of
    /// [`SensorWriter::create`], [`BridgeError::Sensor`].
    pub fn start(bus: &Bus, sources: Sources) -> Result<Self, BridgeError> {
        let mut lines = Vec::new();
        for (actuator, source) in sources {
            let writer = SensorWriter::create(bus, &Topic::sensor(&actuator)?)?;
            lines.push(Line { actuator, source, writer, seq: 0, has_ended: false, begin_s: 0.0 });
        }
        let (waker, wakes) = sync_channel(1);
        for Line { actuator, source, .. } in &mut lines {
            let refused = |cause| BridgeError::Sensor { actuator: actuator.clone(), cause };
            source.start(&waker).map_err(refused)?;
        }
        Ok(Self { lines, boot_id: boot_id(), wakes, waker, replacements: None })
    }

    /// Run id in all its readings.
    pub fn boot_id(&self) -> u64 {
        self.boot_id
    }

    /// The devices behind the sources.
    pub fn devices(&self) -> BridgeDevices {
        let of_line = |line: &Line| {
            let actuator = line.actuator.clone();
            let devices = line.source.devices().into_iter();
            devices.map(move |(sensor, counters)| (actuator.clone(), sensor, counters))
        };
        self.lines.iter().flat_map(of_line).collect()
    }

    /// Returns a sender of new sources. They replace those of the same actuators between two readings; topics and numbers of readings
    /// continue. Unknown actuators are ignored.
    pub fn accept_sources(&mut self) -> Sender<Sources> {
        let (sender, replacements) = channel();
        self.replacements = Some(replacements);
        sender
    }

    fn replace(&mut self, sources: Sources, now_s: f64) -> Result<(), BridgeError> {
        for (actuator, source) in sources {
            let Some(line) = self.lines.iter_mut().find(|line| line.actuator == actuator) else { continue };
            // The old one ends first: it may have the device that the new one opens.
            line.source = source;
            (line.begin_s, line.has_ended) = (now_s, false);
            line.source.start(&self.waker).map_err(|cause| BridgeError::Sensor { actuator, cause })?;
        }
        Ok(())
    }

    /// Sends every reading when it is due or when its device has it, until all sources are at their end or `stop` is set. A
    /// bridge that was held up sends what is due without a pause and loses nothing.
    ///
    /// # Errors
    /// [`BridgeError::Source`] when a source fails.
    pub fn run(&mut self, stop: &AtomicBool, counters: &BridgeCounters) -> Result<(), BridgeError> {
        let begin_ns = now_ns();
        let elapsed_s = || now_ns().saturating_sub(begin_ns) as f64 * 1e-9;
        while !stop.load(Ordering::Relaxed) {
            counters.turns.fetch_add(1, Ordering::Relaxed);
            let replacements = self.replacements.as_ref().and_then(|new| new.try_recv().ok());
            if let Some(sources) = replacements {
                self.replace(sources, elapsed_s())?;
            }
            let mut until_s = f64::INFINITY;
            for line in self.lines.iter_mut().filter(|line| !line.has_ended) {
                until_s = until_s.min(line.send_due(elapsed_s, self.boot_id, counters)?);
            }
            if self.lines.iter().all(|line| line.has_ended) {
                return Ok(());
            }
            // The system may oversleep, never undersleep. A time that is not a number is due.
            let wait_s = (until_s - elapsed_s()).clamp(0.0, MAX_SLEEP_S);
            if wait_s > 0.0 {
                let _woken_or_timed_out = self.wakes.recv_timeout(Duration::from_secs_f64(wait_s));
            }
        }
        Ok(())
    }
}

impl Line {
    /// Sends what is due, at most [`MAX_BATCH`] readings; returns when the next is due, s after the start.
    fn send_due(
        &mut self,
        elapsed_s: impl Fn() -> f64,
        boot_id: u64,
        counters: &BridgeCounters,
    ) -> Result<f64, BridgeError> {
        for _ in 0..MAX_BATCH {
            let now_s = elapsed_s() - self.begin_s;
            let reading = match self.source.poll(now_s) {
                Poll::Reading(reading) => reading,
                Poll::Waiting { until_s } => return Ok(until_s + self.begin_s),
                Poll::End => {
                    self.has_ended = true;
                    return Ok(f64::INFINITY);
                }
                Poll::Failed(cause) => {
                    return Err(BridgeError::Source { actuator: self.actuator.clone(), cause });
                }
            };
            self.seq += 1;
            let sent = self.writer.publish(SensorSample { boot_id, seq: self.seq, ..reading.sample });
            let counter = if sent.is_ok() { &counters.sent } else { &counters.failed };
            counter.fetch_add(1, Ordering::Relaxed);
            // A device's reading has no due time (NaN) and is never late.
            counters.late.fetch_add(u64::from(now_s - reading.due_s > LATE_S), Ordering::Relaxed);
        }
        Ok(0.0)
    }
}
