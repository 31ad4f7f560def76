//! Services of the twin in separate threads with their own shared-memory ports; the twin's loop is not involved.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::Receiver;
use std::time::Duration;
use wire::{Bus, WireError};

/// Longest sleep: the stop flag is checked that often.
const MAX_WAIT: Duration = Duration::from_millis(100);

/// A service that runs until it is stopped, and takes other models while it runs.
pub trait SideService: Sized {
    /// Models of the service.
    type Model: Send;

    /// Name of its thread, and in the log.
    const NAME: &'static str;

    /// Opens its ports.
    ///
    /// # Errors
    /// The refusals of the ports.
    fn start(bus: &Bus, model: Self::Model) -> Result<Self, WireError>;

    /// Continues with another model of the same actuators. False, and nothing changed, when they are others.
    fn replace(&mut self, model: Self::Model) -> bool;

    /// Waits for something to do, at most `max_wait`, and does it.
    ///
    /// # Errors
    /// The failures of the ports.
    fn turn(&mut self, max_wait: Duration) -> Result<(), WireError>;

    /// Serves until `stop`; takes `models` between two iterations.
    fn run(&mut self, stop: &AtomicBool, models: &Receiver<Self::Model>) {
        while !stop.load(Ordering::Relaxed) {
            if let Err(error) = self.turn(MAX_WAIT) {
                tracing::warn!("{}: {error}", Self::NAME);
                std::thread::sleep(MAX_WAIT); // a failing port must not become a busy loop
            }
            if models.try_recv().is_ok_and(|model| !self.replace(model)) {
                tracing::error!(
                    "{}: the new scene has other actuators; the old models stay, restart the twin",
                    Self::NAME
                );
            }
        }
    }
}
