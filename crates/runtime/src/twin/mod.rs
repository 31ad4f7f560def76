//! The twin: waits for readings, answers each with a state and fields. One thread for any number of actuators.
//!
//! Every reading goes through these steps, in this order (`actuator.rs` calls them):
//!
//! | step | file |
//! | --- | --- |
//! | 1. poll: take it from the sensor topic | `actuator.rs` |
//! | 2. ingest: validate it; a good one waits for its answer | `ingest.rs` |
//! | 3. evaluate: coefficients, force, gradients, half-widths; fill the state | `actuator.rs`, `payload.rs` |
//! | 4. reconstruct: write each field into a sample on loan | `reconstruct.rs` |
//! | 5. publish: send state and fields | `actuator.rs`, `reconstruct.rs` |
//! | 6. record the outcome: count it once, after its outputs | `record.rs` |
//!
//! After start the loop allocates nothing of its own (a test counts: what remains is the transport's small handle for each
//! loaned sample), takes no lock, writes no log: its events go through a channel; its only system calls are the wait (which spins
//! before an expected reading, `wire/src/spin`, and then repeats the last evaluation, so that what it reads is in the caches) and the
//! wake-up of readers.

mod actuator;
mod entry;
mod events;
mod force_watch;
mod ingest;
mod reconstruct;
mod record;
mod swap;
mod take_over;

pub use events::{Event, EventKind, EventSender, event_channel};
pub use swap::{Retired, SwapError};

use crate::config::{Realtime, Settings};
use crate::load::Loaded;
use actuator::ActuatorTwin;
use entry::Entry;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;
use wire::{Bus, Health, SpinCounts, SpinSources, SpinWait, Wakeable, WireError, boot_id, now_ns};

/// Longest sleep: the stop flag is checked that often, and the watchdog sees progress.
const MAX_WAIT: Duration = Duration::from_millis(100);

/// A running twin with all its topics open.
#[derive(Debug)]
pub struct Twin {
    actuators: Vec<ActuatorTwin>,
    wait: SpinWait,
    busy_poll: bool,
}

/// The actuators whose readings the loop waits for.
struct Expected<'a>(&'a mut [ActuatorTwin]);

impl SpinSources for Expected<'_> {
    fn has_next(&self, at: usize) -> bool {
        self.0.get(at).is_some_and(|actuator| actuator.reader.has_next())
    }

    fn prepare(&mut self, at: usize, step: usize) -> bool {
        self.0.get_mut(at).is_none_or(|actuator| actuator.prepare(step))
    }
}

impl Twin {
    /// Becomes the twin of all actuators of a scene.
    ///
    /// # Errors
    /// [`WireError::AlreadyPublished`] when another twin serves one of them, [`WireError::NoMemory`] when /dev/shm is
    /// full, and the other refusals of the ports.
    pub fn start(
        bus: &Bus,
        loaded: Vec<Loaded>,
        settings: &Settings,
        events: &EventSender,
    ) -> Result<Self, WireError> {
        Self::enter(bus, loaded, settings, events, Entry::AtOnce)
    }

    /// As [`Self::start`], with all memory and without the right to serve, which [`Self::take_over`] takes.
    ///
    /// # Errors
    /// As [`Self::start`].
    pub fn stand_by(
        bus: &Bus,
        loaded: Vec<Loaded>,
        settings: &Settings,
        events: &EventSender,
    ) -> Result<Self, WireError> {
        Self::enter(bus, loaded, settings, events, Entry::StandBy)
    }

    fn enter(
        bus: &Bus,
        loaded: Vec<Loaded>,
        settings: &Settings,
        events: &EventSender,
        entry: Entry,
    ) -> Result<Self, WireError> {
        let boot_id = boot_id();
        let actuators: Vec<ActuatorTwin> = (0..)
            .zip(loaded)
            .map(|(number, loaded)| {
                ActuatorTwin::start(bus, number, loaded, settings.limits, boot_id, events.clone(), entry)
            })
            .collect::<Result<_, WireError>>()?;
        let readers = actuators.iter().map(|actuator| &actuator.reader as &dyn Wakeable);
        let Realtime { busy_poll, spin_share, .. } = settings.realtime;
        let wait = SpinWait::new(readers, if busy_poll { 0.0 } else { spin_share });
        Ok(Self { actuators, wait, busy_poll })
    }

    /// Maps all pages of all samples ahead of use; returns the bytes.
    ///
    /// # Errors
    /// The system's refusal.
    pub fn prefault(&self) -> std::io::Result<u64> {
        self.actuators.iter().flat_map(|actuator| &actuator.outputs).map(|output| output.prefault()).sum()
    }

    /// Runs until `stop`, with something to do between two turns (a swap, say). `progress` counts turns, so that a watchdog
    /// can see that the loop lives.
    pub fn run(&mut self, stop: &AtomicBool, progress: &AtomicU64, mut between: impl FnMut(&mut Self)) {
        while !stop.load(Ordering::Relaxed) {
            self.turn(MAX_WAIT);
            progress.fetch_add(1, Ordering::Relaxed);
            between(self);
        }
    }

    /// Waits for readings (at most `max_wait`, or until something is due), then serves every actuator once.
    pub fn turn(&mut self, max_wait: Duration) {
        if !self.busy_poll {
            let due_ns = self.actuators.iter().map(ActuatorTwin::next_due_ns).min().unwrap_or(u64::MAX);
            let timeout = Duration::from_nanos(due_ns.saturating_sub(now_ns())).min(max_wait);
            let Self { actuators, wait, .. } = self;
            if wait.wait(timeout, Expected(actuators)).is_err() {
                self.actuators.iter_mut().for_each(ActuatorTwin::wait_failed);
                std::thread::sleep(max_wait); // a failing wait must not become a busy loop
            }
        }
        self.actuators.iter_mut().for_each(ActuatorTwin::serve);
    }

    /// Continues with other models for the same actuators and topics. All or nothing.
    ///
    /// Cost: a few pointers an actuator; nothing is loaded, nothing freed.
    ///
    /// # Errors
    /// [`SwapError`]; the twin is as before.
    pub fn swap(&mut self, loaded: Vec<Loaded>) -> Result<Retired, SwapError> {
        let running: Vec<_> = self.actuators.iter().map(ActuatorTwin::running).collect();
        swap::check(&running, &loaded)?;
        let mut retired = Retired::default();
        for (actuator, loaded) in self.actuators.iter_mut().zip(loaded) {
            actuator.swap(loaded, &mut retired);
        }
        Ok(retired)
    }

    /// What spinning for readings came to; nothing where it does not spin.
    pub fn spin_counts(&self) -> Option<SpinCounts> {
        self.wait.spins().then(|| self.wait.counts())
    }

    /// Counters of every actuator.
    pub fn health(&self) -> impl Iterator<Item = &Health> {
        self.actuators.iter().map(ActuatorTwin::health)
    }
}
