//! Our programs as child processes.

use anyhow::Context;
use std::ffi::OsString;
use std::io::{BufRead, BufReader};
use std::path::PathBuf;
use std::process::{Child, ChildStdout, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

/// Longest time for a process to start or to end.
const TIMEOUT: Duration = Duration::from_secs(30);

/// A child process; killed when dropped.
#[derive(Debug)]
pub struct Daemon {
    name: String,
    child: Child,
    lines: Receiver<String>,
    log: Vec<String>,
    status: Option<ExitStatus>,
}

impl Daemon {
    /// Starts `softtwind ROLE ARGUMENTS`, for example the role `twin`.
    ///
    /// # Errors
    /// `softtwind` is not beside this program, or does not start.
    pub fn softtwind(role: &str, arguments: &[OsString]) -> anyhow::Result<Self> {
        Self::start(role, Command::new(program("softtwind")?).arg(role).args(arguments).stdout(Stdio::null()))
    }

    /// Starts a command; its standard error is stored. `name` is used in messages.
    ///
    /// # Errors
    /// I/O errors.
    pub fn start(name: &str, command: &mut Command) -> anyhow::Result<Self> {
        let mut child = command
            .stdin(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .with_context(|| format!("cannot start {}", command.get_program().display()))?;
        let (sender, lines) = channel();
        if let Some(errors) = child.stderr.take() {
            std::thread::spawn(move || {
                BufReader::new(errors).lines().map_while(Result::ok).try_for_each(|line| sender.send(line))
            });
        }
        Ok(Self { name: name.into(), child, lines, log: Vec::new(), status: None })
    }

    /// Waits for its line `ready:`.
    ///
    /// # Errors
    /// The process ended, took too long, or `stop` was set.
    pub fn wait_ready(&mut self, stop: &AtomicBool) -> anyhow::Result<()> {
        self.wait_for("ready:", stop)
    }

    /// Waits for its next line with `text` in it.
    ///
    /// # Errors
    /// The process ended, took too long, or `stop` was set.
    pub fn wait_for(&mut self, text: &str, stop: &AtomicBool) -> anyhow::Result<()> {
        let end = Instant::now() + TIMEOUT;
        while Instant::now() < end && !stop.load(Ordering::Relaxed) {
            match self.lines.recv_timeout(Duration::from_millis(100)) {
                Ok(line) => {
                    let found = line.contains(text);
                    self.log.push(line);
                    if found {
                        return Ok(());
                    }
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
            }
        }
        let log = self.log();
        anyhow::bail!("the {} did not print `{text}`; its log:\n{log}", self.name)
    }

    /// Process number.
    pub fn id(&self) -> u32 {
        self.child.id()
    }

    /// Its standard output, if piped and not yet taken.
    pub fn stdout(&mut self) -> Option<ChildStdout> {
        self.child.stdout.take()
    }

    /// True if it has ended.
    pub fn ended(&mut self) -> std::io::Result<bool> {
        if self.status.is_none() {
            self.status = self.child.try_wait()?;
        }
        Ok(self.status.is_some())
    }

    /// True if it has ended with exit code 0.
    pub fn succeeded(&self) -> bool {
        self.status.is_some_and(|status| status.success())
    }

    /// Fails with the log if it has ended.
    ///
    /// # Errors
    /// It has ended.
    pub fn check(&mut self) -> anyhow::Result<()> {
        if !self.ended()? {
            return Ok(());
        }
        let log = self.log();
        anyhow::bail!("the {} ended:\n{log}", self.name)
    }

    /// Sends a signal, unless it has ended.
    pub fn signal(&mut self, signal: i32) -> std::io::Result<()> {
        runtime::service::signal(&mut self.child, signal)
    }

    /// Ends it with SIGKILL and waits for its end.
    pub fn kill(&mut self) -> std::io::Result<()> {
        self.child.kill()?;
        self.status = Some(self.child.wait()?);
        Ok(())
    }

    /// Sends SIGTERM and waits for the end.
    ///
    /// # Errors
    /// It does not end, or ends with another exit code than 0.
    pub fn stop(&mut self) -> anyhow::Result<()> {
        runtime::service::signal(&mut self.child, libc::SIGTERM)?;
        self.wait()
    }

    /// Waits for the end.
    ///
    /// # Errors
    /// It does not end, or ends with another exit code than 0.
    pub fn wait(&mut self) -> anyhow::Result<()> {
        let end = Instant::now() + TIMEOUT;
        while !self.ended()? {
            anyhow::ensure!(Instant::now() < end, "the {} did not end within {TIMEOUT:?}", self.name);
            std::thread::sleep(Duration::from_millis(5));
        }
        let log = self.log();
        anyhow::ensure!(self.succeeded(), "the {} ended with an error:\n{log}", self.name);
        Ok(())
    }

    /// Discards its standard error so far.
    pub fn forget_log(&mut self) {
        self.lines.try_iter().for_each(drop);
        self.log = Vec::new();
    }

    /// Its standard error so far.
    pub fn log(&mut self) -> String {
        self.log.extend(self.lines.try_iter());
        self.log.join("\n")
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        if self.status.is_none() {
            // SIGTERM first: SIGKILL would leave shared memory behind. Errors mean that it is gone already.
            if self.stop().is_err() {
                let _ = self.kill();
            }
        }
    }
}

/// A program of ours, expected beside this one.
///
/// # Errors
/// It is not there.
pub fn program(name: &str) -> anyhow::Result<PathBuf> {
    let own = std::env::current_exe().context("the folder of this program is not known")?;
    let path = own.with_file_name(name);
    anyhow::ensure!(
        path.exists(),
        "expected `{name}` in the folder of this program, found none; build it with `cargo build --workspace --bins`, or \
         install it with `cargo install --path crates/{name} --locked` ({})",
        path.display()
    );
    Ok(path)
}
