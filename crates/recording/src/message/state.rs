//! States, written for people and viewers: names instead of numbers where there are names.

use serde::Serialize;
use wire::layout::{flags, hex, regime, unpack_name};
use wire::{Outcome, State};

use super::{Recorded, number, schema};

/// A state as JSON. Fields as in [`State`].
#[derive(Debug, Clone, PartialEq, Serialize)]
#[allow(missing_docs)] // the wire's payload says what each is
pub struct StateMessage {
    pub seq: u64,
    pub sensor_seq: u64,
    pub t_sensor_ns: u64,
    pub t_publish_ns: u64,
    pub age_ns: u64,
    #[serde(serialize_with = "number::serialize")]
    pub pressure_mpa: f64,
    #[serde(serialize_with = "number::serialize")]
    pub gap_mm: f64,
    pub regime: &'static str,
    #[serde(serialize_with = "number::serialize")]
    pub contact_force_n: f64,
    #[serde(serialize_with = "number::single::serialize")]
    pub force_halfwidth_n: f32,
    #[serde(serialize_with = "number::serialize")]
    pub force_by_pressure_n_per_mpa: f64,
    #[serde(serialize_with = "number::serialize")]
    pub force_by_gap_n_per_mm: f64,
    #[serde(serialize_with = "number::serialize")]
    pub onset_pressure_mpa: f64,
    #[serde(serialize_with = "number::serialize")]
    pub measured_force_n: f64,
    #[serde(serialize_with = "number::single::serialize")]
    pub displacement_halfwidth_mm: f32,
    #[serde(serialize_with = "number::single::serialize")]
    pub von_mises_halfwidth_mpa: f32,
    #[serde(serialize_with = "number::single::serialize")]
    pub domain_distance: f32,
    pub domain_status: u32,
    pub outcome: &'static str,
    pub flags: Vec<&'static str>,
    pub flag_bits: u32,
    pub group_sizes: Vec<u8>,
    pub coefficients: Vec<f32>,
    pub actuator: String,
    pub model_hash: String,
    pub boot_id: String,
    pub sensor_boot_id: String,
}

impl From<&State> for StateMessage {
    fn from(state: &State) -> Self {
        Self {
            seq: state.seq,
            sensor_seq: state.sensor_seq,
            t_sensor_ns: state.t_sensor_ns,
            t_publish_ns: state.t_publish_ns,
            age_ns: state.age_ns,
            pressure_mpa: state.pressure_mpa,
            gap_mm: state.gap_mm,
            regime: regime::as_str(state.regime),
            contact_force_n: state.contact_force_n,
            force_halfwidth_n: state.force_halfwidth_n,
            force_by_pressure_n_per_mpa: state.force_by_pressure_n_per_mpa,
            force_by_gap_n_per_mm: state.force_by_gap_n_per_mm,
            onset_pressure_mpa: state.onset_pressure_mpa,
            measured_force_n: state.measured_force_n,
            displacement_halfwidth_mm: state.displacement_halfwidth_mm,
            von_mises_halfwidth_mpa: state.von_mises_halfwidth_mpa,
            domain_distance: state.domain_distance,
            domain_status: state.domain_status,
            outcome: Outcome::from_code(state.outcome).map_or("unknown", Outcome::as_str),
            flags: flags::names(state.flags).collect(),
            flag_bits: state.flags,
            group_sizes: state.group_sizes.iter().copied().take_while(|size| *size > 0).collect(),
            coefficients: state.coefficients().to_vec(),
            actuator: unpack_name(&state.actuator),
            model_hash: hex(&state.model_hash),
            boot_id: format!("{:016x}", state.boot_id),
            sensor_boot_id: format!("{:016x}", state.sensor_boot_id),
        }
    }
}

impl Recorded for StateMessage {
    const SCHEMA_NAME: &'static str = "softtwin.State";

    fn schema_json() -> String {
        schema::object(
            Self::SCHEMA_NAME,
            &[
                ("seq", "integer", "counts up by one per state within a run of the twin"),
                ("sensor_seq", "integer", "number of the reading the values stand for"),
                ("t_sensor_ns", "integer", "when that reading was taken, ns of the monotonic clock"),
                ("t_publish_ns", "integer", "when the state was sent, ns of the monotonic clock"),
                ("age_ns", "integer", "age of the reading when the state was sent, ns"),
                ("pressure_mpa", "number", "pressure of the reading, MPa"),
                ("gap_mm", "number", "gap of the reading, mm"),
                ("regime", "string", "free, contact or unknown"),
                ("contact_force_n", "number", "predicted contact force, N"),
                ("force_halfwidth_n", "number", "half width of the force's error bar, N"),
                ("force_by_pressure_n_per_mpa", "number", "gradient of the force by the pressure, N/MPa"),
                ("force_by_gap_n_per_mm", "number", "gradient of the force by the gap, N/mm"),
                ("onset_pressure_mpa", "number", "pressure of first contact at this gap, MPa"),
                ("measured_force_n", "number", "measured contact force, N; NaN without a load cell"),
                ("displacement_halfwidth_mm", "number", "half width of the displacement's error bar, mm"),
                ("von_mises_halfwidth_mpa", "number", "half width of the stress's error bar, MPa"),
                (
                    "domain_distance",
                    "number",
                    "signed distance to the edge of the sampled states, positive outside",
                ),
                ("domain_status", "integer", "0 inside, 1 near the edge, 2 outside the sampled states"),
                ("outcome", "string", "what became of the newest reading"),
                ("flags", "string[]", "set flags by name"),
                ("flag_bits", "integer", "the same flags as bits"),
                ("group_sizes", "integer[]", "coefficients of each group of fields"),
                ("coefficients", "number[]", "modal coefficients, group by group"),
                ("actuator", "string", "name of the actuator"),
                ("model_hash", "string", "first 16 bytes of the model file's hash, hexadecimal"),
                ("boot_id", "string", "the run of the twin, hexadecimal"),
                ("sensor_boot_id", "string", "the run of the bridge, hexadecimal"),
            ],
        )
    }
}
