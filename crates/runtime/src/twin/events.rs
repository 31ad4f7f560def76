//! Events of the loop, handed to the reporter thread without a lock, an allocation or a system call.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

/// A change that belongs in the log. Repetitions are not sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Event {
    /// When, see [`wire::now_ns`].
    pub t_ns: u64,
    /// Which actuator, by its place in the scene.
    pub actuator: u32,
    /// What.
    pub kind: EventKind,
    /// Its number, see [`EventKind`].
    pub value: u64,
}

/// What happened.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EventKind {
    /// Readings now end otherwise than before; value: [`wire::Outcome::code`].
    Outcome,
    /// The regime changed; value: its number.
    Regime,
    /// No good reading within the deadline; value: age of the last one, ns.
    Stale,
    /// Good readings again; value: how long there were none, ns.
    Fresh,
    /// The bridge runs anew (or for the first time); value: its boot id.
    SensorStarted,
    /// Readings never arrived; value: how many.
    Missed,
    /// The measured force left its half-width around the predicted one, or is back in it; value: 1 left, 0 back.
    ForceMismatch,
    /// Readings could not be received; value: failures of this kind so far, as for all that follow.
    ReceiveFailed,
    /// A state, field or health could not be sent.
    SendFailed,
    /// The model gave no field for an evaluation.
    ReconstructionFailed,
    /// The wait for readings failed.
    WaitFailed,
}

impl EventKind {
    /// Kinds of events.
    pub(super) const COUNT: usize = Self::WaitFailed as usize + 1;
}

/// Events that wait for the reporter, at most; more are counted as lost.
const CAPACITY: usize = 1024;

/// The loop's end of the channel. The channel has its memory from the start, and nobody waits in it: sending is a few atomic
/// operations.
#[derive(Debug, Clone)]
pub struct EventSender {
    events: SyncSender<Event>,
    lost: Arc<AtomicU64>,
}

/// A channel from the loop to the reporter, who must not wait in it (`try_recv`).
pub fn event_channel() -> (EventSender, Receiver<Event>) {
    let (events, receiver) = sync_channel(CAPACITY);
    (EventSender { events, lost: Arc::default() }, receiver)
}

impl EventSender {
    /// Sends an event, or counts it as lost when the reporter is behind.
    pub(super) fn send(&self, event: Event) {
        if self.events.try_send(event).is_err() {
            self.lost.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Events lost so far.
    pub(super) fn lost(&self) -> u64 {
        self.lost.load(Ordering::Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_channel_loses_the_newest_and_counts_them() {
        let (sender, receiver) = event_channel();
        let event = |value| Event { t_ns: 1, actuator: 0, kind: EventKind::Missed, value };
        (0..CAPACITY as u64 + 5).for_each(|value| sender.send(event(value)));
        assert_eq!(sender.lost(), 5);
        assert!(receiver.try_iter().map(|event| event.value).eq(0..CAPACITY as u64));
    }
}
