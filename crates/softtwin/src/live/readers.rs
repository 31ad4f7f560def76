//! Several readers and the wait for any of them.

use super::find;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use wire::{AnyReader, AnySample, Bus, KeyExpr, Topic, Wake, WakeSet, Wakeable, WireError};

/// Readers of all topics that a key expression matches.
#[derive(Debug)]
pub struct Readers {
    readers: Vec<AnyReader>,
    /// The reader whose turn is next.
    turn: usize,
    wake: WakeSet,
    stop: Arc<AtomicBool>,
    end: Option<Instant>,
}

impl Readers {
    /// Opens all topics that `key` matches; those of another version are named and skipped. Reads for `limit` at most, and until
    /// SIGINT or SIGTERM.
    ///
    /// # Errors
    /// No such topic, none of this version, or one that cannot be opened.
    pub fn open(bus: &Bus, key: &KeyExpr, limit: Option<Duration>) -> anyhow::Result<Self> {
        let topics = find(bus, key)?;
        let (mut readers, mut foreign) = (Vec::new(), Vec::new());
        for info in &topics {
            match AnyReader::open(bus, &info.topic) {
                Err(error @ WireError::Incompatible { .. }) => foreign.push(error),
                opened => readers.push(opened?),
            }
        }
        if readers.is_empty()
            && let Some(error) = foreign.pop()
        {
            return Err(error.into());
        }
        for (skipped, error) in (1..).zip(&foreign) {
            tracing::warn!("skipped ({skipped} of {}): {error}", foreign.len());
        }
        let wake = WakeSet::new(readers.iter().map(|reader| reader as &dyn Wakeable));
        let stop = runtime::service::stop_flag()?;
        Ok(Self { readers, turn: 0, wake, stop, end: limit.map(|limit| Instant::now() + limit) })
    }

    /// The topics, in the order of the indices that [`Self::next`] returns.
    pub fn topics(&self) -> impl Iterator<Item = &Topic> {
        self.readers.iter().map(AnyReader::topic)
    }

    /// A waiting sample with the index of its topic. Topics take turns, so that a fast one does not hold up the others; of
    /// one topic the oldest sample comes first.
    ///
    /// # Errors
    /// A connection that broke.
    pub fn next(&mut self) -> Result<Option<(usize, AnySample)>, WireError> {
        for _ in 0..self.readers.len() {
            let index = self.turn;
            self.turn = (self.turn + 1) % self.readers.len();
            if let Some(sample) = self.readers[index].next()? {
                return Ok(Some((index, sample)));
            }
        }
        Ok(None)
    }

    /// Waits until a sample may be there, `at_most` so long. `false`: the time is over or a signal came.
    ///
    /// # Errors
    /// When the system refuses to wait.
    pub fn wait(&mut self, at_most: Duration) -> Result<bool, WireError> {
        let now = Instant::now();
        let left = self.end.map_or(at_most, |end| end.saturating_duration_since(now).min(at_most));
        if self.stop.load(Ordering::Relaxed) || self.end.is_some_and(|end| now >= end) {
            return Ok(false);
        }
        let woken = self.wake.wait(left)?;
        Ok(woken != Wake::Signal || !self.stop.load(Ordering::Relaxed))
    }
}
