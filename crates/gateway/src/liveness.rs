//! Feeds the service manager's watchdog while all threads of the gateway go on.

use runtime::service::Watchdog;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Counts the rounds in which every thread has gone through its loop, and feeds the watchdog with them: one thread that hangs
/// is reason enough to start the gateway again.
#[derive(Debug)]
pub struct Liveness {
    watchdog: Watchdog,
    rounds: u64,
    threads: Vec<Arc<AtomicBool>>,
}

impl Liveness {
    /// Without threads.
    pub fn from_env() -> Self {
        Self { watchdog: Watchdog::from_env(), rounds: 0, threads: Vec::new() }
    }

    /// Their threads have ended: others take their place.
    pub fn forget_threads(&mut self) {
        self.threads.clear();
    }

    /// A flag that one more thread sets each time it goes through its loop.
    pub fn add_thread(&mut self) -> Arc<AtomicBool> {
        let is_alive = Arc::new(AtomicBool::new(false));
        self.threads.push(is_alive.clone());
        is_alive
    }

    /// Feeds the watchdog when it is due and a round is complete.
    pub fn feed(&mut self) {
        let rounds = self.count();
        self.watchdog.feed(rounds);
    }

    fn count(&mut self) -> u64 {
        if self.threads.iter().all(|is_alive| is_alive.load(Ordering::Relaxed)) {
            self.threads.iter().for_each(|is_alive| is_alive.store(false, Ordering::Relaxed));
            self.rounds += 1;
        }
        self.rounds
    }
}

#[cfg(test)]
#[path = "../tests/unit/liveness.rs"]
mod tests;
