//! Log, signals, service manager and files in shared memory of long-running programs.

use sd_notify::NotifyState;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGXFSZ};
use std::io::{IsTerminal, Write};
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};
use std::process::Child;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};
use tracing_subscriber::filter::{LevelFilter, Targets};
use tracing_subscriber::layer::{Layer, SubscriberExt};
use tracing_subscriber::util::SubscriberInitExt;
use wire::thread_group::{StopFlag, ThreadResult};
use wire::{OwnFiles, background_thread};

/// Order of a help: what the program does, examples (`before_help`), usage, options, notes.
pub const HELP_TEMPLATE: &str = "{about}\n\n{before-help}{usage-heading} {usage}\n\n{all-args}{after-help}";

/// Log lines that could not be written since the start.
static LOST_LINES: AtomicU64 = AtomicU64::new(0);

/// Log lines that could not be written since the start: a full disk, a closed pipe.
pub fn lost_log_lines() -> u64 {
    LOST_LINES.load(Ordering::Relaxed)
}

/// Standard error as a log: a line that cannot be written is counted, and never an error.
struct LogWriter;

impl Write for LogWriter {
    /// Called once for each line.
    fn write(&mut self, line: &[u8]) -> std::io::Result<usize> {
        if std::io::stderr().write_all(line).is_err() {
            LOST_LINES.fetch_add(1, Ordering::Relaxed);
        }
        Ok(line.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

/// Logs to standard error at the level of `RUST_LOG`, else at `default`; colours only on a terminal.
pub fn start_logging(default: &str) {
    let layer = tracing_subscriber::fmt::layer()
        .with_writer(|| LogWriter)
        .with_ansi(std::io::stderr().is_terminal())
        .with_target(false)
        .without_time()
        .log_internal_errors(false); // they would be printed, and printing panics where writing fails
    tracing_subscriber::registry().with(layer.with_filter(log_filter(default))).init();
}

/// Levels by the crate's name, for example `warn,runtime=debug`; crates that are not named show their errors.
fn log_filter(default: &str) -> Targets {
    let wanted = std::env::var("RUST_LOG").ok().filter(|text| !text.trim().is_empty());
    let filter: Option<Targets> = wanted.as_deref().unwrap_or(default).parse().ok();
    let filter = filter.unwrap_or_else(|| default.parse().unwrap_or_default());
    if filter.default_level().is_none() { filter.with_default(LevelFilter::ERROR) } else { filter }
}

/// Time after the first signal to stop during which further ones are taken for the same request. `timeout` signals its command
/// and then the command's process group, a terminal and a service manager may both signal: two within a millisecond.
const SAME_REQUEST: Duration = Duration::from_secs(1);

/// What is to be done at a signal to stop.
#[derive(Debug, PartialEq, Eq)]
enum AtSignal {
    Stop,
    Nothing,
    EndAtOnce,
}

/// Decides at a signal to stop, from the time of the first one, ms (0: none yet).
fn at_signal(first_ms: &AtomicU64, now_ms: u64) -> AtSignal {
    match first_ms.compare_exchange(0, now_ms.max(1), Ordering::Relaxed, Ordering::Relaxed) {
        Ok(_) => AtSignal::Stop,
        Err(first_ms) if u128::from(now_ms.saturating_sub(first_ms)) < SAME_REQUEST.as_millis() => {
            AtSignal::Nothing
        }
        Err(_) => AtSignal::EndAtOnce,
    }
}

/// A flag that SIGTERM and SIGINT set. A signal a second or more after the first ends the process immediately, without clean-up.
///
/// # Errors
/// The signal handler cannot be installed.
pub fn stop_flag() -> std::io::Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    let (began, first_ms) = (Instant::now(), Arc::new(AtomicU64::new(0)));
    for signal in [SIGTERM, SIGINT] {
        let (stop, first_ms) = (stop.clone(), first_ms.clone());
        let handler = move || match at_signal(&first_ms, began.elapsed().as_millis() as u64) {
            AtSignal::Stop => stop.store(true, Ordering::SeqCst),
            AtSignal::Nothing => {}
            AtSignal::EndAtOnce => signal_hook::low_level::exit(1),
        };
        // SAFETY: the handler reads a clock, works on atomic numbers and may call `_exit`; a signal handler may do all three.
        unsafe { signal_hook::low_level::register(signal, handler) }?;
    }
    Ok(stop)
}

/// Ignores SIGXFSZ, so that a write beyond the limit of a file's size fails instead of ending the recorder.
///
/// # Errors
/// The signal handler cannot be installed.
pub fn ignore_size_limit() -> std::io::Result<()> {
    signal_hook::flag::register(SIGXFSZ, Arc::default()).map(drop)
}

/// Blocks at least so large are mapped each on its own, and given back to the system when they are freed.
#[cfg(target_env = "gnu")]
const MAPPED_BYTES: libc::c_int = 256 << 10;

/// Limits the fragmentation of the heap in programs that load models repeatedly; called first.
///
/// The allocator of glibc raises its limit for mapped blocks to the largest freed one. A model's blocks are then in the heap,
/// which reloads fragment: the twin uses 264 MB after 1,500 reloads without this, 32 MB with it (`softtwin-studies cycles`).
pub fn keep_memory_small() {
    #[cfg(target_env = "gnu")]
    // SAFETY: sets two numbers of the allocator; refused values change nothing.
    unsafe {
        libc::mallopt(libc::M_MMAP_THRESHOLD, MAPPED_BYTES);
        libc::mallopt(libc::M_TRIM_THRESHOLD, MAPPED_BYTES);
    }
}

/// A flag that SIGHUP sets: read the configuration again.
///
/// # Errors
/// The signal handler cannot be installed.
pub fn reload_flag() -> std::io::Result<Arc<AtomicBool>> {
    let requested = Arc::new(AtomicBool::new(false));
    signal_hook::flag::register(SIGHUP, requested.clone())?;
    Ok(requested)
}

/// Notifies the service manager that a reload begins; it ends with [`notify_reloaded`].
pub fn notify_reloading() {
    match NotifyState::monotonic_usec_now() {
        Ok(now) => notify_manager(&[NotifyState::Reloading, now]),
        Err(error) => tracing::warn!("the service manager could not be notified: {error}"),
    }
}

/// Notifies the service manager, if there is one; a failure there must not stop the program.
fn notify_manager(states: &[NotifyState]) {
    let abstract_name = std::env::var("NOTIFY_SOCKET").ok().filter(|name| name.starts_with('@'));
    let sent = match abstract_name {
        Some(name) => notify_abstract(&name[1..], states),
        None => sd_notify::notify(states),
    };
    if let Err(error) = sent {
        tracing::warn!("the service manager could not be notified: {error}");
    }
}

/// The library knows sockets with a path only.
fn notify_abstract(name: &str, states: &[NotifyState]) -> std::io::Result<()> {
    let address = SocketAddr::from_abstract_name(name)?;
    let text: String = states.iter().map(|state| format!("{state}\n")).collect();
    UnixDatagram::unbound()?.send_to_addr(text.as_bytes(), &address).map(drop)
}

/// Ready to serve, with a status line; logged as well.
pub fn notify_ready(status: &str) {
    notify_started(status);
    tracing::info!("ready: {status}");
}

/// Notifies the service manager that the program has started; the status line contains what it waits for.
pub fn notify_started(status: &str) {
    notify_manager(&[NotifyState::Ready, NotifyState::Status(status)]);
}

/// Serves again after a reload.
pub fn notify_reloaded() {
    notify_manager(&[NotifyState::Ready]);
}

pub fn notify_status(status: &str) {
    notify_manager(&[NotifyState::Status(status)]);
}

/// The end has begun.
pub fn notify_stopping() {
    notify_manager(&[NotifyState::Stopping]);
}

/// Sends a signal to a child process, for example SIGTERM, which asks it to end; does nothing when it has ended already.
pub fn signal(child: &mut Child, signal: i32) -> std::io::Result<()> {
    if child.try_wait()?.is_some() {
        return Ok(());
    }
    // SAFETY: the child has not been waited for (just checked, and it is borrowed mutably), so its number is still its own.
    match unsafe { libc::kill(child.id() as libc::pid_t, signal) } {
        0 => Ok(()),
        _ => Err(std::io::Error::last_os_error()),
    }
}

/// Time between two checks of this program's files.
const FILES_INTERVAL: Duration = Duration::from_secs(1);

/// Checks until `end` that nobody removes this program's files in shared memory, as a cleaner of temporary files may; an error if
/// somebody did. Without them other programs do not find its topics, and it does not find the topics of programs that were restarted.
pub fn watch_files(own: &OwnFiles, end: &StopFlag) -> ThreadResult {
    background_thread();
    loop {
        end.pause(FILES_INTERVAL);
        if end.is_set() {
            return Ok(());
        }
        if let Some(file) = own.removed().first() {
            let file = file.display();
            return Err(format!(
                "files in shared memory were removed, such as {file}; exclude that folder from cleaners of temporary files (see \
                 OPERATIONS.md), then start again"
            )
            .into());
        }
    }
}

/// Feeds the service manager's watchdog, but only while the loop makes progress.
#[derive(Debug)]
pub struct Watchdog {
    interval: Option<Duration>,
    last: Instant,
    seen: u64,
}

impl Watchdog {
    /// Reads from the environment whether and how often (at half the time allowed).
    pub fn from_env() -> Self {
        let interval = sd_notify::watchdog_enabled().map(|allowed| allowed / 2);
        Self { interval, last: Instant::now(), seen: 0 }
    }

    /// Takes the loop's count of its turns; feeds the watchdog when it is due and the count has changed.
    pub fn feed(&mut self, turns: u64) {
        let Some(interval) = self.interval else { return };
        if self.last.elapsed() >= interval && turns != self.seen {
            notify_manager(&[NotifyState::Watchdog]);
            self.last = Instant::now();
            self.seen = turns;
        }
    }
}

#[cfg(test)]
#[path = "../tests/unit/service.rs"]
mod tests;
