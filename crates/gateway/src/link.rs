//! What all threads of the gateway share: shared memory, the Zenoh session, counts, and whether each thread is alive.

use crate::config::{Config, Endpoint, Mode, list};
use anyhow::anyhow;
use runtime::address_limit::AddressLimit;
use runtime::service::{self, Watchdog};
use serde_json::{Value, json};
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread;
use std::time::{Duration, Instant};
use wire::Domain;
use zenoh::{Session, Wait};

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

/// Longest time that a state waits for a blocked subscriber. Then it is disconnected, and the others get what the topics' buffers
/// (2 s at 1 kHz) hold meanwhile.
const SLOWEST_READER: Duration = Duration::from_secs(1);
/// Capacity of the queues of states and of fields, in batches of 64 kB: 1 MB, two whole fields.
const QUEUE_BATCHES: u32 = 16;

/// Time within which a connection must have shown what it is; then it is closed.
const LOGIN: Duration = Duration::from_secs(2);
/// Connections within that time; more are closed at once. Below the usual limit of open files, 1,024.
const MOST_LOGINS: u32 = 500;
/// Those from one address; more close its oldest ones.
const MOST_LOGINS_OF_ADDRESS: usize = 100;
/// Interval of its log line.
const SAY_EVERY: Duration = Duration::from_secs(60);
/// Interval of that limit.
const LIMIT_EVERY: Duration = Duration::from_millis(100);

/// Opens the session; `None` if `stop` was set first (a client waits here for its router).
///
/// # Errors
/// When a port is taken, or a certificate cannot be used.
pub fn open_session(
    config: &Config,
    stop: &AtomicBool,
    liveness: &mut Liveness,
) -> anyhow::Result<Option<Session>> {
    let settings = zenoh::Config::from_json5(&settings(config).to_string())
        .map_err(|error| anyhow!("Zenoh refuses the configuration: {error}"))?;
    let opening = thread::Builder::new().name("open".into()).spawn(|| zenoh::open(settings).wait())?;
    let mut patience = Some(Instant::now() + Duration::from_secs(1));
    while !opening.is_finished() {
        if stop.load(Ordering::Relaxed) {
            return Ok(None);
        }
        if patience.take_if(|until| Instant::now() >= *until).is_some() {
            let status = format!("no answer from {} yet; waiting", list(&config.connect));
            tracing::warn!("{status}");
            // The router may take hours to start: the service manager must not end the gateway meanwhile.
            service::notify_started(&status);
        }
        if patience.is_none() {
            liveness.feed();
        }
        thread::sleep(Duration::from_millis(20));
    }
    match opening.join() {
        Ok(Ok(session)) => Ok(Some(session)),
        Ok(Err(error)) => {
            Err(anyhow!("cannot join the network: {error}; is the port taken by another program?"))
        }
        Err(_) => Err(anyhow!("Zenoh panicked while joining the network")),
    }
}

/// Keeps the connections that log in from one address within their limit, which Zenoh does not have.
///
/// # Errors
/// The descriptors of this process cannot be listed.
pub fn limit_addresses(link: &Link, ports: Vec<u16>) -> io::Result<()> {
    let mut limit = AddressLimit::new(ports, MOST_LOGINS_OF_ADDRESS, LOGIN);
    let mut said = None;
    while !link.is_stopped() {
        link.is_alive.store(true, Ordering::Relaxed);
        let closed = limit.apply()?;
        if closed > 0 && said.is_none_or(|at: Instant| at.elapsed() > SAY_EVERY) {
            said = Some(Instant::now());
            tracing::warn!(
                "{closed} connections closed: more than {MOST_LOGINS_OF_ADDRESS} log in from one address"
            );
        }
        thread::sleep(LIMIT_EVERY);
    }
    Ok(())
}

/// The settings of Zenoh. Discovery is off: the configuration names every connection.
fn settings(config: &Config) -> Value {
    let strings = |endpoints: &[Endpoint]| {
        endpoints.iter().map(|endpoint| json!(endpoint.to_string())).collect::<Vec<Value>>()
    };
    let mode = match config.mode {
        Mode::Peer => "peer",
        Mode::Client => "client",
        Mode::Router => "router",
    };
    json!({
        "mode": mode,
        "listen": { "endpoints": strings(&config.listen) },
        "connect": {
            "endpoints": strings(&config.connect),
            "timeout_ms": -1,
            "exit_on_failure": false,
            "retry": { "period_init_ms": 200, "period_max_ms": 4000, "period_increase_factor": 2.0 },
        },
        "scouting": {
            "multicast": { "enabled": false },
            // Announces connections, so that no message arrives twice; opens none.
            "gossip": { "autoconnect": { "router": [], "peer": [], "client": [] } },
        },
        "open": { "return_conditions": { "connect_scouted": false } },
        "transport": {
            "unicast": { "accept_timeout": LOGIN.as_millis() as u64, "accept_pending": MOST_LOGINS },
            "link": {
                "protocols": ["tcp", "tls"],
                "tx": { "queue": {
                    "size": { "data_high": QUEUE_BATCHES, "data_low": QUEUE_BATCHES },
                    "congestion_control": { "block": { "wait_before_close": SLOWEST_READER.as_micros() as u64 } },
                } },
                "tls": tls(config),
            },
            "auth": { "usrpwd": users(config) },
        },
    })
}

fn tls(config: &Config) -> Value {
    let security = &config.security;
    let mut tls = json!({ "verify_name_on_connect": true });
    if let Some((certificate, key)) = &security.own {
        tls["listen_certificate"] = json!(certificate);
        tls["listen_private_key"] = json!(key);
    }
    if let Some(root) = &security.root_certificate {
        tls["root_ca_certificate"] = json!(root);
    }
    tls
}

fn users(config: &Config) -> Value {
    let mut users = json!({});
    if let Some(file) = &config.security.users_file {
        users["dictionary_file"] = json!(file);
    }
    if let Some((user, password)) = &config.security.credentials {
        users["user"] = json!(user);
        users["password"] = json!(password.0);
    }
    users
}

#[cfg(test)]
#[path = "../tests/unit/liveness.rs"]
mod tests;
