//! Sensors: sources that say something when they have something to say.
//!
//! Each runs in a thread of its own (Tokio for the waiting, one thread, no pool) and hands readings to the bridge through
//! a bounded channel. A sensor that fails sends nothing: the twin notices the silence by its deadline. What went wrong is
//! counted in [`SensorCounters`] and logged when it changes, not each time.

mod decode;
mod filter;
mod lines;
mod modbus;
mod serial;
mod stream;

pub use decode::{Encoding, Quantity, RegisterSpec, Table, WordOrder};
pub use filter::{Filter, FilterSpec};
pub use lines::{LineBuffer, LineError, LineReading, MAX_LINE_BYTES, parse_line};
pub use modbus::ModbusSpec;
pub use serial::{Parity, SerialSpec};
pub use stream::LinesSpec;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{SyncSender, TrySendError};
use std::thread::{Builder, JoinHandle};
use std::time::Duration;
use wire::now_ns;

/// Readings that wait for the bridge, at most; the bridge takes them at once, so more means that it hangs.
pub const QUEUE: usize = 1024;

/// One reading of a sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LiveReading {
    /// Which of the bridge's actuators.
    pub line: usize,
    /// When the reply was in our hands, see [`wire::now_ns`].
    pub t_sensor_ns: u64,
    /// Gauge pressure, MPa; NaN when the sensor reports a fault.
    pub pressure_mpa: f64,
    /// Gap, mm; NaN when it is not measured.
    pub gap_mm: f64,
    /// Contact force, N; NaN when it is not measured.
    pub measured_force_n: f64,
    /// 0, or the sensor's own fault code.
    pub status: u32,
}

/// What became of the sensor's answers.
#[derive(Debug, Default)]
pub struct SensorCounters {
    /// Readings handed to the bridge.
    pub readings: AtomicU64,
    /// Requests without an answer in time.
    pub timeouts: AtomicU64,
    /// Answers that say why there is none (Modbus exceptions).
    pub exceptions: AtomicU64,
    /// Answers that could not be understood.
    pub garbage: AtomicU64,
    /// Connections that broke.
    pub disconnects: AtomicU64,
    /// Connections that could not be made.
    pub refusals: AtomicU64,
    /// Readings thrown away because the bridge did not take them.
    pub overflows: AtomicU64,
}

impl SensorCounters {
    /// Names and values, in a fixed order.
    pub fn all(&self) -> [(&'static str, u64); 7] {
        let value = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        [
            ("readings", value(&self.readings)),
            ("timeouts", value(&self.timeouts)),
            ("exceptions", value(&self.exceptions)),
            ("garbage", value(&self.garbage)),
            ("disconnects", value(&self.disconnects)),
            ("refusals", value(&self.refusals)),
            ("overflows", value(&self.overflows)),
        ]
    }
}

/// A sensor as written in a scene file.
#[derive(Debug, Clone, PartialEq)]
pub enum LiveSpec {
    /// Modbus, over TCP or a serial line.
    Modbus(ModbusSpec),
    /// Lines of text, from a serial line or standard input.
    Lines(LinesSpec),
}

/// A running sensor. Dropping it stops its thread.
#[derive(Debug)]
pub struct LiveSource {
    stop: Arc<AtomicBool>,
    counters: Arc<SensorCounters>,
    thread: Option<JoinHandle<()>>,
}

/// What a sensor's thread works with.
pub(crate) struct Feed {
    line: usize,
    sender: SyncSender<LiveReading>,
    counters: Arc<SensorCounters>,
    stop: Arc<AtomicBool>,
    trouble: Option<String>,
}

impl LiveSource {
    /// Starts the sensor's thread; its readings come out of `sender`'s other end, marked with `line`.
    ///
    /// # Errors
    /// The system's refusal to start a thread.
    pub fn start(spec: LiveSpec, line: usize, sender: SyncSender<LiveReading>) -> std::io::Result<Self> {
        let stop = Arc::new(AtomicBool::new(false));
        let counters = Arc::new(SensorCounters::default());
        let feed = Feed { line, sender, counters: counters.clone(), stop: stop.clone(), trouble: None };
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        let thread = Builder::new().name(format!("sensor-{line}")).spawn(move || match spec {
            LiveSpec::Modbus(spec) => runtime.block_on(modbus::run(&spec, feed)),
            LiveSpec::Lines(spec) => stream::run(&spec, feed, &runtime),
        })?;
        Ok(Self { stop, counters, thread: Some(thread) })
    }

