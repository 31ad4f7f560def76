//! Start lock of a shared-memory domain's folder: shared while a program creates resources, exclusive while leftovers are removed.
//!
//! The operating system releases it when its holder ends.

use super::places::{LOCK_FILE, Places};
use super::unused::names_this_file;
use std::fs::{DirBuilder, File, OpenOptions};
use std::io::{self, ErrorKind};
use std::os::fd::AsRawFd;
use std::os::unix::fs::{DirBuilderExt, OpenOptionsExt};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Pause between two tries. `flock` itself cannot wait with an end.
const PAUSE: Duration = Duration::from_millis(1);

/// A held start lock; given back when dropped.
#[derive(Debug)]
pub(crate) struct StartLock {
    _file: File,
}

impl Places {
    pub(crate) fn lock_path(&self) -> PathBuf {
        self.root.join(LOCK_FILE)
    }

    /// Takes the shared lock. `None` if a program removed leftovers for longer than `patience`.
    ///
    /// # Errors
    /// The folder or the lock file cannot be created.
    pub(crate) fn lock_to_create(&self, patience: Duration) -> io::Result<Option<StartLock>> {
        self.take(libc::LOCK_SH, patience)
    }

    /// Takes the lock alone. `None`: others created something until `patience` was over.
    ///
    /// # Errors
    /// As [`Self::lock_to_create`].
    pub(super) fn lock_to_remove(&self, patience: Duration) -> io::Result<Option<StartLock>> {
        self.take(libc::LOCK_EX, patience)
    }

    fn take(&self, kind: libc::c_int, patience: Duration) -> io::Result<Option<StartLock>> {
        let end = Instant::now() + patience;
        loop {
            let file = self.open_lock()?;
            // SAFETY: the descriptor is open for the whole call.
            let code = unsafe { libc::flock(file.as_raw_fd(), kind | libc::LOCK_NB) };
            if code == 0 && names_this_file(&self.lock_path(), &file) {
                return Ok(Some(StartLock { _file: file }));
            }
            // The file that was locked may have been removed meanwhile; then the new one counts.
            let error = io::Error::last_os_error();
            if code != 0 && !matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) {
                return Err(error);
            }
            if Instant::now() >= end {
                return Ok(None);
            }
            std::thread::sleep(PAUSE);
        }
    }

    fn open_lock(&self) -> io::Result<File> {
        let path = self.lock_path();
        let open = || OpenOptions::new().write(true).create(true).truncate(false).mode(0o600).open(&path);
        open().or_else(|error| {
            if error.kind() != ErrorKind::NotFound {
                return Err(error);
            }
            DirBuilder::new().recursive(true).mode(0o700).create(&self.root)?;
            open()
        })
    }
}
