//! Quality of service of every topic, in one place.
//!
//! The first program creates a topic with these settings, and all others must request the same: therefore all programs use
//! this module. One writer per topic (a second one is refused), the newest samples win (safe overflow: a slow reader loses its
//! oldest samples without effect on others), all memory is allocated at the writer's start.

use crate::TopicKind;

/// Settings of one kind of topic.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Qos {
    /// Readers at the same time.
    pub max_readers: usize,
    /// Samples that wait for a reader; older ones are overwritten.
    pub buffer: usize,
    /// Samples that a reader may hold at the same time.
    pub max_borrowed: usize,
    /// Samples a late reader gets at once.
    pub history: usize,
    /// Samples a writer may have on loan: one being filled, one ahead.
    pub max_loans: usize,
    /// Programs at the same time.
    pub max_nodes: usize,
}

/// Writers of a topic at the same time: two twins for one actuator would contradict each other.
pub(crate) const MAX_WRITERS: usize = 1;

/// Topics of a shared-memory domain; each has two services of iceoryx2. Every start and every listing reads the files of all.
pub const MAX_TOPICS: usize = 500;

/// The settings of a kind of topic.
pub const fn of(kind: TopicKind) -> Qos {
    match kind {
        // 2 s at 1 kHz for 150 kB: a recorder on a busy machine sleeps over hundreds of milliseconds and must lose nothing.
        TopicKind::Sensor => {
            Qos { max_readers: 16, buffer: 2048, max_borrowed: 4, history: 0, max_loans: 2, max_nodes: 64 }
        }
        // A full field has 500 kB: 16 of them let a reader sleep 16 ms at 1 kHz without a loss.
        TopicKind::Field => {
            Qos { max_readers: 24, buffer: 16, max_borrowed: 4, history: 1, max_loans: 2, max_nodes: 64 }
        }
        // As the readings, for some 1.2 MB.
        TopicKind::State | TopicKind::Estimate => {
            Qos { max_readers: 64, buffer: 2048, max_borrowed: 4, history: 1, max_loans: 2, max_nodes: 128 }
        }
        TopicKind::Health => {
            Qos { max_readers: 32, buffer: 8, max_borrowed: 4, history: 1, max_loans: 2, max_nodes: 128 }
        }
        // 2 s at 1 kHz.
        TopicKind::Valve => {
            Qos { max_readers: 16, buffer: 2048, max_borrowed: 4, history: 1, max_loans: 2, max_nodes: 64 }
        }
        TopicKind::Grasp => {
            Qos { max_readers: 32, buffer: 64, max_borrowed: 4, history: 1, max_loans: 2, max_nodes: 64 }
        }
        // Only the newest one counts; no history: a valve must not begin with what an earlier controller wanted.
        TopicKind::Command | TopicKind::Setpoint | TopicKind::Override | TopicKind::Target => {
            Qos { max_readers: 8, buffer: 16, max_borrowed: 4, history: 0, max_loans: 2, max_nodes: 32 }
        }
    }
}

/// Programs that may ask one twin at the same time.
pub const MAX_CLIENTS: usize = 32;
/// Questions that a program may have open with one twin at the same time.
pub const MAX_OPEN_QUESTIONS: usize = 2;
/// Programs around one twin's questions at the same time.
pub const MAX_QUERY_NODES: usize = 64;

impl Qos {
    /// Samples that can be in use at the same time: every reader's own borrowed ones, the waiting ones (all readers wait
    /// for the same newest `buffer` samples, because a full queue gives up its oldest), the history and the loans.
    ///
    /// iceoryx2 would reserve `max_readers * (buffer + max_borrowed) + history + loans`, which for a full field is 240 MB
    /// instead of 58 MB.
    pub const fn samples_in_use(&self) -> usize {
        self.buffer + self.max_readers * self.max_borrowed + self.history + self.max_loans + 1
    }
}
