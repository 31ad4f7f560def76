//! Health, with the outcomes by name.

use std::collections::BTreeMap;

use serde::Serialize;
use wire::layout::{flags, hex, unpack_name};
use wire::{Health, Outcome};

use super::{Recorded, number, schema};

/// Health as JSON. Fields as in [`Health`].
#[derive(Debug, Clone, PartialEq, Serialize)]
#[allow(missing_docs)] // the wire's payload says what each is
pub struct HealthMessage {
    pub seq: u64,
    pub t_publish_ns: u64,
    pub uptime_ns: u64,
    pub received: u64,
    pub missed: u64,
    pub sensor_restarts: u64,
    pub deadline_misses: u64,
    pub fields_sent: u64,
    pub states_sent: u64,
    pub late: u64,
    pub log_lost: u64,
    pub age_ns: u64,
    #[serde(serialize_with = "number::serialize")]
    pub rate_hz: f64,
    pub latency_p50_ns: u64,
    pub latency_p99_ns: u64,
    pub latency_max_ns: u64,
    pub compute_p50_ns: u64,
    pub compute_p99_ns: u64,
    pub compute_max_ns: u64,
    pub outcomes: BTreeMap<&'static str, u64>,
    pub flags: Vec<&'static str>,
    pub actuator: String,
    pub model_hash: String,
    pub boot_id: String,
}

impl From<&Health> for HealthMessage {
    fn from(health: &Health) -> Self {
        Self {
            seq: health.seq,
            t_publish_ns: health.t_publish_ns,
            uptime_ns: health.uptime_ns,
            received: health.received,
            missed: health.missed,
            sensor_restarts: health.sensor_restarts,
            deadline_misses: health.deadline_misses,
            fields_sent: health.fields_sent,
            states_sent: health.states_sent,
            late: health.late,
            log_lost: health.log_lost,
            age_ns: health.age_ns,
            rate_hz: health.rate_hz,
            latency_p50_ns: health.latency_p50_ns,
            latency_p99_ns: health.latency_p99_ns,
            latency_max_ns: health.latency_max_ns,
            compute_p50_ns: health.compute_p50_ns,
            compute_p99_ns: health.compute_p99_ns,
            compute_max_ns: health.compute_max_ns,
            outcomes: Outcome::ALL.iter().map(|outcome| (outcome.as_str(), health.count(*outcome))).collect(),
            flags: flags::names(health.flags).collect(),
            actuator: unpack_name(&health.actuator),
            model_hash: hex(&health.model_hash),
            boot_id: format!("{:016x}", health.boot_id),
        }
    }
}

impl Recorded for HealthMessage {
    const SCHEMA_NAME: &'static str = "softtwin.Health";

    fn schema_json() -> String {
        schema::object(
            Self::SCHEMA_NAME,
            &[
                ("seq", "integer", "counts up by one per health sample"),
                ("t_publish_ns", "integer", "when it was sent, ns of the monotonic clock"),
                ("uptime_ns", "integer", "time since the twin started, ns"),
                ("received", "integer", "readings taken; the sum of all outcomes"),
                ("missed", "integer", "readings that never arrived"),
                ("sensor_restarts", "integer", "restarts of the bridge seen"),
                ("deadline_misses", "integer", "times the deadline passed without a usable reading"),
                ("fields_sent", "integer", "fields sent over all node sets"),
                ("states_sent", "integer", "states sent"),
                ("late", "integer", "fields sent later than the configured limit"),
                ("log_lost", "integer", "log events lost"),
                ("age_ns", "integer", "age of the newest good reading, ns"),
                ("rate_hz", "number", "readings per second over the last interval"),
                ("latency_p50_ns", "integer", "sensor stamp to sent, median, ns"),
                ("latency_p99_ns", "integer", "sensor stamp to sent, 99th percentile, ns"),
                ("latency_max_ns", "integer", "sensor stamp to sent, slowest, ns"),
                ("compute_p50_ns", "integer", "reading taken to sent, median, ns"),
                ("compute_p99_ns", "integer", "reading taken to sent, 99th percentile, ns"),
                ("compute_max_ns", "integer", "reading taken to sent, slowest, ns"),
                ("outcomes", "object", "readings by outcome"),
                ("flags", "string[]", "set flags by name"),
                ("actuator", "string", "name of the actuator"),
                ("model_hash", "string", "first 16 bytes of the model file's hash, hexadecimal"),
                ("boot_id", "string", "the run of the twin, hexadecimal"),
            ],
        )
    }
}
