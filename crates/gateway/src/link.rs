//! What all threads of the gateway share: shared memory, the Zenoh session, counts, and whether each thread is alive.

use anyhow::anyhow;
use runtime::service::Watchdog;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use wire::Domain;
use zenoh::Session;

#[derive(Clone)]
pub struct Link {
    pub domain: Domain,
    pub session: Session,
    /// Prefix of every key on the network.
    pub prefix: Arc<str>,
    /// Set when the gateway is to end.
    pub stop: Arc<AtomicBool>,
    /// Set by the owning thread in each iteration of its loop.
    pub is_alive: Arc<AtomicBool>,
    pub counters: Arc<Counters>,
}

/// Counts for the log and the metrics.
#[derive(Debug, Default)]
pub struct Counters {
    pub messages: AtomicU64,
    /// Samples published locally that never reached the gateway.
    pub lost: AtomicU64,
    pub fields: AtomicU64,
    /// Fields replaced by newer ones, since more arrive than `field_rate_hz`.
    pub replaced: AtomicU64,
    /// Periods of `field_rate_hz` that passed unused.
    pub late_periods: AtomicU64,
    /// Longest time of handing one message or field to the network, us.
    pub longest_send_us: AtomicU64,
    pub answers: AtomicU64,
    pub refusals: AtomicU64,
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

/// The last error of something that is tried again and again, so that each error is logged once.
#[derive(Debug, Default)]
pub struct LastError(Option<String>);

impl LastError {
    pub fn log(&mut self, error: String) {
        if self.0.as_ref() != Some(&error) {
            tracing::warn!("{error}");
            self.0 = Some(error);
        }
    }

    /// To be called after a success: the same error is logged again.
    pub fn clear(&mut self) {
        self.0 = None;
    }
}

/// Counts up by one.
pub fn count(counter: &AtomicU64) {
    counter.fetch_add(1, Ordering::Relaxed);
}

pub fn network<T>(result: zenoh::Result<T>) -> anyhow::Result<T> {
    result.map_err(|error| anyhow!("network error: {error}"))
}

/// Counts the rounds in which every thread completed an iteration, and feeds the watchdog: one blocked thread lets the gateway
/// restart.
#[derive(Debug)]
pub struct Liveness {
    watchdog: Watchdog,
    rounds: u64,
    threads: Vec<Arc<AtomicBool>>,
}

impl Liveness {
    pub fn from_env() -> Self {
        Self { watchdog: Watchdog::from_env(), rounds: 0, threads: Vec::new() }
    }

    pub fn forget_threads(&mut self) {
        self.threads.clear();
    }

    /// Adds a thread: the flag that it sets in each iteration.
    pub fn add_thread(&mut self) -> Arc<AtomicBool> {
        let is_alive = Arc::new(AtomicBool::new(false));
        self.threads.push(is_alive.clone());
        is_alive
    }

    /// Feeds the watchdog when it is due and a round is complete.
    pub fn feed(&mut self) {
        let rounds = self.count();
        self.watchdog.feed(rounds);
    }

    fn count(&mut self) -> u64 {
        if self.threads.iter().all(|is_alive| is_alive.load(Ordering::Relaxed)) {
            self.threads.iter().for_each(|is_alive| is_alive.store(false, Ordering::Relaxed));
            self.rounds += 1;
        }
        self.rounds
    }
}

#[cfg(test)]
#[path = "../tests/unit/liveness.rs"]
mod tests;
