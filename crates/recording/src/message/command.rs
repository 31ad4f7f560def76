//! Pressure commands.

use serde::Serialize;
use wire::Command;

use super::{Recorded, number, schema};

/// A command as JSON. Fields as in [`Command`].
#[derive(Debug, Clone, PartialEq, Serialize)]
#[allow(missing_docs)] // the wire's payload says what each is
pub struct CommandMessage {
    pub seq: u64,
    pub t_sensor_ns: u64,
    pub t_publish_ns: u64,
    #[serde(serialize_with = "number::serialize")]
    pub pressure_mpa: f64,
    pub boot_id: String,
}

impl From<&Command> for CommandMessage {
    fn from(command: &Command) -> Self {
        Self {
            seq: command.seq,
            t_sensor_ns: command.t_sensor_ns,
            t_publish_ns: command.t_publish_ns,
            pressure_mpa: command.pressure_mpa,
            boot_id: format!("{:016x}", command.boot_id),
        }
    }
}

impl Recorded for CommandMessage {
    const SCHEMA_NAME: &'static str = "softtwin.Command";

    fn schema_json() -> String {
        schema::object(
            Self::SCHEMA_NAME,
            &[
                ("seq", "integer", "counts up by one per command within a run of the controller"),
                (
                    "t_sensor_ns",
                    "integer",
                    "when the reading it answers was taken, ns of the monotonic clock; 0: none",
                ),
                ("t_publish_ns", "integer", "when it was sent, ns of the monotonic clock"),
                ("pressure_mpa", "number", "gauge pressure that is wanted, MPa"),
                ("boot_id", "string", "the run of the controller, hexadecimal"),
            ],
        )
    }
}
