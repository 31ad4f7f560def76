//! Gaps in the sequence numbers of a topic, and the messages that note them in a recording.

use serde::Serialize;
use serde_json::json;
use wire::Stamp;

use super::{Recorded, schema, write};
use crate::writer::Channel;

/// Published samples that never arrived.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Gap {
    /// The number that was expected.
    pub expected_seq: u64,
    /// The number that came.
    pub found_seq: u64,
}

impl Gap {
    /// Number of missing samples.
    pub fn missing(self) -> u64 {
        self.found_seq.saturating_sub(self.expected_seq)
    }
}

/// Follows the sequence numbers of one topic. A new publisher (another boot id) starts a new count.
#[derive(Debug, Default)]
pub struct GapCounter {
    last: Option<(u64, u64)>,
}

impl GapCounter {
    /// Notes a sample; returns the gap in front of it, if there is one.
    pub fn observe(&mut self, stamp: Stamp) -> Option<Gap> {
        let (boot_id, last_seq) = self.last.replace((stamp.boot_id, stamp.seq))?;
        let gap = Gap { expected_seq: last_seq.saturating_add(1), found_seq: stamp.seq };
        (boot_id == stamp.boot_id && gap.missing() > 0).then_some(gap)
    }
}

/// A gap as a message.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct GapMessage {
    /// The topic.
    pub topic: String,
    /// The number that was expected.
    pub expected_seq: u64,
    /// The number that came.
    pub found_seq: u64,
    /// Number of missing samples.
    pub missing: u64,
}

impl GapMessage {
    /// Where gaps are recorded.
    pub const TOPIC: &'static str = "softtwin/recorder/gap";

    /// The channel of these messages.
    pub fn channel() -> Channel {
        let name = "softtwin.Gap";
        let properties = [
            ("topic", "string", "The topic in which samples are missing."),
            ("expected_seq", "integer", "The number that was expected."),
            ("found_seq", "integer", "The number that came."),
            ("missing", "integer", "How many are missing."),
        ];
        let properties =
            properties.map(|(name, kind, meaning)| (name, json!({"type": kind, "description": meaning})));
        Channel {
            topic: Self::TOPIC.to_owned(),
            schema_name: name.to_owned(),
            schema: schema::object(name, properties),
        }
    }

    /// The message of one gap.
    pub fn new(topic: &str, gap: Gap) -> Self {
        Self {
            topic: topic.to_owned(),
            expected_seq: gap.expected_seq,
            found_seq: gap.found_seq,
            missing: gap.missing(),
        }
    }
}

impl Recorded for GapMessage {
    fn encode(&self, out: &mut Vec<u8>) {
        write(self, out);
    }
}

#[cfg(test)]
#[path = "../../tests/unit/gaps.rs"]
mod tests;
