//! Between the reader and the pages: the newest frame of each actuator, and the number of viewers.

use crate::readings::{Cursors, Reading, Readings};
use axum::body::Bytes;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use tokio::sync::watch;

/// Pages at the same time; more are refused.
pub const MAX_VIEWERS: usize = 16;

/// One frame, ready to send, with a number that grows with every frame of any actuator.
#[derive(Clone, Debug)]
pub struct Slot {
    /// Larger than that of every earlier frame.
    pub number: u64,
    pub message: Bytes,
    /// A notification instead of a frame.
    pub is_text: bool,
}

/// Newest frames by actuator.
#[derive(Debug)]
pub struct Hub {
    slots: Mutex<BTreeMap<String, Slot>>,
    readings: Mutex<Readings>,
    newest: watch::Sender<u64>,
    viewers: AtomicUsize,
}

/// One page; dropping it reduces the count.
#[derive(Debug)]
pub struct Viewer<'a>(&'a Hub);

impl Default for Hub {
    fn default() -> Self {
        Self {
            slots: Mutex::default(),
            readings: Mutex::default(),
            newest: watch::Sender::new(0),
            viewers: AtomicUsize::new(0),
        }
    }
}

impl Hub {
    /// Replaces an actuator's frame and wakes the pages.
    pub fn put(&self, actuator: &str, message: Vec<u8>) {
        self.replace(actuator, message, false);
    }

    /// Replaces the notification of a subject that all pages receive. No actuator's name has a `/` in it.
    pub fn notify(&self, subject: &str, text: String) {
        self.replace(&format!("{subject}/"), text.into_bytes(), true);
    }

    fn replace(&self, actuator: &str, message: Vec<u8>, is_text: bool) {
        let mut slots = self.slots.lock().unwrap_or_else(PoisonError::into_inner);
        let number = *self.newest.borrow() + 1;
        slots.insert(actuator.to_owned(), Slot { number, message: message.into(), is_text });
        self.newest.send_replace(number);
    }

    /// Keeps a reading for the strip charts.
    pub fn record(&self, actuator: &str, reading: Reading) {
        self.readings.lock().unwrap_or_else(PoisonError::into_inner).push(actuator, reading);
    }

    /// Messages with the readings that a page has not, which it then has.
    pub fn readings_since(&self, cursors: &mut Cursors) -> Vec<Vec<u8>> {
        self.readings.lock().unwrap_or_else(PoisonError::into_inner).since(cursors)
    }

    /// Frames newer than `number`, oldest first.
    pub fn newer_than(&self, number: u64) -> Vec<Slot> {
        let slots = self.slots.lock().unwrap_or_else(PoisonError::into_inner);
        let mut newer: Vec<Slot> = slots.values().filter(|slot| slot.number > number).cloned().collect();
        newer.sort_by_key(|slot| slot.number);
        newer
    }

    /// Wakes when there is a newer frame.
    pub fn watch(&self) -> watch::Receiver<u64> {
        self.newest.subscribe()
    }

    /// Adds a page to the count; none when there are too many.
    pub fn enter(&self) -> Option<Viewer<'_>> {
        let more = |now: usize| (now < MAX_VIEWERS).then_some(now + 1);
        self.viewers.fetch_update(Ordering::AcqRel, Ordering::Acquire, more).ok().map(|_| Viewer(self))
    }

    /// Number of pages.
    pub fn viewers(&self) -> usize {
        self.viewers.load(Ordering::Acquire)
    }

    /// Removes all frames and readings: without viewers they become old.
    pub fn clear(&self) {
        *self.readings.lock().unwrap_or_else(PoisonError::into_inner) = Readings::default();
        self.slots.lock().unwrap_or_else(PoisonError::into_inner).clear();
    }
}

impl Drop for Viewer<'_> {
    fn drop(&mut self) {
        self.0.viewers.fetch_sub(1, Ordering::AcqRel);
    }
}

#[cfg(test)]
#[path = "../tests/unit/hub.rs"]
mod tests;
