//! The twin: waits for readings, answers each with a state and fields. One thread for any number of actuators.
//!
//! After start the loop allocates nothing of its own (a test counts: what remains is the transport's small handle for each
//! loaned sample), takes no lock, writes no log: what it has to say goes through [`Ring`]; its only system calls are the
//! wait and the wake-up of readers.

mod actuator;
mod check;
mod histogram;
mod load;
mod output;
mod ring;
mod swap;
mod watch;

pub(crate) use actuator::regime_number;
pub use histogram::Histogram;
pub use load::{Loaded, LoadedOutput, ReadBlock, load, load_scene};
pub use ring::{CAPACITY as RING_CAPACITY, Event, EventKind, Ring};
pub use swap::{Retired, SwapError};

use crate::config::Settings;
use actuator::ActuatorTwin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;
use wire::{Bus, Health, WakeSet, Wakeable, WireError, boot_id, now_ns};

/// Longest sleep: the shutdown flag is looked at that often, and the watchdog sees progress.
const MAX_WAIT: Duration = Duration::from_millis(100);

/// A running twin with all its topics open.
#[derive(Debug)]
pub struct Twin {
    actuators: Vec<ActuatorTwin>,
    wake: WakeSet,
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
        ring: &Arc<Ring>,
    ) -> Result<Self, WireError> {
        let boot_id = boot_id();
        let actuators: Vec<ActuatorTwin> = loaded
            .into_iter()
            .enumerate()
            .map(|(number, loaded)| {
                ActuatorTwin::start(bus, number as u32, loaded, settings.limits, boot_id, ring.clone())
            })
            .collect::<Result<_, WireError>>()?;
        let wake = WakeSet::new(actuators.iter().map(|actuator| &actuator.reader as &dyn Wakeable));
        Ok(Self { actuators, wake, busy_poll: settings.realtime.busy_poll })
    }

    /// Maps all pages of all samples ahead of use; returns the bytes.
    ///
    /// # Errors
    /// The system's refusal.
    pub fn prefault(&self) -> std::io::Result<u64> {
        self.actuators.iter().flat_map(|actuator| &actuator.outputs).map(|output| output.prefault()).sum()
    }

    /// Runs until `stop`. `progress` counts turns, so that a watchdog can see that the loop lives.
    pub fn run(&mut self, stop: &AtomicBool, progress: &AtomicU64) {
        self.run_with(stop, progress, |_| ());
    }

    /// The same, with something to do between two turns (a swap, say).
    pub fn run_with(&mut self, stop: &AtomicBool, progress: &AtomicU64, mut between: impl FnMut(&mut Self)) {
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
            let readers = self.actuators.iter().map(|actuator| &actuator.reader as &dyn Wakeable);
            if self.wake.wait(readers, timeout).is_err() {
                self.actuators.iter_mut().for_each(ActuatorTwin::transport_failed);
                std::thread::sleep(max_wait); // a broken wait must not become a spin
            }
        }
        self.actuators.iter_mut().for_each(ActuatorTwin::turn);
    }

    /// Counters of every actuator.
    pub fn health(&self) -> impl Iterator<Item = &Health> {
        self.actuators.iter().map(ActuatorTwin::health)
    }
}
