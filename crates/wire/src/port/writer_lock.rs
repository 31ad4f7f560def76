//! One lock file per written topic, in /dev/shm: it refuses a second writer even if the management folder was emptied and
//! iceoryx2 no longer knows the first one.

use super::retry::Refusal;
use crate::WireError;
use crate::leftover::{Places, names_this_file};
use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, Read, Write};
use std::os::fd::AsRawFd;
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::PathBuf;

/// The right to write a topic. Given back when dropped; the kernel takes it back from a program that is killed.
#[derive(Debug)]
pub(crate) struct WriterLock {
    path: PathBuf,
    file: File,
}

impl WriterLock {
    /// Takes the right to write `topic`; `owner` is who does, for the message to a second writer, or empty.
    pub(crate) fn take(places: &Places, topic: &str, owner: &str) -> Result<Self, Refusal> {
        let path = places.writer_lock(topic);
        let refused = |error: std::io::Error| {
            let cause = format!("{}: {error}", path.display());
            Refusal::Final(WireError::Open { topic: topic.to_owned(), cause })
        };
        let mut options = OpenOptions::new();
        options.read(true).write(true).create(true).custom_flags(libc::O_NOFOLLOW).mode(0o600);
        let taken = || Refusal::Passing(format!("another user took the name {} just now", path.display()));
        let mut file = options.open(&path).map_err(|error| match error.kind() {
            ErrorKind::PermissionDenied => taken(),
            _ => refused(error),
        })?;
        if file.metadata().map_err(refused)?.uid() != crate::sys::uid() {
            return Err(taken());
        }
        // SAFETY: the descriptor is open for the whole call.
        if unsafe { libc::flock(file.as_raw_fd(), libc::LOCK_EX | libc::LOCK_NB) } != 0 {
            let error = std::io::Error::last_os_error();
            return Err(match error.kind() {
                ErrorKind::WouldBlock => Refusal::Final(already_published(topic, &mut file)),
                _ => refused(error),
            });
        }
        if !names_this_file(&path, &file) {
            return Err(Refusal::Passing(format!("{} was removed at the same time", path.display())));
        }
        // Number and name only help a reader of the message; the lock is what counts.
        let _ = file.set_len(0).and_then(|()| writeln!(file, "{} {owner}", std::process::id()));
        Ok(Self { path, file })
    }
}

impl Drop for WriterLock {
    fn drop(&mut self) {
        if names_this_file(&self.path, &self.file) {
            let _gone_is_fine = std::fs::remove_file(&self.path);
        }
    }
}

fn already_published(topic: &str, file: &mut File) -> WireError {
    let mut text = String::new();
    let _unreadable_is_unnamed = file.read_to_string(&mut text);
    let (number, owner) = text.trim().split_once(' ').unwrap_or((text.trim(), ""));
    let named = if owner.is_empty() { String::new() } else { format!("`{owner}`, ") };
    let holder = number.parse::<u32>().map(|pid| format!(" ({named}process {pid})")).unwrap_or_default();
    WireError::AlreadyPublished { topic: topic.to_owned(), holder }
}
