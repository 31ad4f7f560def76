//! The Zenoh session: its settings, how it is opened, and the limit of its connections.

use crate::config::{Config, Endpoint, Mode, list};
use crate::link::{Link, Liveness};
use anyhow::anyhow;
use runtime::address_limit::AddressLimit;
use runtime::service;
use serde_json::{Value, json};
use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};
use zenoh::{Session, Wait};

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
