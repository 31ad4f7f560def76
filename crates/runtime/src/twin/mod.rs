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
//! loaned sample), takes no lock, writes no log: its events go through a channel; its only system calls are the wait and the wake-up of
//! readers.

mod actuator;
mod events;
mod force_watch;
mod ingest;
mod reconstruct;
mod record;
mod swap;

pub use events::{Event, EventKind, EventSender, event_channel};
pub use swap::{Retired, SwapError};

use crate::config::Settings;
use crate::load::Loaded;
use actuator::ActuatorTwin;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;
use wire::{Bus, Health, WakeSet, Wakeable, WireError, boot_id, now_ns};

/// Longest sleep: the stop flag is checked that often, and the watchdog sees progress.
const MAX_WAIT: Duration = Duration::from_millis(100);

/// A running twin with all its topics open.
#[derive(Debug)]
pub struct Twin {
    actuators: Vec<ActuatorTwin>,
    wait: WakeSet,
    busy_poll: bool,
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
        let boot_id = boot_id();
        let actuators: Vec<ActuatorTwin> = (0..)
            .zip(loaded)
            .map(|(number, loaded)| {
                ActuatorTwin::start(bus, number, loaded, settings.limits, boot_id, events.clone())
            })
            .collect::<Result<_, WireError>>()?;
        let wait = WakeSet::new(actuators.iter().map(|actuator| &actuator.reader as &dyn Wakeable));
        Ok(Self { actuators, wait, busy_poll: settings.realtime.busy_poll })
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
            if self.wait.wait(timeout).is_err() {
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

    /// Counters of every actuator.
    pub fn health(&self) -> impl Iterator<Item = &Health> {
        self.actuators.iter().map(ActuatorTwin::health)
    }
}
