//! The daemons as child processes.

use super::scene::Files;
use anyhow::Context;
use std::ffi::OsStr;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// How long a daemon may take to stop before it is killed.
const STOP_PATIENCE: Duration = Duration::from_secs(5);

/// `softtwind` beside this program.
pub fn daemon() -> Option<PathBuf> {
    let path = std::env::current_exe().ok()?.with_file_name("softtwind");
    path.is_file().then_some(path)
}

/// A twin and a bridge; both are stopped when this is dropped.
#[derive(Default)]
pub struct Daemons {
    running: Vec<(Child, PathBuf)>,
}

impl Daemons {
    /// Starts both in `domain`. Their logs go to the scene's folder.
    pub fn start(daemon: &Path, domain: &str, files: &Files) -> anyhow::Result<Self> {
        let mut daemons = Self::default();
        let settings = [OsStr::new("--config"), files.settings.as_os_str()];
        for (what, extra) in [("twin", settings.as_slice()), ("bridge", &[])] {
            let log = files.scene.with_file_name(format!("{what}.log"));
            let out = File::create(&log).with_context(|| format!("cannot write {}", log.display()))?;
            let mut command = Command::new(daemon);
            command.arg(what).arg("--scene").arg(&files.scene).args(["--domain", domain]).args(extra);
            command.stdin(Stdio::null()).stdout(out.try_clone()?).stderr(out);
            let child = command.spawn().with_context(|| format!("cannot start {}", daemon.display()))?;
            daemons.running.push((child, log));
        }
        Ok(daemons)
    }

    /// Fails with the last words of a daemon that has ended.
    pub fn check(&mut self) -> anyhow::Result<()> {
        for (child, log) in &mut self.running {
            if let Some(status) = child.try_wait()? {
                let text = std::fs::read_to_string(log).unwrap_or_default();
                let words: Vec<&str> = text.lines().rev().take(3).collect();
                anyhow::bail!("a daemon ended early ({status}): {}", words.join(" | "));
            }
        }
        Ok(())
    }

    /// Asks both to stop, the bridge first, and kills what does not.
    pub fn stop(&mut self) {
        for (mut child, _) in self.running.drain(..).rev() {
            end(&mut child);
        }
    }
}

impl Drop for Daemons {
    fn drop(&mut self) {
        self.stop();
    }
}

/// SIGTERM first: SIGKILL would leave shared memory behind.
fn end(child: &mut Child) {
    let asked = runtime::process::terminate(child);
    let until = Instant::now() + STOP_PATIENCE;
    while asked.is_ok() && Instant::now() < until {
        if !matches!(child.try_wait(), Ok(None)) {
            return;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    // Errors here mean that it is gone already.
    let _ = child.kill();
    let _ = child.wait();
}
