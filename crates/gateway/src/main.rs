//! `softtwin-gateway`: the twins of this machine on a Zenoh network, under the keys they have locally.
//!
//! ```text
//! domain -> [look] -> topics -> [small]  states, health, ... : every one, JSON        -> network
//!                            -> [fields] the newest, at a rate or on demand, f32      -> network
//! domain <- [questions] <- get  softtwin/<actuator>/whatif|pressure|gap?...           <- network
//! domain <- [readings]  <- put  softtwin/<actuator>/sensor, where the configuration allows it
//! ```
//!
//! A thread each, because ports of the shared memory stay in the thread that made them. All wait for the network; none of
//! them is on the twin's way.
#![forbid(unsafe_code)]

mod clock;
mod config;
mod endpoint;
mod fields;
mod lane;
mod link;
mod look;
mod network;
mod pulse;
mod questions;
mod readings;
mod security;
mod small;

use anyhow::{Context, anyhow};
use clap::Parser;
use config::Config;
use link::{Counters, Link};
use look::Look;
use pulse::Pulse;
use runtime::config::ConfigError;
use runtime::service;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::channel;
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};
use wire::Domain;
use zenoh::Wait;

/// How often the counts are told.
const TELL_EVERY: Duration = Duration::from_secs(60);

const EXAMPLES: &str = "\
Examples:
  The twins of this machine for programs on this machine that speak Zenoh
    softtwin-gateway --config config/gateway.toml
  Look at a configuration without starting
    softtwin-gateway --config config/gateway.toml --check

The shared-memory domain is $SOFTTWIN_DOMAIN (with $SOFTTWIN_ROOT), or iceoryx2's own.
Keys, encodings and security: docs/gateway.md.
Exit codes: 0 stopped as asked, 1 run-time failure, 2 usage, 78 configuration.";

/// The twins of this machine on a Zenoh network.
#[derive(Parser)]
#[command(name = "softtwin-gateway", version, about, after_help = EXAMPLES)]
struct Options {
    /// Configuration file, see config/gateway.toml
    #[arg(long, value_name = "FILE")]
    config: PathBuf,
    /// Check the configuration, say what it means, and end
    #[arg(long)]
    check: bool,
}

fn main() -> ExitCode {
    let options = Options::parse(); // clap itself leaves with 2 on wrong usage
    service::start_logging("warn,runtime=info,softtwin_gateway=info");
    match run(&options) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            tracing::error!("{error:#}");
            ExitCode::from(if error.is::<ConfigError>() { 78 } else { 1 })
        }
    }
}

fn run(options: &Options) -> anyhow::Result<()> {
    let config = Config::load(&options.config)?;
    tracing::info!("{config:?}");
    if options.check {
        return Ok(());
    }
    let stop = service::stop_flag().context("signals cannot be handled")?;
    let mut pulse = Pulse::from_env();
    let Some(session) = network::open(&config, &stop, &mut pulse)? else { return Ok(()) };
    let link = Link {
        domain: Domain::from_env(),
        session,
        prefix: config.prefix.as_str().into(),
        stop,
        turns: Arc::default(),
        counters: Arc::new(Counters::default()),
    };
    let ended = serve(&link, &config, pulse);
    service::tell_stopping();
    link.stop.store(true, Ordering::Relaxed);
    tracing::info!("ended: {}", link.counters.line());
    if let Err(error) = link.session.close().wait() {
        tracing::warn!("the session did not close cleanly: {error}");
    }
    ended
}

/// Starts the threads and looks at the domain until the end.
fn serve(link: &Link, config: &Config, mut pulse: Pulse) -> anyhow::Result<()> {
    let ((small, small_news), (fields, field_news)) = (channel(), channel());
    let (desk, questions) = questions::desk();
    let mut look = Look::new(link, config, small, fields, desk)?;
    let (period, inlets) = (config.field_period, config.inlets.clone());
    let mut link_of = || Link { turns: pulse.of_thread(), ..link.clone() };
    let mut threads = vec![
        start(link_of(), "small", move |link| small::run(link, &small_news))?,
        start(link_of(), "fields", move |link| fields::run(link, &field_news, period))?,
        start(link_of(), "questions", move |link| questions::run(link, &questions))?,
    ];
    if !inlets.is_empty() {
        threads.push(start(link_of(), "readings", move |link| readings::run(link, &inlets))?);
    }
    look.look(link)?;
    service::tell_ready(&place(config));
    let mut tell_at = Instant::now() + TELL_EVERY;
    while !link.is_stopped() && !threads.iter().any(JoinHandle::is_finished) {
        thread::sleep(look::EVERY);
        if let Err(error) = look.look(link) {
            tracing::warn!("{error:#}");
        }
        pulse.look();
        if Instant::now() >= tell_at {
            tell_at += TELL_EVERY;
            let line = link.counters.line();
            tracing::info!("so far: {line}");
            service::tell_status(&line);
        }
    }
    link.stop.store(true, Ordering::Relaxed);
    let ends =
        threads.into_iter().map(|thread| thread.join().unwrap_or_else(|_| Err(anyhow!("a thread panicked"))));
    ends.collect()
}

fn start(
    link: Link,
    name: &str,
    body: impl FnOnce(&Link) -> anyhow::Result<()> + Send + 'static,
) -> anyhow::Result<JoinHandle<anyhow::Result<()>>> {
    Ok(thread::Builder::new().name(name.into()).spawn(move || body(&link))?)
}

/// Where the gateway can be met.
fn place(config: &Config) -> String {
    match (config.listen.is_empty(), config.connect.is_empty()) {
        (false, true) => format!("listens on {}", endpoint::list(&config.listen)),
        (true, _) => format!("calls {}", endpoint::list(&config.connect)),
        (false, false) => format!(
            "listens on {}, calls {}",
            endpoint::list(&config.listen),
            endpoint::list(&config.connect)
        ),
    }
}
