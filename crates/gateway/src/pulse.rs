//! Whether all threads of the gateway go on, for the service manager's watchdog.

use runtime::service::Watchdog;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Counts the rounds in which every thread has taken a turn, and feeds the watchdog with them: one that hangs is enough to
/// be started again.
#[derive(Debug)]
pub struct Pulse {
    watchdog: Watchdog,
    rounds: u64,
    /// Turns of each thread, and where they stood when the round began.
    threads: Vec<(Arc<AtomicU64>, u64)>,
}

impl Pulse {
    /// Of no thread yet.
    pub fn from_env() -> Self {
        Self { watchdog: Watchdog::from_env(), rounds: 0, threads: Vec::new() }
    }

    /// A counter for the turns of one more thread.
    pub fn of_thread(&mut self) -> Arc<AtomicU64> {
        let turns = Arc::new(AtomicU64::new(0));
        self.threads.push((turns.clone(), 0));
        turns
    }

    /// Feeds the watchdog when it is due and a round is complete.
    pub fn look(&mut self) {
        let rounds = self.count();
        self.watchdog.look(rounds);
    }

    /// Rounds so far.
    fn count(&mut self) -> u64 {
        let turns = |(turns, _): &(Arc<AtomicU64>, u64)| turns.load(Ordering::Relaxed);
        if self.threads.iter().all(|thread| turns(thread) != thread.1) {
            self.threads.iter_mut().for_each(|thread| thread.1 = turns(thread));
            self.rounds += 1;
        }
        self.rounds
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_thread_that_stands_still_ends_the_rounds() {
        let mut pulse = Pulse::from_env();
        assert!(pulse.count() < pulse.count(), "before the threads start, looking is the turn");
        let (quick, slow) = (pulse.of_thread(), pulse.of_thread());
        let begin = pulse.count();
        for _ in 0..3 {
            quick.fetch_add(7, Ordering::Relaxed);
            assert_eq!(pulse.count(), begin, "the slow thread hangs");
        }
        slow.fetch_add(1, Ordering::Relaxed);
        assert_eq!(pulse.count(), begin + 1);
        slow.fetch_add(1, Ordering::Relaxed);
        assert_eq!(pulse.count(), begin + 1, "now the quick one hangs");
    }
}
