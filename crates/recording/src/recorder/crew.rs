//! Threads that begin one by one and end together.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::Duration;

/// Longest sleep, so that the end is seen.
pub const WAIT: Duration = Duration::from_millis(50);

/// Threads that are told to end, and waited for, when this is dropped.
#[derive(Default)]
pub struct Crew {
    stop: Stop,
    threads: Vec<JoinHandle<()>>,
}

/// Says when to end.
#[derive(Debug, Clone, Default)]
pub struct Stop(Arc<AtomicBool>);

impl Crew {
    /// Begins one more thread, which does `work` until it is told to end.
    pub fn begin(&mut self, work: impl FnOnce(&Stop) + Send + 'static) {
        let stop = self.stop.clone();
        self.threads.push(thread::spawn(move || work(&stop)));
    }

    /// Whether a thread ended although nobody told it to: a defect.
    pub fn is_short(&self) -> bool {
        self.threads.iter().any(JoinHandle::is_finished)
    }
}

impl Stop {
    /// Whether it is time to end.
    pub fn is_set(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }

    /// Sleeps for `time`, or until it is time to end.
    pub fn pause(&self, time: Duration) {
        let mut left = time;
        while !self.is_set() && !left.is_zero() {
            let nap = left.min(WAIT);
            thread::sleep(nap);
            left -= nap;
        }
    }
}

impl Drop for Crew {
    fn drop(&mut self) {
        self.stop.0.store(true, Ordering::Relaxed);
        for thread in self.threads.drain(..) {
            let _ = thread.join(); // a panic in there has been printed
        }
    }
}
