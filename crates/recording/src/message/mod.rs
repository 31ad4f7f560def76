//! The JSON form of payloads: one object each, with a JSON schema, both derived from the payload's layout.
//!
//! Numbers are read back bit-identical: finite ones have enough digits, NaN (absent) is null, the others are the strings
//! `"Infinity"` and `"-Infinity"`. Boot ids and hashes are hexadecimal strings, because many viewers keep only 53 bits of an integer.

mod decode;
mod field;
mod gap;
mod json;
mod schema;

pub use decode::{decode, decode_field, decode_reading};
pub use field::FieldMessage;
pub use gap::{Gap, GapCounter, GapMessage, Observed};
pub use json::{Json, answer};

use serde::Serialize;
use wire::layout::{Layout, View};

use crate::writer::Channel;

/// A message of a recording.
pub trait Recorded {
    /// The message as JSON, into a reused buffer.
    fn encode(&self, out: &mut Vec<u8>);
}

/// The channel of a payload on `topic`.
pub fn channel(layout: &Layout, topic: &str) -> Channel {
    Channel { topic: topic.to_owned(), schema_name: layout.schema.to_owned(), schema: schema::of(layout) }
}

impl Recorded for Json<'_> {
    fn encode(&self, out: &mut Vec<u8>) {
        write(self, out);
    }
}

impl Recorded for View<'_> {
    fn encode(&self, out: &mut Vec<u8>) {
        Json::new(*self).encode(out);
    }
}

/// Writing numbers and strings into memory cannot fail.
fn write(message: &impl Serialize, out: &mut Vec<u8>) {
    out.clear();
    let _ = serde_json::to_writer(out, message);
}
