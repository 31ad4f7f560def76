//! What both daemons need from the system: log, signals, the service manager.

use sd_notify::NotifyState;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use std::io::IsTerminal;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};
use tracing_subscriber::EnvFilter;

/// Logs to standard error; colours only on a terminal.
pub fn start_logging() {
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new("info"));
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal())
        .with_target(false)
        .without_time()
        .init();
}

/// A flag that SIGTERM and SIGINT set. A second signal ends the process at once, clean or not.
pub fn stop_flag() -> std::io::Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGTERM, SIGINT] {
        signal_hook::flag::register_conditional_shutdown(signal, 1, stop.clone())?;
        signal_hook::flag::register(signal, stop.clone())?;
    }
    Ok(stop)
}

/// A flag that SIGHUP sets: read the configuration again.
pub fn reload_flag() -> std::io::Result<Arc<AtomicBool>> {
    let asked = Arc::new(AtomicBool::new(false));
    signal_hook::flag::register(SIGHUP, asked.clone())?;
    Ok(asked)
}

/// Tells the service manager that a reload begins; it ends with "ready".
pub fn tell_reloading() {
    match NotifyState::monotonic_usec_now() {
        Ok(now) => tell_manager(&[NotifyState::Reloading, now]),
        Err(error) => tracing::warn!("the service manager could not be told: {error}"),
    }
}

/// Tells the service manager, if there is one; a failure there must not stop the twin.
pub fn tell_manager(states: &[NotifyState]) {
    if let Err(error) = sd_notify::notify(states) {
        tracing::warn!("the service manager could not be told: {error}");
    }
}

/// Ready to serve, with a status line.
pub fn tell_ready(status: &str) {
    tell_manager(&[NotifyState::Ready, NotifyState::Status(status)]);
    tracing::info!("ready: {status}");
}

/// Feeds the service manager's watchdog, but only while the loop makes progress.
pub struct Watchdog {
    interval: Option<Duration>,
    last: Instant,
    seen: u64,
}

impl Watchdog {
    /// Asks the environment whether and how often (at half the time allowed).
    pub fn from_env() -> Self {
        let interval = sd_notify::watchdog_enabled().map(|allowed| allowed / 2);
        Self { interval, last: Instant::now(), seen: 0 }
    }

    /// Looks at the loop's progress and feeds the watchdog when it is due.
    pub fn look(&mut self, progress: &AtomicU64) {
        let Some(interval) = self.interval else { return };
        let now = progress.load(Ordering::Relaxed);
        if self.last.elapsed() >= interval && now != self.seen {
            tell_manager(&[NotifyState::Watchdog]);
            self.last = Instant::now();
            self.seen = now;
        }
    }
}
