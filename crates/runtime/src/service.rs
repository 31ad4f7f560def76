//! What every program that goes on running needs from the system: log, signals, the service manager.

use sd_notify::NotifyState;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use std::io::IsTerminal;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};
use tracing_subscriber::EnvFilter;

/// Logs to standard error what `RUST_LOG` asks for, else what `default` does; colours only on a terminal.
pub fn start_logging(default: &str) {
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new(default));
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal())
        .with_target(false)
        .without_time()
        .init();
}

/// A flag that SIGTERM and SIGINT set. A second signal ends the process at once, clean or not.
///
/// # Errors
/// The system's refusal to handle signals.
pub fn stop_flag() -> std::io::Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGTERM, SIGINT] {
        signal_hook::flag::register_conditional_shutdown(signal, 1, stop.clone())?;
        signal_hook::flag::register(signal, stop.clone())?;
    }
    Ok(stop)
}

/// A flag that SIGHUP sets: read the configuration again.
///
/// # Errors
/// The system's refusal to handle signals.
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

/// Tells the service manager, if there is one; a failure there must not stop the program.
fn tell_manager(states: &[NotifyState]) {
    if let Err(error) = sd_notify::notify(states) {
        tracing::warn!("the service manager could not be told: {error}");
    }
}

/// Ready to serve, with a status line; said in the log as well.
pub fn tell_ready(status: &str) {
    tell_started(status);
    tracing::info!("ready: {status}");
}

/// Started as far as it depends on this program, with a status line that says what is waited for.
pub fn tell_started(status: &str) {
    tell_manager(&[NotifyState::Ready, NotifyState::Status(status)]);
}

/// Serves again after a reload.
pub fn tell_reloaded() {
    tell_manager(&[NotifyState::Ready]);
}

/// The status line.
pub fn tell_status(status: &str) {
    tell_manager(&[NotifyState::Status(status)]);
}

/// The end has begun.
pub fn tell_stopping() {
    tell_manager(&[NotifyState::Stopping]);
}

/// Feeds the service manager's watchdog, but only while the loop makes progress.
#[derive(Debug)]
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

    /// Takes the loop's count of its turns, and feeds the watchdog when it is due and the count has moved.
    pub fn look(&mut self, turns: u64) {
        let Some(interval) = self.interval else { return };
        if self.last.elapsed() >= interval && turns != self.seen {
            tell_manager(&[NotifyState::Watchdog]);
            self.last = Instant::now();
            self.seen = turns;
        }
    }
}
