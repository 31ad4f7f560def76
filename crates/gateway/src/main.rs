//! `softtwin-gateway`: the twins of this machine on a Zenoh network, under the keys they have locally.
//!
//! ```text
//! domain -> [topics]   messages (states, health, ...): all of them, JSON                    -> network
//!                      fields: the newest, at a rate or on demand, f32                      -> network
//! domain <- [queries]  <- get  softtwin/<actuator>/whatif|pressure|gap?...                  <- network
//! domain <- [readings] <- put  softtwin/<actuator>/sensor, where the configuration allows it
//! domain -> [ros]      a node of ROS 2 with its topics, where the configuration asks for it
//! ```
//!
//! Each is a thread, because ports of the shared memory belong to the thread that made them. A slow network delays these threads and
//! never the twin.
#![forbid(unsafe_code)]

mod config;
mod link;
mod network;
mod queries;
mod readings;
mod ros;
mod topics;

use anyhow::Context;
use clap::{CommandFactory, Parser};
use config::{Config, Endpoint, list};
use link::{Counters, Link, Liveness};
use runtime::config::ConfigError;
use runtime::{metrics, service};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::channel;
use std::thread;
use std::time::{Duration, Instant};
use topics::{QueryHandler, TopicScan};
use wire::thread_group::ThreadGroup;
use wire::{Domain, OwnFiles};
use zenoh::Wait;

/// Interval of the counts in the log.
const LOG_EVERY: Duration = Duration::from_secs(60);

const EXAMPLES: &str = "\
Examples:
  The twins of this machine for programs on this machine that speak Zenoh:
    softtwin-gateway --config config/gateway.toml
  Check a configuration without starting:
    softtwin-gateway --config config/gateway.toml --check
  With metrics for Prometheus:
    softtwin-gateway --config config/gateway.toml --metrics 127.0.0.1:9467";

const CODES: &str = "\
The shared-memory domain is $SOFTTWIN_DOMAIN (with $SOFTTWIN_ROOT), or the user's own. Keys, encodings and security: docs/gateway.md. \
SIGHUP reads the configuration again, with certificates and users, and reconnects; an invalid one is refused and the old one stays.

Exit codes: 0 stopped as asked, 1 run-time failure, 2 usage, 78 configuration.";

/// What the program does, examples, options, notes.
const HELP: &str = service::HELP_TEMPLATE;

/// The twins of this machine on a Zenoh network.
#[derive(Parser)]
#[command(name = "softtwin-gateway", version, about, before_help = EXAMPLES, after_help = CODES, help_template = HELP)]
struct Options {
    /// Configuration file, see config/gateway.toml
    #[arg(long, value_name = "FILE", required_unless_present = "manual")]
    config: Option<PathBuf>,
    /// Check the configuration, print it, and end
    #[arg(long)]
    check: bool,
    /// Serve Prometheus metrics at http://ADDR/metrics; loopback only [default: off]
    #[arg(long, value_name = "127.0.0.1:PORT", value_parser = metrics::loopback)]
    metrics: Option<SocketAddr>,
    /// Write this help as a man page into a folder, and end
    #[arg(long, value_name = "DIR", exclusive = true)]
    manual: Option<PathBuf>,
}

fn main() -> ExitCode {
    service::keep_memory_small();
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
    let Some(path) = &options.config else {
        let folder = options.manual.as_deref().context("--config is missing")?;
        let page = Options::command().after_help(format!("{EXAMPLES}\n\n{CODES}")); // a man page shows nothing before its name
        return clap_mangen::generate_to(page, folder).context(folder.display().to_string());
    };
    let mut config = Config::load(path)?;
    log_config(&config);
    if options.check {
        return Ok(());
    }
    let program = service::stop_flag().context("signals cannot be handled")?;
    let reload = service::reload_flag().context("signals cannot be handled")?;
    let counters = Arc::new(Counters::default());
    let listener = metrics::listen(options.metrics)?;
    let mut group = ThreadGroup::new(program.clone());
    let counted = counters.clone();
    metrics::start(&mut group, listener, || move || counted.metrics())?;
    let own_files = OwnFiles::of(&Domain::from_env())?;
    group.start("files", move |end| service::watch_files(&own_files, end))?;
    let mut liveness = Liveness::from_env();
    let ended = loop {
        liveness.forget_threads();
        let Some(session) = network::open_session(&config, &program, &mut liveness)? else { break Ok(()) };
        let link = Link {
            domain: Domain::from_env(),
            session,
            prefix: config.prefix.as_str().into(),
            stop: Arc::default(),
            is_alive: Arc::default(),
            counters: counters.clone(),
        };
        let reread = || reread(path, &reload);
        let served = serve(&link, &config, &mut liveness, &program, reread);
        link.stop.store(true, Ordering::Relaxed);
        if let Err(error) = link.session.close().wait() {
            tracing::warn!("the session did not close cleanly: {error}");
        }
        match served {
            Ok(Some(new)) => config = new,
            Ok(None) => break Ok(()),
            Err(error) => break Err(error),
        }
        tracing::info!("reloaded: reconnecting");
        log_config(&config);
    };
    service::notify_stopping();
    tracing::info!("ended: {}", counters.line());
    group.end()?;
    ended
}

