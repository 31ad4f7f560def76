//! Retention of a series of files: the newest, limited by number, size and free space.

use std::collections::VecDeque;
use std::fs::{self, File, TryLockError};
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::store::Store;

/// Limits of a series, including files of earlier runs. The newest file, and those that a recorder writes, are never removed.
#[derive(Debug, Clone, Copy, Default)]
pub struct Retention {
    /// At most this many files.
    pub files: Option<usize>,
    /// At most this many bytes together. A file is ended at a quarter of them at the latest.
    pub total_bytes: Option<u64>,
    /// At least this much free in the file system.
    pub free: Option<FreeSpace>,
}

/// Space kept free in the file system.
#[derive(Debug, Clone, Copy)]
pub struct FreeSpace {
    pub bytes: u64,
    /// Free bytes in the file system of a path.
    pub measure: fn(&Path) -> io::Result<u64>,
}

impl Retention {
    fn is_any(&self) -> bool {
        self.files.is_some() || self.total_bytes.is_some() || self.free.is_some()
    }
}

/// A file of the series that is no longer written.
#[derive(Debug)]
struct Closed {
    path: PathBuf,
    bytes: u64,
    /// True for files of this run.
    is_own: bool,
}

/// The files of a series but the one that is written.
#[derive(Debug)]
pub(crate) struct SeriesFiles {
    folder: PathBuf,
    retention: Retention,
    closed: VecDeque<Closed>,
    removed: u64,
}

impl SeriesFiles {
    /// `earlier`: files of earlier runs, oldest first.
    pub(crate) fn new(folder: PathBuf, retention: Retention, earlier: Vec<PathBuf>) -> Self {
        let mut files = Self { folder, retention, closed: VecDeque::new(), removed: 0 };
        earlier.into_iter().for_each(|path| files.push(path, false));
        files
    }

    /// Adds a file that was closed.
    pub(crate) fn push(&mut self, path: PathBuf, is_own: bool) {
        let bytes = fs::metadata(&path).map_or(0, |about| about.len());
        self.closed.push_back(Closed { path, bytes, is_own });
    }

    /// Bytes and number of the closed files.
    pub(crate) fn closed(&self) -> (u64, usize) {
        (self.closed.iter().map(|file| file.bytes).sum(), self.closed.len())
    }

    /// Files removed.
    pub(crate) fn removed(&self) -> u64 {
        self.removed
    }

    /// The closed files of this run that are still there.
    pub(crate) fn own(&self) -> impl Iterator<Item = &PathBuf> {
        self.closed.iter().filter(|file| file.is_own).map(|file| &file.path)
    }

    /// Removes the oldest files beyond what is to be kept; `current_bytes` is the size of the file that is written.
    pub(crate) fn enforce(&mut self, current_bytes: u64) {
        while self.is_too_much(current_bytes) && self.remove_oldest() {}
    }

    fn is_too_much(&self, current_bytes: u64) -> bool {
        let Retention { files, total_bytes, free } = self.retention;
        let (bytes, count) = self.closed();
        let free = free.filter(|_| count > 0);
        files.is_some_and(|most| count + 1 > most.max(1))
            || total_bytes.is_some_and(|most| bytes + current_bytes > most)
            // A file system that cannot be asked is no reason to remove anything.
            || free.is_some_and(|free| (free.measure)(&self.folder).is_ok_and(|found| found < free.bytes))
    }

    /// Removes the oldest file that no recorder writes; false if there is none. A failed removal is ignored.
    fn remove_oldest(&mut self) -> bool {
        self.closed.retain(|file| file.path.exists());
        let Some(at) = self.closed.iter().position(|file| remove_unused(&file.path)) else { return false };
        self.closed.remove(at);
        self.removed += 1;
        true
    }

    /// After a write that found the disk full: true when a file was removed and it may be tried again.
    pub(crate) fn make_room(&mut self) -> bool {
        self.retention.is_any() && self.remove_oldest()
    }
}

/// A recorder holds a lock on the file that it writes.
fn remove_unused(path: &Path) -> bool {
    let is_written = |file: File| matches!(file.try_lock(), Err(TryLockError::WouldBlock));
    File::open(path).is_ok_and(|file| !is_written(file)) && fs::remove_file(path).is_ok()
}

/// Shared between a file that is written and what looks after the series.
#[derive(Debug, Clone)]
pub(crate) struct SharedFiles(Arc<Mutex<SeriesFiles>>);

impl SharedFiles {
    pub(crate) fn new(files: SeriesFiles) -> Self {
        Self(Arc::new(Mutex::new(files)))
    }

    pub(crate) fn lock(&self) -> MutexGuard<'_, SeriesFiles> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A store of a series: when the disk is full, the oldest files of the series make room and nothing is lost.
#[derive(Debug)]
pub(crate) struct RoomyStore<S> {
    store: S,
    files: SharedFiles,
}

impl<S: Store> RoomyStore<S> {
    pub(crate) fn new(store: S, files: SharedFiles) -> Self {
        Self { store, files }
    }

    pub(crate) fn inner(&self) -> &S {
        &self.store
    }

    fn with_room<T>(&mut self, mut attempt: impl FnMut(&mut S) -> io::Result<T>) -> io::Result<T> {
        with_room(&self.files, || attempt(&mut self.store))
    }
}

/// Tries again as long as the disk is full and a file of the series can be removed.
pub(crate) fn with_room<T>(files: &SharedFiles, mut attempt: impl FnMut() -> io::Result<T>) -> io::Result<T> {
    loop {
        match attempt() {
            Err(error) if is_full(&error) && files.lock().make_room() => {}
            other => return other,
        }
    }
}

fn is_full(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::StorageFull | ErrorKind::QuotaExceeded)
}

impl<S: Store> Write for RoomyStore<S> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.with_room(|store| store.write(bytes))
    }

    fn flush(&mut self) -> io::Result<()> {
        self.with_room(Write::flush)
    }
}

impl<S: Store> Store for RoomyStore<S> {
    fn cut_to(&mut self, len: u64) -> io::Result<()> {
        self.store.cut_to(len)
    }

    fn sync(&mut self) -> io::Result<()> {
        self.with_room(Store::sync)
    }
}

#[cfg(test)]
#[path = "../tests/unit/retention.rs"]
mod tests;
