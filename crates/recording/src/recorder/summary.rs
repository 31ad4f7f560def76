//! Summary and errors of a recording.

use std::collections::BTreeMap;

use thiserror::Error;
use wire::WireError;

use crate::rotate::{DiskUse, RotateSummary};
use crate::writer::WriteError;
use wire::thread_group::ThreadEnded;

/// Error that ended a recording.
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

/// Summary of a recording.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct RecordSummary {
    /// Messages by topic.
    pub messages: BTreeMap<String, u64>,
    /// Samples that were published and never reached the recorder, by jumps in the sequence numbers.
    pub missing: u64,
    /// Messages that were received and dropped because the disk was too slow.
    pub dropped: u64,
    /// Current errors by topic, or `topics` if they cannot be listed; retried.
    pub errors: BTreeMap<String, String>,
    /// Topics of another version, with the difference; they are not recorded.
    pub skipped: BTreeMap<String, String>,
    /// Disk use of the series at the last flush.
    pub disk: DiskUse,
    /// Number of flushes; constant while the disk is blocked.
    pub flushes: u64,
    /// The files; empty until the end.
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

    /// Counts a flush and stores the disk use.
    pub(super) fn flushed(&mut self, disk: DiskUse) {
        self.disk = disk;
        self.flushes += 1;
    }

    /// Counts samples that never arrived; of one that came late -1.
    pub(super) fn add_missing(&mut self, samples: i64) {
        self.missing = self.missing.saturating_add_signed(samples);
    }

    /// Sets or clears the error of `what`.
    pub(super) fn set_error(&mut self, what: &str, cause: Option<&WireError>) {
        self.errors.remove(what);
        self.skipped.remove(what);
        if let Some(cause) = cause {
            let is_foreign = matches!(cause, WireError::Incompatible { .. });
            let notes = if is_foreign { &mut self.skipped } else { &mut self.errors };
            notes.insert(what.to_owned(), cause.to_string());
        }
    }
}
