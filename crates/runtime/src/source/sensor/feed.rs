//! A sensor's way to the bridge: the thread of its device hands updates over a bounded queue and wakes the bridge.

use super::calibration::Channel;
use crate::source::reading::{BridgeWaker, SensorCounters};
use crate::source::value::Update;
use std::fmt::Debug;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, OnceLock};
use std::time::Duration;
use wire::now_ns;

/// Most updates that wait for the bridge. The bridge takes them as soon as they come, so a full queue means that it hangs.
const QUEUE: usize = 1024;
/// Fault code of a value outside its calibration, see [`wire::SensorSample::status`].
const OUTSIDE_CALIBRATION: u32 = 257;

/// How the thread of a device ended: nothing yet, as it should be, or a panic with its text.
pub(super) type Ended = Arc<OnceLock<Option<String>>>;

/// The device's end of the way.
#[derive(Debug)]
pub(super) struct Feed {
    /// Text for the log: the sensor's name, the address.
    place: String,
    channels: Vec<Channel>,
    queue: SyncSender<Update>,
    waker: Arc<OnceLock<BridgeWaker>>,
    counters: Arc<SensorCounters>,
    stop: Arc<AtomicBool>,
    trouble: Option<String>,
}

/// The bridge's end of the way. Dropping it stops the sensor.
#[derive(Debug)]
pub(super) struct Inbox {
    pub(super) queue: Receiver<Update>,
    pub(super) counters: Arc<SensorCounters>,
    /// Bit `slot`: values that the sensor delivers.
    pub(super) slots: u64,
    pub(super) ended: Ended,
    stop: Arc<AtomicBool>,
    /// Keeps the device path open for others that join, as long as this sensor lives.
    pub(super) path: Option<Box<dyn Debug + Send>>,
}

impl Drop for Inbox {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
    }
}

/// Both ends for a sensor at `place` that delivers these values.
pub(super) fn connect(
    place: String,
    channels: Vec<Channel>,
    waker: Arc<OnceLock<BridgeWaker>>,
    ended: Ended,
) -> (Feed, Inbox) {
    let (sender, queue) = sync_channel(QUEUE);
    let (counters, stop) = (Arc::<SensorCounters>::default(), Arc::<AtomicBool>::default());
    let slots = channels.iter().fold(0, |slots, channel| slots | 1 << channel.slot);
    let inbox = Inbox { queue, counters: counters.clone(), slots, ended, stop: stop.clone(), path: None };
    (Feed { place, channels, queue: sender, waker, counters, stop, trouble: None }, inbox)
}

impl Feed {
    pub(super) fn is_stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// Hands over raw numbers, each with the position of its value, taken at `t_ns`; they are calibrated and filtered here.
    pub(super) fn send(&mut self, t_ns: u64, raw: impl IntoIterator<Item = (usize, f64)>) {
        let mut update = Update::at(t_ns);
        let mut outside = None;
        for (position, raw) in raw {
            let Some(channel) = self.channels.get_mut(position) else { continue };
            update.which |= 1 << channel.slot;
            match channel.calibration.apply(raw) {
                Some(value) => {
                    if let Some(to) = update.values.get_mut(channel.slot) {
                        *to = channel.filter.apply(t_ns, value);
                    }
                }
                None => {
                    (update.faulty, update.code) = (update.faulty | 1 << channel.slot, OUTSIDE_CALIBRATION);
                    outside = Some(raw);
                }
            }
        }
        match outside {
            None => self.recovered(),
            Some(raw) => {
                self.failed(|c| &c.garbage, &format!("{raw} lies outside the points of its calibration"))
            }
        }
        self.hand_over(update);
    }

    /// Hands over that the device says it cannot measure.
    pub(super) fn fault(&mut self, code: u32) {
        let slots = self.channels.iter().fold(0, |slots, channel| slots | 1 << channel.slot);
        self.hand_over(Update { which: slots, faulty: slots, code: code.max(1), ..Update::at(now_ns()) });
    }

    fn hand_over(&mut self, update: Update) {
        match self.queue.try_send(update) {
            Ok(()) => count(&self.counters.readings),
            Err(TrySendError::Full(_)) => count(&self.counters.overflows),
            // The bridge has ended.
            Err(TrySendError::Disconnected(_)) => self.stop.store(true, Ordering::Relaxed),
        }
        self.wake();
    }

    fn wake(&self) {
        if let Some(waker) = self.waker.get() {
            let _woken_already = waker.try_send(());
        }
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

fn count(counter: &AtomicU64) {
    counter.fetch_add(1, Ordering::Relaxed);
}

/// Waits longer after each failure, up to a limit; begins with the first pause again after a success.
#[derive(Debug)]
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
    pub(super) fn take(&mut self) -> Duration {
        let pause = self.next.min(self.max);
        self.next = (pause * 2).min(self.max);
        pause
    }

    /// Longest pause.
    pub(super) fn max(&self) -> Duration {
        self.max
    }

    /// Sleeps for the pause after this failure, as long as `is_wanted`.
    pub(super) fn sleep(&mut self, is_wanted: impl Fn() -> bool) {
        let mut left = self.take();
        while !left.is_zero() && is_wanted() {
            let piece = left.min(STOP_CHECK);
            std::thread::sleep(piece);
            left -= piece;
        }
    }
}

#[cfg(test)]
#[path = "../../../tests/unit/source_sensor_feed.rs"]
mod tests;
