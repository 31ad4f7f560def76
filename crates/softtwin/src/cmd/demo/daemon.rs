//! A `softtwind` process under the demonstration's control.

use anyhow::Context;
use std::io::{BufRead, BufReader};
use std::path::PathBuf;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

/// How long a process may take to start or to end.
const PATIENCE: Duration = Duration::from_secs(30);

/// A child process; killed when dropped.
#[derive(Debug)]
pub(super) struct Daemon {
    role: &'static str,
    child: Child,
    lines: Receiver<String>,
    said: Vec<String>,
    status: Option<ExitStatus>,
}

impl Daemon {
    /// Starts `softtwind ROLE ARGUMENTS`.
    pub(super) fn start(role: &'static str, arguments: &[String]) -> anyhow::Result<Self> {
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
        Ok(Self { role, child, lines, said: Vec::new(), status: None })
    }

    /// Waits for its word that it is ready.
    pub(super) fn wait_ready(&mut self, stop: &AtomicBool) -> anyhow::Result<()> {
        let end = Instant::now() + PATIENCE;
        while Instant::now() < end && !stop.load(Ordering::Relaxed) {
            match self.lines.recv_timeout(Duration::from_millis(100)) {
                Ok(line) => {
                    let ready = line.contains("ready:");
                    self.said.push(line);
                    if ready {
                        return Ok(());
                    }
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
            }
        }
        let said = self.said();
        anyhow::bail!("the {} did not become ready; it said:\n{said}", self.role)
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

    /// Asks it to end (SIGTERM) and waits.
    pub(super) fn stop(&mut self) -> anyhow::Result<()> {
        runtime::process::terminate(&mut self.child)?;
        let end = Instant::now() + PATIENCE;
        while !self.ended()? {
            anyhow::ensure!(Instant::now() < end, "the {} did not end within {PATIENCE:?}", self.role);
            std::thread::sleep(Duration::from_millis(5));
        }
        let said = self.said();
        anyhow::ensure!(self.succeeded(), "the {} ended with an error:\n{said}", self.role);
        Ok(())
    }

    /// All it has said.
    pub(super) fn said(&mut self) -> String {
        self.said.extend(self.lines.try_iter());
        self.said.join("\n")
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        if self.status.is_none() {
            // Gone already is fine: this is the way out after an error.
            let _ = self.child.kill();
            let _ = self.child.wait();
        }
    }
}

/// `softtwind` beside this program.
fn program() -> anyhow::Result<PathBuf> {
    let own = std::env::current_exe().context("cannot tell where this program is")?;
    let path = own.with_file_name("softtwind");
    anyhow::ensure!(
        path.exists(),
        "the daemon is not beside this program; build it with `cargo build -p softtwind` ({})",
        path.display()
    );
    Ok(path)
}
