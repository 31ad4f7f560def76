//! How a twin is doing, once a second.

use iceoryx2::prelude::ZeroCopySend;

/// Slots for counters, one per [`crate::Outcome`] with room for later ones.
pub const OUTCOME_SLOTS: usize = 24;

/// Counters since the start of the twin and latencies of the last interval. `received` is the sum of all outcomes.
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend)]
#[type_name("softtwin.Health.v2")]
#[repr(C)]
pub struct Health {
    /// [`super::VERSION`].
    pub layout_version: u32,
    /// Bits of [`super::flags`] as in the newest state.
    pub flags: u32,
    /// First 16 bytes of the model file's hash.
    pub model_hash: [u8; 16],
    /// The run of the twin.
    pub boot_id: u64,
    /// Counts up by one per health sample, beginning at 1.
    pub seq: u64,
    /// When it was sent.
    pub t_publish_ns: u64,
    /// Time since the twin started, ns.
    pub uptime_ns: u64,
    /// The run of the bridge last heard of; 0: none yet.
    pub sensor_boot_id: u64,
    /// Readings taken from the sensor topic.
    pub received: u64,
    /// Readings that never arrived, by gaps in the sequence numbers.
    pub missed: u64,
    /// Restarts of the bridge seen.
    pub sensor_restarts: u64,
    /// Times that the deadline passed without a usable reading.
    pub deadline_misses: u64,
    /// Fields sent over all node sets.
    pub fields_sent: u64,
    /// States sent.
    pub states_sent: u64,
    /// Readings whose field was sent later than the configured limit after their stamp.
    pub late: u64,
    /// Events and lines that are missing in the log: the reporter was behind, or a line could not be written.
    pub log_lost: u64,
    /// Age of the newest good reading, ns.
    pub age_ns: u64,
    /// Readings per second over the last interval.
    pub rate_hz: f64,
    /// From sensor stamp to sent, over the last interval, ns: half of the readings were faster.
    pub latency_p50_ns: u64,
    /// 99 of 100 were faster.
    pub latency_p99_ns: u64,
    /// The slowest.
    pub latency_max_ns: u64,
    /// From taking the reading to sent, over the last interval, ns: half of the readings were faster.
    pub compute_p50_ns: u64,
    /// 99 of 100 were faster.
    pub compute_p99_ns: u64,
    /// The slowest.
    pub compute_max_ns: u64,
    /// Readings by outcome, indexed by [`crate::Outcome::code`].
    pub outcomes: [u64; OUTCOME_SLOTS],
    /// Name of the actuator, zero-padded.
    pub actuator: [u8; 32],
}

super::layout!(Health, 416, {
    layout_version: 0,
    flags: 4,
    model_hash: 8,
    boot_id: 24,
    seq: 32,
    t_publish_ns: 40,
    uptime_ns: 48,
    sensor_boot_id: 56,
    received: 64,
    missed: 72,
    sensor_restarts: 80,
    deadline_misses: 88,
    fields_sent: 96,
    states_sent: 104,
    late: 112,
    log_lost: 120,
    age_ns: 128,
    rate_hz: 136,
    latency_p50_ns: 144,
    latency_p99_ns: 152,
    latency_max_ns: 160,
    compute_p50_ns: 168,
    compute_p99_ns: 176,
    compute_max_ns: 184,
    outcomes: 192,
    actuator: 384,
});

const _: () = assert!(crate::Outcome::ALL.len() <= OUTCOME_SLOTS);

impl Health {
    /// The counter of one outcome.
    pub fn count(&self, outcome: crate::Outcome) -> u64 {
        self.outcomes.get(outcome.code() as usize).copied().unwrap_or(0)
    }
}

/// Health with all counters at zero.
impl Default for Health {
    fn default() -> Self {
        Self {
            layout_version: super::VERSION,
            flags: super::flags::NO_DATA,
            model_hash: [0; 16],
            boot_id: 0,
            seq: 0,
            t_publish_ns: 0,
            uptime_ns: 0,
            sensor_boot_id: 0,
            received: 0,
            missed: 0,
            sensor_restarts: 0,
            deadline_misses: 0,
            fields_sent: 0,
            states_sent: 0,
            late: 0,
            log_lost: 0,
            age_ns: 0,
            rate_hz: 0.0,
            latency_p50_ns: 0,
            latency_p99_ns: 0,
            latency_max_ns: 0,
            compute_p50_ns: 0,
            compute_p99_ns: 0,
            compute_max_ns: 0,
            outcomes: [0; OUTCOME_SLOTS],
            actuator: [0; 32],
        }
    }
}
