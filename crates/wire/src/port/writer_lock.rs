//! One lock file for each topic that is written, in /dev/shm: it keeps a second writer away even when the domain's folder
//! was emptied and iceoryx2 no longer knows of the first one.

use super::retry::Refusal;
use crate::WireError;
use crate::leftover::{Places, names_this_file};
use std::cell::RefCell;
use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, Read, Write};
use std::os::fd::AsRawFd;
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Pause between two tries: a fraction of a reading's period at 1 kHz.
pub(super) const PAUSE: Duration = Duration::from_micros(100);

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
        let options =
            OpenOptions::new().read(true).write(true).create(true).truncate(false).mode(0o600).clone();
        let mut file = options.open(&path).map_err(refused)?;
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

impl WriterLock {
    /// Whether somebody who lives holds the lock of this file.
    pub(crate) fn is_held(path: &Path) -> bool {
        let Ok(file) = File::open(path) else { return false };
        // SAFETY: the descriptor is open for the whole call; closing it gives the lock back.
        let code = unsafe { libc::flock(file.as_raw_fd(), libc::LOCK_SH | libc::LOCK_NB) };
        code != 0 && std::io::Error::last_os_error().kind() == ErrorKind::WouldBlock
    }
}

/// A writer's right, which it may give away and take again.
#[derive(Debug)]
pub(crate) struct Right {
    places: Places,
    topic: String,
    lock: RefCell<Option<WriterLock>>,
}

impl Right {
    /// Nobody's yet, or taken already.
    pub(crate) fn new(places: &Places, topic: &str, lock: Option<WriterLock>) -> Self {
        Self { places: places.clone(), topic: topic.to_owned(), lock: RefCell::new(lock) }
    }

    /// Takes it, if nobody else has it.
    pub(crate) fn take(&self) -> Result<(), WireError> {
        if self.lock.borrow().is_some() {
            return Ok(());
        }
        let lock = try_until(Instant::now(), || WriterLock::take(&self.places, &self.topic, ""))?;
        *self.lock.borrow_mut() = Some(lock);
        Ok(())
    }

    /// Gives it away.
    pub(crate) fn give(&self) {
        *self.lock.borrow_mut() = None;
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

/// Tries to take a lock until it is free or the time is over.
pub(crate) fn try_until(
    end: Instant,
    mut take: impl FnMut() -> Result<WriterLock, Refusal>,
) -> Result<WriterLock, WireError> {
    loop {
        match take() {
            Ok(lock) => return Ok(lock),
            Err(Refusal::Passing(_)) => {}
            Err(Refusal::Final(error) | Refusal::Full(error)) if Instant::now() >= end => return Err(error),
            Err(_) => {}
        }
        std::thread::sleep(PAUSE);
    }
}
