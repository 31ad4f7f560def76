//! The side of the twin that is replaced: it gives its topics away between two readings, and ends when they are taken.

use runtime::thread_group::StopFlag;
use runtime::twin::Twin;
use runtime::wire::{HeldWatch, background_thread};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Why a daemon ended without a failure.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ended {
    /// As asked, or its sources are at their end.
    Stopped,
    /// Another twin has taken over.
    Replaced,
}

/// How often it is looked whether somebody asks, some 30 us each time. Until then the twin serves.
const INTERVAL: Duration = Duration::from_millis(50);
/// Pause while the other one takes the topics.
const PAUSE: Duration = Duration::from_micros(200);

/// What a twin knows of another one that asks for its topics.
#[derive(Debug, Clone)]
pub struct TakeOver {
    watch: HeldWatch,
    /// Only a twin that serves can be asked: before, the request is its own.
    serves: Arc<AtomicBool>,
    is_asked: Arc<AtomicBool>,
    is_replaced: Arc<AtomicBool>,
}

impl TakeOver {
    /// Nobody asks yet.
    pub fn new(watch: HeldWatch) -> Self {
        Self { watch, serves: Arc::default(), is_asked: Arc::default(), is_replaced: Arc::default() }
    }

    /// From now on this twin serves.
    pub fn begin(&self) {
        self.serves.store(true, Ordering::Relaxed);
    }

    /// Whether another twin has taken the topics.
    pub fn is_replaced(&self) -> bool {
        self.is_replaced.load(Ordering::Relaxed)
    }

    /// Looks again and again, in a thread of its own: the loop itself makes no system call for that.
    pub fn look(&self, end: &StopFlag) {
        background_thread();
        while !end.is_set() {
            let is_asked = self.serves.load(Ordering::Relaxed) && self.watch.all_held();
            self.is_asked.store(is_asked, Ordering::Relaxed);
            end.pause(INTERVAL);
        }
    }

    /// Between two readings: gives the topics away when somebody asks. Returns when this twin serves them again, because the other
    /// one has ended meanwhile, or when `stop` is set, because it is replaced.
    pub fn give_way(&self, twin: &Twin, stop: &AtomicBool) {
        if !self.is_asked.load(Ordering::Relaxed) {
            return;
        }
        twin.give_rights();
        while !stop.load(Ordering::Relaxed) {
            if !self.watch.all_held() {
                match twin.take_rights() {
                    Ok(()) => {
                        tracing::warn!("the twin that asked for the topics has ended: this one goes on")
                    }
                    Err(_another_has_them) => {
                        self.is_replaced.store(true, Ordering::Relaxed);
                        stop.store(true, Ordering::Relaxed);
                    }
                }
                self.is_asked.store(false, Ordering::Relaxed);
                return;
            }
            std::thread::sleep(PAUSE);
        }
    }
}
