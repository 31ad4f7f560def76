//! How a twin is doing, once a second.

use super::payload::payload;
use super::{LAYOUT_VERSION, Outcome, flags};

/// Slots for counters, one per [`Outcome`] and some for later ones.
pub const OUTCOME_SLOTS: usize = 24;

payload! {
    /// Counters since the start of the twin and latencies of the last interval. `received` is the sum of all outcomes.
    Health "softtwin.Health" {
        /// Layout version.
        layout_version: u32 = LAYOUT_VERSION, "";
        /// Set flags as in the newest state.
        flags: u32 = flags::NO_DATA, "", Show::Flags(flags::ALL);
        /// First 16 bytes of the model file's hash.
        model_hash: [u8; 16] = [0; 16], "", Show::Hex;
        /// The run of the twin.
        boot_id: u64 = 0, "", Show::Hex;
        /// Counts up by one per health sample, beginning at 1.
        seq: u64 = 0, "";
        /// When it was sent.
        t_publish_ns: u64 = 0, "ns";
        /// Time since the twin started.
        uptime_ns: u64 = 0, "ns";
        /// The run of the bridge that sent the newest reading; 0: none yet.
        sensor_boot_id: u64 = 0, "", Show::Hex;
        /// Readings taken from the sensor topic; the sum of all outcomes.
        received: u64 = 0, "";
        /// Readings that never arrived, by gaps in the sequence numbers.
        missed: u64 = 0, "";
        /// Restarts of the bridge seen.
        sensor_restarts: u64 = 0, "";
        /// Times that the deadline passed without a usable reading.
        deadline_misses: u64 = 0, "";
        /// Fields sent over all node sets.
        fields_sent: u64 = 0, "";
        /// States sent.
        states_sent: u64 = 0, "";
        /// Readings whose field was sent later than the configured limit after their stamp.
        late: u64 = 0, "";
        /// Events and lines that are missing in the log: the reporter was behind, or a line could not be written.
        log_lost: u64 = 0, "";
        /// Age of the newest good reading.
        age_ns: u64 = 0, "ns";
        /// Readings per second over the last interval.
        rate_hz: f64 = 0.0, "Hz";
        /// From sensor stamp to sent, over the last interval: median.
        latency_p50_ns: u64 = 0, "ns";
        /// From sensor stamp to sent, over the last interval: 99th percentile.
        latency_p99_ns: u64 = 0, "ns";
        /// From sensor stamp to sent, over the last interval: slowest.
        latency_max_ns: u64 = 0, "ns";
        /// From taking the reading to sent, over the last interval: median.
        compute_p50_ns: u64 = 0, "ns";
        /// From taking the reading to sent, over the last interval: 99th percentile.
        compute_p99_ns: u64 = 0, "ns";
        /// From taking the reading to sent, over the last interval: slowest.
        compute_max_ns: u64 = 0, "ns";
        /// Readings by outcome, indexed by the outcome's number.
        outcomes: [u64; OUTCOME_SLOTS] = [0; OUTCOME_SLOTS], "", Show::PerCode(Outcome::CODES);
        /// Name of the actuator, zero-padded.
        actuator: [u8; 32] = [0; 32], "", Show::Name;
    }
    json [
        seq, t_publish_ns, uptime_ns, received, missed, sensor_restarts, deadline_misses, fields_sent, states_sent, late,
        log_lost, age_ns, rate_hz, latency_p50_ns, latency_p99_ns, latency_max_ns, compute_p50_ns, compute_p99_ns,
        compute_max_ns, outcomes, flags, actuator, model_hash, boot_id,
    ]
}

const _: () = assert!(Outcome::ALL.len() <= OUTCOME_SLOTS);

impl Health {
    /// The counter of one outcome.
    pub fn count(&self, outcome: Outcome) -> u64 {
        self.outcomes.get(outcome.code() as usize).copied().unwrap_or(0)
    }
}
