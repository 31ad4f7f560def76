//! State shared by all threads of the gateway.

use anyhow::anyhow;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use wire::Domain;
use zenoh::Session;

/// Shared memory, network and counts.
#[derive(Clone)]
pub struct Link {
    /// The shared-memory domain.
    pub domain: Domain,
    /// The Zenoh session.
    pub session: Session,
    /// Prefix of every key on the network.
    pub prefix: Arc<str>,
    /// Set when the gateway is to end.
    pub stop: Arc<AtomicBool>,
    /// Set by the owning thread in each iteration of its loop.
    pub is_alive: Arc<AtomicBool>,
    /// Counts.
    pub counters: Arc<Counters>,
}

/// Counts for the log and the metrics.
#[derive(Debug, Default)]
pub struct Counters {
    /// Messages sent, without fields.
    pub messages: AtomicU64,
    /// Samples published locally that never reached the gateway.
    pub lost: AtomicU64,
    /// Fields sent.
    pub fields: AtomicU64,
    /// Fields replaced by newer ones, since more arrive than `field_rate_hz`.
    pub replaced: AtomicU64,
    /// Periods of `field_rate_hz` that passed unused.
    pub late_periods: AtomicU64,
    /// Longest time of handing one message or field to the network, us.
    pub longest_send_us: AtomicU64,
    /// Requests answered.
    pub answers: AtomicU64,
    /// Requests that could not be answered.
    pub refusals: AtomicU64,
    /// Readings taken from the network.
    pub readings: AtomicU64,
    /// Messages from the network that are not readings, or could not be published.
    pub bad_readings: AtomicU64,
}

impl Link {
    /// The key of a local name on the network.
    pub fn key(&self, name: &str) -> String {
        format!("{}{name}", self.prefix)
    }

    /// Marks this thread as alive; false when the gateway is to end.
    pub fn is_running(&self) -> bool {
        self.is_alive.store(true, Ordering::Relaxed);
        !self.is_stopped()
    }

    /// Whether the gateway is to end.
    pub fn is_stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

impl Counters {
    /// Name, description and value of each count.
    fn values(&self) -> [(&'static str, &'static str, u64); 8] {
        let value = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        [
            ("softtwin_gateway_messages", "Messages sent, without fields", value(&self.messages)),
            ("softtwin_gateway_fields", "Fields sent", value(&self.fields)),
            ("softtwin_gateway_fields_replaced", "Fields replaced by newer ones", value(&self.replaced)),
            ("softtwin_gateway_late_periods", "Field periods that passed unused", value(&self.late_periods)),
            ("softtwin_gateway_answers", "Requests answered", value(&self.answers)),
            ("softtwin_gateway_refusals", "Requests refused", value(&self.refusals)),
            ("softtwin_gateway_readings", "Readings taken from the network", value(&self.readings)),
            ("softtwin_gateway_bad_readings", "Readings refused", value(&self.bad_readings)),
        ]
    }

    /// The counts in the format of Prometheus.
    pub fn metrics(&self) -> String {
        let longest_us = self.longest_send_us.load(Ordering::Relaxed);
        let lost = self.lost.load(Ordering::Relaxed);
        runtime::metrics::gateway(&self.values(), lost, longest_us as f64 * 1e-6)
    }

    /// The counts in one line: `messages=12 fields=3 ...`.
    pub fn line(&self) -> String {
        let short = |name: &'static str| name.trim_start_matches("softtwin_gateway_");
        let counts = self.values().map(|(name, _, value)| format!("{}={value}", short(name)));
        let longest_us = self.longest_send_us.load(Ordering::Relaxed);
        let lost = self.lost.load(Ordering::Relaxed);
        format!("{} lost={lost} longest_send_us={longest_us}", counts.join(" "))
    }
}

/// Counts up by one.
pub fn count(counter: &AtomicU64) {
    counter.fetch_add(1, Ordering::Relaxed);
}

/// Converts Zenoh's errors.
pub fn network<T>(result: zenoh::Result<T>) -> anyhow::Result<T> {
    result.map_err(|error| anyhow!("network error: {error}"))
}
