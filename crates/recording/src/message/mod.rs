//! What a recording says: one JSON object for each payload of the wire, with a JSON schema.
//!
//! Numbers survive unchanged: finite ones are written with as many digits as they need to be read back to the same bits,
//! the others as the texts `"NaN"`, `"Infinity"`, `"-Infinity"`. Run numbers and hashes are hexadecimal texts, because
//! many viewers keep only 53 bits of an integer.

mod answer;
mod command;
mod field;
mod gap;
mod grasp;
mod health;
mod number;
mod schema;
mod sensor;
mod state;

pub use answer::AnswerMessage;
pub use command::CommandMessage;
pub use field::{FieldMessage, field_values};
pub use gap::GapMessage;
pub use grasp::GraspMessage;
pub use health::HealthMessage;
pub use sensor::SensorMessage;
pub use state::StateMessage;

use serde::Serialize;

use crate::writer::Channel;

/// A payload's JSON form and where it belongs.
pub trait Recorded: Serialize {
    /// Name of the schema, such as `softtwin.State`.
    const SCHEMA_NAME: &'static str;

    /// JSON schema of the message: flat, with one description a property.
    fn schema_json() -> String;

    /// The channel of this kind of message on `topic`.
    fn channel(topic: &str) -> Channel {
        Channel {
            topic: topic.to_owned(),
            schema_name: Self::SCHEMA_NAME.to_owned(),
            schema_json: Self::schema_json(),
        }
    }

    /// The message as JSON, into a reused buffer.
    fn encode(&self, out: &mut Vec<u8>) {
        out.clear();
        // Writing plain numbers and texts into memory cannot fail; a message cut short would fail to parse, not lie.
        let _ = serde_json::to_writer(out, self);
    }
}
