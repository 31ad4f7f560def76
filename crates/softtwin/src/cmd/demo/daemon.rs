//! A `softtwind` process of the demonstration.

use anyhow::Context;
use std::ffi::OsString;
use std::io::{BufRead, BufReader};
use std::path::PathBuf;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

/// How long a process may take to start or to end.
const TIMEOUT: Duration = Duration::from_secs(30);

/// A child process; killed when dropped.
#[derive(Debug)]
pub(super) struct Daemon {
    role: &'static str,
    child: Child,
    lines: Receiver<String>,
    log: Vec<String>,
    status: Option<ExitStatus>,
}

impl Daemon {
    /// Starts `softtwind ROLE ARGUMENTS`.
    pub(super) fn start(role: &'static str, arguments: &[OsString]) -> anyhow::Result<Self> {
        let program = program()?;
        let mut child = Command::new(&program)
            .arg(role)
            .args(arguments)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .with_context(|| format!("cannot start {}", program.display()))?;
        let (sender, lines) = channel();
        if let Some(errors) = child.stderr.take() {
            std::thread::spawn(move || {
                BufReader::new(errors).lines().map_while(Result::ok).try_for_each(|line| sender.send(line))
            });
        }
        Ok(Self { role, child, lines, log: Vec::new(), status: None })
    }

    /// Waits until it logs that it is ready.
    pub(super) fn wait_ready(&mut self, stop: &AtomicBool) -> anyhow::Result<()> {
        let end = Instant::now() + TIMEOUT;
        while Instant::now() < end && !stop.load(Ordering::Relaxed) {
            match self.lines.recv_timeout(Duration::from_millis(100)) {
                Ok(line) => {
                    let ready = line.contains("ready:");
                    self.log.push(line);
                    if ready {
                        return Ok(());
                    }
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
            }
        }
        let log = self.log();
        anyhow::bail!("the {} did not become ready; its log:\n{log}", self.role)
    }

    /// Whether it has ended.
    pub(super) fn ended(&mut self) -> std::io::Result<bool> {
        if self.status.is_none() {
            self.status = self.child.try_wait()?;
        }
        Ok(self.status.is_some())
    }

    /// Whether it has ended well.
    pub(super) fn succeeded(&self) -> bool {
        self.status.is_some_and(|status| status.success())
    }

    /// Sends SIGTERM and waits for the end.
    pub(super) fn stop(&mut self) -> anyhow::Result<()> {
        runtime::process::terminate(&mut self.child)?;
        let end = Instant::now() + TIMEOUT;
        while !self.ended()? {
            anyhow::ensure!(Instant::now() < end, "the {} did not end within {TIMEOUT:?}", self.role);
            std::thread::sleep(Duration::from_millis(5));
        }
        let log = self.log();
        anyhow::ensure!(self.succeeded(), "the {} ended with an error:\n{log}", self.role);
        Ok(())
    }

    /// All it has logged.
    pub(super) fn log(&mut self) -> String {
        self.log.extend(self.lines.try_iter());
        self.log.join("\n")
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        if self.status.is_none() {
            // It may have ended already: this runs after an error.
            let _ = self.child.kill();
            let _ = self.child.wait();
        }
    }
}

/// `softtwind` in the folder of this program.
fn program() -> anyhow::Result<PathBuf> {
    let own = std::env::current_exe().context("the folder of this program is not known")?;
    let path = own.with_file_name("softtwind");
    anyhow::ensure!(
        path.exists(),
        "the daemon is not in the folder of this program; build it with `cargo build -p softtwind` ({})",
        path.display()
    );
    Ok(path)
}
