//! Events of the loop, handed to the reporter thread without a lock, an allocation or a system call.

use std::sync::atomic::{AtomicU64, Ordering};

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
#[repr(u32)]
pub enum EventKind {
    /// Readings now end otherwise than before; value: [`wire::Outcome::code`].
    Outcome = 0,
    /// The regime changed; value: number of [`wire::layout::regime`].
    Regime = 1,
    /// No good reading within the deadline; value: age of the last one, ns.
    Stale = 2,
    /// Good readings again; value: how long there were none, ns.
    Fresh = 3,
    /// The bridge runs anew (or for the first time); value: its boot id.
    SensorStarted = 4,
    /// Readings never arrived; value: how many.
    Missed = 5,
    /// The measured force left its half-width around the predicted one, or is back in it; value: 1 left, 0 back.
    ForceMismatch = 6,
    /// Readings could not be received; value: failures of this kind so far, as for all that follow.
    ReceiveFailed = 7,
    /// A state, field or health could not be sent.
    SendFailed = 8,
    /// The model gave no field for an evaluation.
    ReconstructionFailed = 9,
    /// The wait for readings failed.
    WaitFailed = 10,
}

impl EventKind {
    /// Kinds of events.
    pub(super) const COUNT: usize = Self::ALL.len();

    /// In the order of their numbers.
    const ALL: [Self; 11] = [
        Self::Outcome,
        Self::Regime,
        Self::Stale,
        Self::Fresh,
        Self::SensorStarted,
        Self::Missed,
        Self::ForceMismatch,
        Self::ReceiveFailed,
        Self::SendFailed,
        Self::ReconstructionFailed,
        Self::WaitFailed,
    ];
}

/// Events that fit; more are counted as lost. A power of two.
pub const CAPACITY: usize = 1024;

/// A ring for one writer (the loop) and one reader (the reporter).
#[derive(Debug)]
pub struct Ring {
    slots: Box<[[AtomicU64; 3]]>,
    written: AtomicU64,
    read: AtomicU64,
    lost: AtomicU64,
}

impl Default for Ring {
    fn default() -> Self {
        Self {
            slots: (0..CAPACITY).map(|_| Default::default()).collect(),
            written: AtomicU64::new(0),
            read: AtomicU64::new(0),
            lost: AtomicU64::new(0),
        }
    }
}

impl Ring {
    /// Writes an event, or counts it as lost when the reporter is behind. Only one thread may write.
    pub fn push(&self, event: Event) {
        let written = self.written.load(Ordering::Relaxed);
        if written - self.read.load(Ordering::Acquire) >= CAPACITY as u64 {
            self.lost.fetch_add(1, Ordering::Relaxed);
            return;
        }
        if let Some([time, what, value]) = self.slots.get(written as usize % CAPACITY) {
            time.store(event.t_ns, Ordering::Relaxed);
            what.store(u64::from(event.actuator) << 32 | event.kind as u64, Ordering::Relaxed);
            value.store(event.value, Ordering::Relaxed);
        }
        self.written.store(written + 1, Ordering::Release);
    }

    /// Takes the oldest event. Only one thread may read.
    pub fn pop(&self) -> Option<Event> {
        let read = self.read.load(Ordering::Relaxed);
        if read == self.written.load(Ordering::Acquire) {
            return None;
        }
        let [time, what, value] = self.slots.get(read as usize % CAPACITY)?;
        let what = what.load(Ordering::Relaxed);
        let event = Event {
            t_ns: time.load(Ordering::Relaxed),
            actuator: (what >> 32) as u32,
            kind: *EventKind::ALL.get((what & 0xffff_ffff) as usize)?,
            value: value.load(Ordering::Relaxed),
        };
        self.read.store(read + 1, Ordering::Release);
        Some(event)
    }

    /// Events lost so far.
    pub fn lost(&self) -> u64 {
        self.lost.load(Ordering::Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn event(value: u64) -> Event {
        Event {
            t_ns: value * 10,
            actuator: (value % 3) as u32,
            kind: EventKind::ALL[value as usize % EventKind::COUNT],
            value,
        }
    }

    #[test]
    fn kinds_are_in_the_order_of_their_numbers() {
        assert!((0u32..).zip(EventKind::ALL).all(|(number, kind)| kind as u32 == number));
    }

    #[test]
    fn events_arrive_in_order_across_threads_or_are_counted() {
        let ring = Ring::default();
        let sent = 200_000;
        let received = std::thread::scope(|scope| {
            scope.spawn(|| (0..sent).for_each(|value| ring.push(event(value))));
            let reader = scope.spawn(|| {
                let mut received: Vec<u64> = Vec::new();
                while received.len() as u64 + ring.lost() < sent {
                    while let Some(found) = ring.pop() {
                        assert_eq!(found, event(found.value), "a torn event");
                        received.push(found.value);
                    }
                }
                received
            });
            reader.join().unwrap()
        });
        assert!(received.is_sorted(), "out of order");
        assert_eq!(received.len() as u64 + ring.lost(), sent);
    }

    #[test]
    fn a_full_ring_loses_the_newest_and_says_so() {
        let ring = Ring::default();
        (0..CAPACITY as u64 + 5).for_each(|value| ring.push(event(value)));
        assert_eq!(ring.lost(), 5);
        assert_eq!(ring.pop(), Some(event(0)));
    }
}