    /// What became of the sensor's answers so far.
    pub fn counters(&self) -> &Arc<SensorCounters> {
        &self.counters
    }

    /// Whether the sensor has nothing more to say (standard input at its end).
    pub fn is_finished(&self) -> bool {
        self.thread.as_ref().is_none_or(JoinHandle::is_finished)
    }
}

impl Drop for LiveSource {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        // A thread that reads standard input hangs there until the next line; the process' end takes it along.
        if let Some(thread) = self.thread.take().filter(JoinHandle::is_finished) {
            let _ = thread.join();
        }
    }
}

impl Feed {
    fn is_stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// Hands a reading over; stamps it now.
    fn send(&mut self, reading: LiveReading) {
        let reading = LiveReading { line: self.line, ..reading };
        match self.sender.try_send(reading) {
            Ok(()) => count(&self.counters.readings),
            Err(TrySendError::Full(_)) => count(&self.counters.overflows),
            // The bridge is gone; so are we at the next look.
            Err(TrySendError::Disconnected(_)) => self.stop.store(true, Ordering::Relaxed),
        }
    }

    /// Notes trouble; logs it when it is not the same as before.
    fn trouble(&mut self, counter: impl Fn(&SensorCounters) -> &AtomicU64, what: String) {
        count(counter(self.counters.as_ref()));
        if self.trouble.as_deref() != Some(what.as_str()) {
            tracing::warn!(sensor = self.line, "{what}");
            self.trouble = Some(what);
        }
    }

    /// Notes that all is well again.
    fn well(&mut self) {
        if let Some(was) = self.trouble.take() {
            tracing::info!(sensor = self.line, "the sensor answers again (before: {was})");
        }
    }
}

fn count(counter: &AtomicU64) {
    counter.fetch_add(1, Ordering::Relaxed);
}

/// A reading with nothing in it but the time.
fn blank() -> LiveReading {
    LiveReading {
        line: 0,
        t_sensor_ns: now_ns(),
        pressure_mpa: f64::NAN,
        gap_mm: f64::NAN,
        measured_force_n: f64::NAN,
        status: 0,
    }
}

/// Waits longer after each failure, up to a limit; starts anew after a success.
struct Backoff {
    next: Duration,
    max: Duration,
}

/// First pause after a failure; longer than the silence that ends a serial frame at any usual speed.
const BACKOFF_FIRST: Duration = Duration::from_millis(20);
/// Pauses are cut into pieces so that the stop flag is seen.
const LOOK: Duration = Duration::from_millis(50);

impl Backoff {
    fn new(max: Duration) -> Self {
        Self { next: BACKOFF_FIRST, max: max.max(BACKOFF_FIRST) }
    }

    fn reset(&mut self) {
        self.next = BACKOFF_FIRST;
    }

    /// The pause after this failure; the next is twice as long.
    fn take(&mut self) -> Duration {
        let pause = self.next.min(self.max);
        self.next = (pause * 2).min(self.max);
        pause
    }

    async fn wait(&mut self, feed: &Feed) {
        let mut left = self.take();
        while !left.is_zero() && !feed.is_stopped() {
            let piece = left.min(LOOK);
            tokio::time::sleep(piece).await;
            left -= piece;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pauses_double_up_to_the_limit_and_start_anew() {
        let mut backoff = Backoff::new(Duration::from_millis(100));
        let pauses: Vec<u128> = (0..5).map(|_| backoff.take().as_millis()).collect();
        assert_eq!(pauses, [20, 40, 80, 100, 100]);
        backoff.reset();
        assert_eq!(backoff.take().as_millis(), 20);
    }
}
