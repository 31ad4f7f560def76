//! Gaps in the sequence numbers of a topic, and the messages that note them in a recording.

use serde::Serialize;
use serde_json::json;
use wire::{Arrival, Arrivals, Stamp};

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
    last: Option<(u64, Arrivals)>,
}

/// Effect of a sample on the count of the missing ones.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Observed {
    /// The gap in front of it, if there is one.
    pub gap: Option<Gap>,
    /// Change of the number of missing samples: that of the gap, or -1 for one that was missing and came late.
    pub missing: i64,
}

impl GapCounter {
    /// Notes a sample.
    pub fn observe(&mut self, stamp: Stamp) -> Observed {
        match &mut self.last {
            Some((boot_id, arrivals)) if *boot_id == stamp.boot_id => {
                let arrival = arrivals.take(stamp.seq);
                let gap = match arrival {
                    Arrival::New { missing } if missing > 0 => {
                        Some(Gap { expected_seq: stamp.seq - missing, found_seq: stamp.seq })
                    }
                    _ => None,
                };
                Observed { gap, missing: arrival.lost() }
            }
            last => {
                *last = Some((stamp.boot_id, Arrivals::new(stamp.seq)));
                Observed::default()
            }
        }
    }
}

/// A gap as a message.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct GapMessage {
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
