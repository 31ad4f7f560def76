//! What all threads of the gateway share.

use anyhow::anyhow;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use wire::Domain;
use zenoh::Session;

/// Both sides of the gateway, and its counts.
#[derive(Clone)]
pub struct Link {
    /// The shared-memory domain.
    pub domain: Domain,
    /// The network.
    pub session: Session,
    /// What stands before every key on the network.
    pub prefix: Arc<str>,
    /// Set when the gateway is to end.
    pub stop: Arc<AtomicBool>,
    /// Set by the thread that this is for, each time it goes through its loop.
    pub is_alive: Arc<AtomicBool>,
    /// What was done.
    pub counters: Arc<Counters>,
}

/// Counts for the line in the log.
#[derive(Debug, Default)]
pub struct Counters {
    /// Messages sent, without fields.
    pub messages: AtomicU64,
    /// Samples that were published locally and never reached the gateway.
    pub lost: AtomicU64,
    /// Fields sent.
    pub fields: AtomicU64,
    /// Fields in whose place a newer one was sent, because there are more than `field_rate_hz` asks for.
    pub replaced: AtomicU64,
    /// Moments at `field_rate_hz` that passed before the gateway came to them.
    pub late_turns: AtomicU64,
    /// Longest time that one message or field took to be handed to the network, us.
    pub longest_send_us: AtomicU64,
    /// Requests answered.
    pub answers: AtomicU64,
    /// Requests that could not be answered.
    pub refusals: AtomicU64,
    /// Readings taken from the network.
    pub readings: AtomicU64,
    /// Readings from the network that were none, or could not be passed on.
    pub bad_readings: AtomicU64,
}

impl Link {
    /// The key of a local name on the network.
    pub fn key(&self, name: &str) -> String {
        format!("{}{name}", self.prefix)
    }

    /// Notes that this thread is alive; false when the gateway is to end.
    pub fn goes_on(&self) -> bool {
        self.is_alive.store(true, Ordering::Relaxed);
        !self.is_stopped()
    }

    /// Whether the gateway is to end.
    pub fn is_stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

impl Counters {
    /// The page for Prometheus.
    pub fn page(&self) -> String {
        let of = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        let values = [
            ("softtwin_gateway_messages", "Messages sent, without fields", of(&self.messages)),
            ("softtwin_gateway_fields", "Fields sent", of(&self.fields)),
            (
                "softtwin_gateway_fields_replaced",
                "Fields in whose place a newer one was sent",
                of(&self.replaced),
            ),
            ("softtwin_gateway_late_turns", "Field turns that passed", of(&self.late_turns)),
            ("softtwin_gateway_lost", "Samples that never reached the gateway", of(&self.lost)),
            ("softtwin_gateway_answers", "Requests answered", of(&self.answers)),
            ("softtwin_gateway_refusals", "Requests that could not be answered", of(&self.refusals)),
            ("softtwin_gateway_readings", "Readings taken from the network", of(&self.readings)),
            (
                "softtwin_gateway_bad_readings",
                "Readings from the network that were none",
                of(&self.bad_readings),
            ),
        ];
        runtime::metrics::gateway(&values, of(&self.longest_send_us) as f64 * 1e-6)
    }

    /// Everything in one line.
    pub fn line(&self) -> String {
        let of = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        format!(
            "{} messages and {} fields sent (longest send {:.1} ms), {} fields replaced by newer ones, {} field turns late, \
             {} samples lost before the gateway, {} requests answered, {} refused, {} readings taken, {} refused",
            of(&self.messages),
            of(&self.fields),
            of(&self.longest_send_us) as f64 * 1e-3,
            of(&self.replaced),
            of(&self.late_turns),
            of(&self.lost),
            of(&self.answers),
            of(&self.refusals),
            of(&self.readings),
            of(&self.bad_readings),
        )
    }
}

/// Counts up by one.
pub fn count(counter: &AtomicU64) {
    counter.fetch_add(1, Ordering::Relaxed);
}

/// Zenoh's errors as ours.
pub fn network<T>(result: zenoh::Result<T>) -> anyhow::Result<T> {
    result.map_err(|error| anyhow!("the network refuses: {error}"))
}
