//! What is missing in a recording, said in the recording.

use serde::Serialize;

use super::{Recorded, schema};
use crate::gaps::Gap;

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
    const SCHEMA_NAME: &'static str = "softtwin.Gap";

    fn schema_json() -> String {
        schema::object(
            Self::SCHEMA_NAME,
            &[
                ("topic", "string", "the topic in which samples are missing"),
                ("expected_seq", "integer", "the number that was expected"),
                ("found_seq", "integer", "the number that came"),
                ("missing", "integer", "how many are missing"),
            ],
        )
    }
}
