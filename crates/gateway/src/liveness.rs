//! Feeds the service manager's watchdog while all threads of the gateway run.

use runtime::service::Watchdog;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Counts the rounds in which every thread completed an iteration, and feeds the watchdog: one blocked thread lets the gateway
/// restart.
#[derive(Debug)]
pub struct Liveness {
    watchdog: Watchdog,
    rounds: u64,
    threads: Vec<Arc<AtomicBool>>,
}

impl Liveness {
    /// No threads yet.
    pub fn from_env() -> Self {
        Self { watchdog: Watchdog::from_env(), rounds: 0, threads: Vec::new() }
    }

    /// Removes all threads after they have ended.
    pub fn forget_threads(&mut self) {
        self.threads.clear();
    }

    /// Adds a thread: the flag that it sets in each iteration.
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
