//! What was recorded, and why recording ended.

use std::collections::BTreeMap;

use thiserror::Error;
use wire::WireError;

use crate::rotate::{DiskUse, RotateSummary};
use crate::thread_group::ThreadEnded;
use crate::writer::WriteError;

/// Why recording ended early.
#[derive(Debug, Error)]
pub enum RecordError {
    /// The shared memory.
    #[error(transparent)]
    Wire(#[from] WireError),
    /// The disk.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// A thread of the recorder is gone.
    #[error(transparent)]
    Thread(#[from] ThreadEnded),
    /// A thread could not be started.
    #[error("cannot start a thread of the recorder: {0}; check the limits of the system (ulimit -u)")]
    Start(std::io::Error),
}

/// What was recorded.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct RecordSummary {
    /// Messages by topic.
    pub messages: BTreeMap<String, u64>,
    /// Samples that were published and never reached the recorder, by jumps in the sequence numbers.
    pub missing: u64,
    /// Messages that were received and dropped because the disk was too slow.
    pub dropped: u64,
    /// What cannot be recorded at the moment, and why: by topic, or `topics` when they cannot be listed. Tried again and again.
    pub troubles: BTreeMap<String, String>,
    /// Topics that a program of another version made, and what is different; they are not recorded.
    pub skipped: BTreeMap<String, String>,
    /// What the series takes of the disk, since the last flush.
    pub disk: DiskUse,
    /// Flushes so far: they stand still when the disk hangs.
    pub flushes: u64,
    /// The files; known at the end.
    pub files: RotateSummary,
}

impl RecordSummary {
    /// Counts a message that was queued, or dropped because the queue was full.
    pub(super) fn count(&mut self, topic: &str, is_queued: bool) {
        match self.messages.get_mut(topic) {
            _ if !is_queued => self.dropped += 1,
            Some(count) => *count += 1,
            None => _ = self.messages.insert(topic.to_owned(), 1),
        }
    }

    /// Everything so far is on the disk, which is used like this.
    pub(super) fn flushed(&mut self, disk: DiskUse) {
        self.disk = disk;
        self.flushes += 1;
    }

    /// Counts samples that never arrived.
    pub(super) fn add_missing(&mut self, samples: u64) {
        self.missing = self.missing.saturating_add(samples);
    }

    /// Notes why `what` cannot be recorded, or that it can.
    pub(super) fn set_trouble(&mut self, what: &str, cause: Option<&WireError>) {
        self.troubles.remove(what);
        self.skipped.remove(what);
        if let Some(cause) = cause {
            let is_foreign = matches!(cause, WireError::Incompatible { .. });
            let notes = if is_foreign { &mut self.skipped } else { &mut self.troubles };
            notes.insert(what.to_owned(), cause.to_string());
        }
    }
}
