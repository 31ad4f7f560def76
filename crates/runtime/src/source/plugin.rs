//! A user's program as a sensor: its output is the lines, its error output goes to the log. It ends with the bridge, even
//! after a kill.

use super::lines::LineBuffer;
use super::log_limit::LimitedLog;
use serde::{Deserialize, Serialize};
use std::io;
use std::os::fd::OwnedFd;
use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use tokio::io::AsyncReadExt;
use tokio::net::unix::pipe::Receiver;

/// A program with its arguments.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct PluginSpec {
    /// The program, found by PATH, or with a slash from the scene's folder; then its arguments.
    pub(super) command: Vec<String>,
    /// It runs in this folder, the scene file's.
    pub(super) folder: PathBuf,
}

impl PluginSpec {
    /// Text for the log.
    pub(super) fn place(&self) -> String {
        self.command.first().cloned().unwrap_or_default()
    }

    /// Starts the program in a separate process group.
    pub(super) fn start(&self) -> io::Result<Plugin> {
        let name = self.place();
        let folder = std::path::absolute(&self.folder)?;
        let program = if name.contains('/') { folder.join(&name) } else { PathBuf::from(&name) };
        let mut command = Command::new(program);
        command.args(self.command.iter().skip(1)).current_dir(folder).process_group(0);
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let parent = std::process::id();
        // SAFETY: between fork and exec only system calls that are safe after a fork; nothing is allocated.
        unsafe {
            command.pre_exec(move || {
                // A bridge that is killed takes the program with it; a bridge that is gone already has none.
                if libc::prctl(libc::PR_SET_PDEATHSIG, libc::SIGKILL) != 0 {
                    return Err(io::Error::last_os_error());
                }
                if libc::getppid().cast_unsigned() != parent {
                    return Err(io::Error::from_raw_os_error(libc::ESRCH));
                }
                Ok(())
            });
        }
        let mut child = command.spawn()?;
        let said = child.stdout.take().map(OwnedFd::from);
        let complained = child.stderr.take().map(OwnedFd::from);
        let plugin = |said| Plugin { child, said };
        let (Some(said), Some(complained)) = (said, complained) else {
            return Err(io::Error::other("the program has no output"));
        };
        let plugin = plugin(Receiver::from_owned_fd(said)?);
        tokio::spawn(log(name, Receiver::from_owned_fd(complained)?));
        Ok(plugin)
    }
}

/// A program that runs. Dropping it kills the program and what it has started.
#[derive(Debug)]
pub(super) struct Plugin {
    child: Child,
    said: Receiver,
}

impl Plugin {
    pub(super) async fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        self.said.read(bytes).await
    }
}

impl Drop for Plugin {
    fn drop(&mut self) {
        let group = self.child.id().cast_signed();
        // SAFETY: the child is not waited for yet, so its group is still its own.
        unsafe { libc::kill(-group, libc::SIGKILL) };
        let _killed = self.child.wait();
    }
}

/// Hands what the program complains of to the log.
async fn log(name: String, mut complained: Receiver) {
    let (mut buffer, mut bytes, mut log) = (LineBuffer::default(), [0; 1024], LimitedLog::new(name.clone()));
    let mut take = |line: &[u8]| {
        let line = String::from_utf8_lossy(line);
        if log.admits(&line) {
            tracing::warn!("{name}: {line}");
        }
    };
    while let Ok(count) = complained.read(&mut bytes).await
        && count > 0
    {
        buffer.split(bytes.get(..count).unwrap_or_default(), &mut take);
    }
    buffer.split(b"\n", take); // its last words may have no end
}
