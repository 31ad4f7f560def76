//! What is missing in a recording, noted in the recording.

use serde::Serialize;
use serde_json::json;

use super::{Recorded, schema, write};
use crate::gaps::Gap;
use crate::writer::{Channel, Schema};

/// A jump in the sequence numbers of a topic.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct GapMessage {
    /// The topic.
    pub topic: String,
    /// The number that was expected.
    pub expected_seq: u64,
    /// The number that came.
    pub found_seq: u64,
    /// How many are missing.
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
            schema: Schema::Json(schema::object(name, properties)),
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
