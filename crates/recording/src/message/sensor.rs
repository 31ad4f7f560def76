//! Readings; the only message that is read back, for replays.

use serde::{Deserialize, Serialize};
use wire::SensorSample;

use super::{Recorded, number, schema};

/// A reading as JSON. Fields as in [`SensorSample`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs)] // the wire's payload says what each is
pub struct SensorMessage {
    pub seq: u64,
    pub t_sensor_ns: u64,
    #[serde(with = "number")]
    pub pressure_mpa: f64,
    #[serde(with = "number")]
    pub gap_mm: f64,
    #[serde(with = "number", default = "unknown")]
    pub measured_force_n: f64,
    #[serde(with = "number", default = "unknown")]
    pub t_trace_s: f64,
    #[serde(default)]
    pub status: u32,
    #[serde(default)]
    pub boot_id: String,
}

fn unknown() -> f64 {
    f64::NAN
}

impl From<&SensorSample> for SensorMessage {
    fn from(sample: &SensorSample) -> Self {
        Self {
            seq: sample.seq,
            t_sensor_ns: sample.t_sensor_ns,
            pressure_mpa: sample.pressure_mpa,
            gap_mm: sample.gap_mm,
            measured_force_n: sample.measured_force_n,
            t_trace_s: sample.t_trace_s,
            status: sample.status,
            boot_id: format!("{:016x}", sample.boot_id),
        }
    }
}

impl SensorMessage {
    /// Reads a message of a recording.
    ///
    /// # Errors
    /// What is missing or of the wrong kind, with line and column.
    pub fn decode(data: &[u8]) -> Result<Self, serde_json::Error> {
        serde_json::from_slice(data)
    }

    /// The reading, to the bit as it was recorded; a boot id that is no hexadecimal number becomes 0.
    pub fn sample(&self) -> SensorSample {
        SensorSample {
            boot_id: u64::from_str_radix(&self.boot_id, 16).unwrap_or(0),
            seq: self.seq,
            t_sensor_ns: self.t_sensor_ns,
            pressure_mpa: self.pressure_mpa,
            gap_mm: self.gap_mm,
            measured_force_n: self.measured_force_n,
            t_trace_s: self.t_trace_s,
            status: self.status,
            reserved: 0,
        }
    }
}

impl Recorded for SensorMessage {
    const SCHEMA_NAME: &'static str = "softtwin.Sensor";

    fn schema_json() -> String {
        schema::object(
            Self::SCHEMA_NAME,
            &[
                ("seq", "integer", "counts up by one per reading within a run of the bridge"),
                ("t_sensor_ns", "integer", "when the reading was taken, ns of the machine's monotonic clock"),
                ("pressure_mpa", "number", "gauge pressure in the chambers, MPa"),
                ("gap_mm", "number", "distance from the undeformed base to the plate, mm"),
                ("measured_force_n", "number", "measured contact force, N; NaN without a load cell"),
                ("t_trace_s", "number", "time in the source's own trace, s; NaN when there is none"),
                ("status", "integer", "0 good, else the sensor's own fault code"),
                ("boot_id", "string", "the run of the bridge, hexadecimal"),
            ],
        )
    }
}