fn log_config(config: &Config) {
    tracing::info!(
        "{:?} below `{}`, listens on {}, connects to {}; sends {}, fields every {} ms at most; takes readings for {}, targets for {}; {}",
        config.mode,
        config.prefix,
        list(&config.listen),
        list(&config.connect),
        list(&config.keys),
        config.field_period.as_millis(),
        list(&config.inlets),
        list(&config.targets),
        config.security
    );
}

/// The new configuration after a request to reload; `None` if it is invalid.
fn reread(path: &Path, requested: &AtomicBool) -> Option<Config> {
    if !requested.swap(false, Ordering::Relaxed) {
        return None;
    }
    service::notify_reloading();
    match Config::load(path) {
        Ok(config) => Some(config),
        Err(error) => {
            tracing::error!("reload refused, the old configuration stays: {error}");
            service::notify_reloaded();
            None
        }
    }
}

/// Starts the threads and scans the local topics until the end or a reload, whose configuration it returns.
fn serve(
    link: &Link,
    config: &Config,
    liveness: &mut Liveness,
    program: &AtomicBool,
    reread: impl Fn() -> Option<Config>,
) -> anyhow::Result<Option<Config>> {
    let ((to_messages, for_messages), (to_fields, for_fields)) = (channel(), channel());
    let (handler, requests) = QueryHandler::new();
    let mut scan = TopicScan::new(link, &config.keys, &config.inlets, to_messages, to_fields, handler)?;
    let (period, inlets) = (config.field_period, config.inlets.clone());
    let mut threads = ThreadGroup::with_program(link.stop.clone());
    let mut thread_link = || Link { is_alive: liveness.add_thread(), ..link.clone() };
    let own = thread_link();
    threads.start("messages", move |_| Ok(topics::run_messages(&own, &for_messages)?))?;
    let own = thread_link();
    threads.start("fields", move |_| Ok(topics::run_fields(&own, &for_fields, period)?))?;
    let own = thread_link();
    threads.start("queries", move |_| Ok(queries::run(&own, &requests)?))?;
    if let Some(ros2) = &config.ros2 {
        let (to_twins, calls) = ros::calls();
        let (own, own_ros2, keys) = (thread_link(), ros2.clone(), config.keys.clone());
        threads.start("ros2", move |_| Ok(ros::run(&own, &own_ros2, &keys, period, to_twins)?))?;
        let (own, own_ros2) = (thread_link(), ros2.clone());
        threads.start("ros2-services", move |_| Ok(ros::answer_calls(&own, &own_ros2, &calls)?))?;
        if !config.targets.is_empty() {
            let (own, own_ros2, targets) = (thread_link(), ros2.clone(), config.targets.clone());
            threads.start("ros2-commands", move |_| Ok(ros::run_commands(&own, &own_ros2, &targets)?))?;
        }
    }
    if !inlets.is_empty() {
        let (own, ros2) = (thread_link(), config.ros2.clone());
        threads.start("readings", move |_| Ok(readings::run(&own, &inlets, ros2.as_ref())?))?;
    }
    if !config.listen.is_empty() {
        let (own, ports) = (thread_link(), config.listen.iter().map(Endpoint::port).collect());
        threads.start("addresses", move |_| Ok(network::limit_addresses(&own, ports)?))?;
    }
    scan.scan(link)?;
    service::notify_ready(&connections(config));
    let mut log_at = Instant::now() + LOG_EVERY;
    while !link.is_stopped() && !program.load(Ordering::Relaxed) {
        threads.check()?;
        if let Some(new) = reread() {
            return Ok(Some(new));
        }
        thread::sleep(topics::SCAN_EVERY);
        if let Err(error) = scan.scan(link) {
            tracing::warn!("{error:#}");
        }
        liveness.feed();
        if Instant::now() >= log_at {
            log_at += LOG_EVERY;
            let line = link.counters.line();
            tracing::info!("so far: {line}");
            service::notify_status(&line);
        }
    }
    threads.check()?;
    Ok(None)
}

/// Endpoints, for the service manager's status.
fn connections(config: &Config) -> String {
    let (listen, connect) = (list(&config.listen), list(&config.connect));
    match (config.listen.is_empty(), config.connect.is_empty()) {
        (false, true) => format!("listens on {listen}"),
        (true, _) => format!("connects to {connect}"),
        (false, false) => format!("listens on {listen}, connects to {connect}"),
    }
}
