//! The thread of a device, and the queue of its readings for the bridge.

use crate::source::reading::{BridgeWaker, Poll, Reading, SensorCounters, Source};
use recording::thread_group::panic_text;
use std::fmt::Debug;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::thread::{Builder, JoinHandle};
use std::time::Duration;
use tokio::runtime::Runtime;

/// Most readings that wait for the bridge. The bridge takes them as soon as they come, so a full queue means that it hangs.
const QUEUE: usize = 1024;

/// A kind of device: reads until [`Feed::is_stopped`], or to its end.
pub(super) trait Device: Debug + Send + 'static {
    /// Text for the log, such as the address.
    fn place(&self) -> String;

    /// Runs in the device's own thread.
    fn run(&self, feed: Feed, runtime: &Runtime);
}

/// A source with a device behind it. Dropping it stops its thread.
#[derive(Debug)]
pub(super) struct Sensor {
    /// Until the start.
    device: Option<Box<dyn Device>>,
    stop: Arc<AtomicBool>,
    counters: Arc<SensorCounters>,
    queue: Option<Receiver<Reading>>,
    thread: Option<JoinHandle<()>>,
}

/// What a device's thread works with.
pub(super) struct Feed {
    place: String,
    queue: SyncSender<Reading>,
    waker: BridgeWaker,
    counters: Arc<SensorCounters>,
    stop: Arc<AtomicBool>,
    trouble: Option<String>,
}

impl Sensor {
    /// A source that is not started, or the problems of its specification.
    pub(super) fn open(device: impl Device, problems: Vec<String>) -> Result<Box<dyn Source>, Vec<String>> {
        if !problems.is_empty() {
            return Err(problems);
        }
        Ok(Box::new(Self {
            device: Some(Box::new(device)),
            stop: Arc::default(),
            counters: Arc::default(),
            queue: None,
            thread: None,
        }))
    }

    /// The end of the thread: as it should be, or a panic with its text.
    fn ended(&mut self) -> Poll {
        let Some(Err(panic)) = self.thread.take().map(JoinHandle::join) else { return Poll::End };
        Poll::Failed(panic_text(panic.as_ref()).to_owned())
    }
}

impl Source for Sensor {
    fn start(&mut self, waker: &BridgeWaker) -> std::io::Result<()> {
        let Some(device) = self.device.take() else { return Ok(()) };
        let (sender, receiver) = sync_channel(QUEUE);
        let feed = Feed {
            place: device.place(),
            queue: sender,
            waker: waker.clone(),
            counters: self.counters.clone(),
            stop: self.stop.clone(),
            trouble: None,
        };
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        let thread = Builder::new().name("sensor".into()).spawn(move || device.run(feed, &runtime))?;
        (self.queue, self.thread) = (Some(receiver), Some(thread));
        Ok(())
    }

    fn poll(&mut self, _elapsed_s: f64) -> Poll {
        // Looked at before the queue: a thread that has ended has handed over all its readings.
        let has_ended = self.thread.as_ref().is_none_or(JoinHandle::is_finished);
        match self.queue.as_ref().and_then(|queue| queue.try_recv().ok()) {
            Some(reading) => Poll::Reading(reading),
            None if has_ended => self.ended(),
            None => Poll::Waiting { until_s: f64::INFINITY },
        }
    }

    fn device(&self) -> Option<&Arc<SensorCounters>> {
        Some(&self.counters)
    }
}

impl Drop for Sensor {
    fn drop(&mut self) {
        // Not joined: a thread that reads standard input waits for its next line, and ends with the process.
        self.stop.store(true, Ordering::Relaxed);
    }
}

impl Feed {
    pub(super) fn is_stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// Hands a reading to the bridge and wakes it.
    pub(super) fn send(&mut self, reading: Reading) {
        match self.queue.try_send(reading) {
            Ok(()) => count(&self.counters.readings),
            Err(TrySendError::Full(_)) => count(&self.counters.overflows),
            // The bridge has ended.
            Err(TrySendError::Disconnected(_)) => self.stop.store(true, Ordering::Relaxed),
        }
        let _woken_already = self.waker.try_send(());
    }

    /// Counts a failure; logs it when it is not the same as before.
    pub(super) fn failed(&mut self, counter: impl Fn(&SensorCounters) -> &AtomicU64, what: &str) {
        count(counter(self.counters.as_ref()));
        let what = format!("{}: {what}", self.place);
        if self.trouble.as_ref() != Some(&what) {
            tracing::warn!("{what}");
            self.trouble = Some(what);
        }
    }

    /// Logs the end of the failures.
    pub(super) fn recovered(&mut self) {
        if let Some(before) = self.trouble.take() {
            tracing::info!("the sensor answers again (before: {before})");
        }
    }
}

/// Wakes the bridge once more, so that it sees the end.
impl Drop for Feed {
    fn drop(&mut self) {
        let _woken_already = self.waker.try_send(());
    }
}

fn count(counter: &AtomicU64) {
    counter.fetch_add(1, Ordering::Relaxed);
}

/// Waits longer after each failure, up to a limit; begins with the first pause again after a success.
pub(super) struct Backoff {
    next: Duration,
    max: Duration,
}

/// First pause after a failure; longer than the silence that ends a serial frame at any usual speed.
const FIRST_PAUSE: Duration = Duration::from_millis(20);
/// Longest wait without a look at the stop flag.
pub(super) const STOP_CHECK: Duration = Duration::from_millis(50);

impl Backoff {
    pub(super) fn new(max: Duration) -> Self {
        Self { next: FIRST_PAUSE, max: max.max(FIRST_PAUSE) }
    }

    pub(super) fn reset(&mut self) {
        self.next = FIRST_PAUSE;
    }

    /// The pause after this failure; the next is twice as long.
    fn take(&mut self) -> Duration {
        let pause = self.next.min(self.max);
        self.next = (pause * 2).min(self.max);
        pause
    }

    pub(super) async fn wait(&mut self, feed: &Feed) {
        let mut left = self.take();
        while !left.is_zero() && !feed.is_stopped() {
            let piece = left.min(STOP_CHECK);
            tokio::time::sleep(piece).await;
            left -= piece;
        }
    }
}

#[cfg(test)]
#[path = "../../../tests/unit/source_sensor_device.rs"]
mod tests;
