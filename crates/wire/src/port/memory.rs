//! Shared memory of a writer: its right to write a topic, and the reservation of all pages at its start.
//!
//! Segments are sparse: a full /dev/shm shows itself only when a page is touched first, as a SIGBUS. Reserving all pages right after
//! creation turns that into a clean error at start-up.

use super::retry::{Refusal, file_system};
use crate::leftover::{Places, names_this_file};
use crate::sys::SHM_DIR;
use crate::{Topic, WireError};
use iceoryx2::prelude::SemanticString;
use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, Read, Write};
use std::os::fd::AsRawFd;
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU8, Ordering};

/// The smallest page of any machine we run on.
const PAGE_BYTES: usize = 4096;

/// Reserves all pages of the data segment of the writer with id `writer_id`.
pub(crate) fn reserve(places: &Places, topic: &Topic, writer_id: u128) -> Result<(), WireError> {
    let no_memory = |needed_bytes: u64, cause: String| WireError::NoMemory {
        topic: topic.name().to_owned(),
        needed_bytes,
        cause,
    };
    let path = find(places, writer_id)
        .ok_or_else(|| no_memory(0, format!("the writer's data segment is not in {SHM_DIR}")))?;
    let file = open(&path).map_err(|error| no_memory(0, format!("{error} ({})", path.display())))?;
    let length = file.metadata().map_err(|error| no_memory(0, error.to_string()))?.len();
    // SAFETY: the descriptor is open for writing for the whole call; the range is the file's own length.
    let code = unsafe { libc::posix_fallocate(file.as_raw_fd(), 0, length as libc::off_t) };
    match code {
        0 => require_headroom(topic.name(), length),
        code => Err(no_memory(length, std::io::Error::from_raw_os_error(code).to_string())),
    }
}

/// Connections and management data come and go with every program; they are small, but they are sparse too.
const HEADROOM_BYTES: u64 = 1 << 20;

/// Refuses to go on when less than [`HEADROOM_BYTES`] are left for what programs need beside their samples.
pub(crate) fn require_headroom(whom: &str, reserved_bytes: u64) -> Result<(), WireError> {
    match free_bytes() {
        Some(free) if free < HEADROOM_BYTES => Err(WireError::NoMemory {
            topic: whom.to_owned(),
            needed_bytes: reserved_bytes + HEADROOM_BYTES,
            cause: format!("{free} bytes are left, {HEADROOM_BYTES} are needed in addition to the samples"),
        }),
        _ => Ok(()),
    }
}

/// Refuses a sample of `bytes` that /dev/shm cannot take now: for memory that grows on demand, off the real-time path.
pub(crate) fn require_room(whom: &str, bytes: u64) -> Result<(), WireError> {
    match free_bytes() {
        Some(free) if bytes > 0 && free < bytes + HEADROOM_BYTES => Err(WireError::NoMemory {
            topic: whom.to_owned(),
            needed_bytes: bytes + HEADROOM_BYTES,
            cause: format!("{free} bytes are left"),
        }),
        _ => Ok(()),
    }
}

/// Free space where shared memory lives; `None` where the system does not say.
fn free_bytes() -> Option<u64> {
    let status = file_system(Path::new(SHM_DIR))?;
    Some(status.f_bavail.saturating_mul(status.f_frsize))
}

/// Maps the pages of the writer's data segment into this process ahead of their first use, so that no page fault falls
/// into the loop. Returns the bytes mapped.
pub(crate) fn prefault(places: &Places, writer_id: u128) -> std::io::Result<u64> {
    let path = find(places, writer_id).ok_or(ErrorKind::NotFound)?;
    let maps = std::fs::read_to_string("/proc/self/maps")?;
    let mut mapped = 0;
    for line in maps.lines().filter(|line| line.ends_with(&*path.to_string_lossy())) {
        let mut words = line.split_whitespace();
        let range = words.next().and_then(|range| range.split_once('-'));
        // A reader in the same process has its own read-only mapping.
        if !words.next().is_some_and(|rights| rights.starts_with("rw")) {
            continue;
        }
        let parse = |text: &str| usize::from_str_radix(text, 16).ok();
        let Some((begin, end)) = range.and_then(|(a, b)| Some((parse(a)?, parse(b)?))) else { continue };
        for page in (begin..end).step_by(PAGE_BYTES) {
            // SAFETY: the address is inside a live, writable mapping of this process (just read from /proc/self/maps;
            // the writer that owns it is borrowed by our caller); an atomic `or` with 0 changes no byte for any
            // other reader.
            let byte = unsafe { AtomicU8::from_ptr(page as *mut u8) };
            byte.fetch_or(0, Ordering::Relaxed);
        }
        mapped += (end - begin) as u64;
    }
    Ok(mapped)
}

fn open(path: &Path) -> std::io::Result<File> {
    OpenOptions::new().read(true).write(true).open(path)
}

/// The digits between the prefix and a writer's number, which are the same in all names of samples' memory.
static DIGITS: OnceLock<String> = OnceLock::new();

fn find(places: &Places, writer_id: u128) -> Option<PathBuf> {
    let suffix = places.config.global.service.data_segment_suffix;
    let end = format!("_{writer_id}{}", String::from_utf8_lossy(suffix.as_bytes()));
    let known = DIGITS.get().map(|digits| Path::new(SHM_DIR).join(format!("{}{digits}{end}", places.prefix)));
    if let Some(path) = known.filter(|path| path.exists()) {
        return Some(path);
    }
    let entries = std::fs::read_dir(SHM_DIR).ok()?;
    entries.flatten().map(|entry| entry.path()).find(|path| {
        let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let digits = name.strip_prefix(&places.prefix).and_then(|rest| rest.strip_suffix(&end));
        digits.map(|digits| DIGITS.get_or_init(|| digits.to_owned())).is_some()
    })
}

// ---- the right to write ----
//
// One lock file per written topic refuses a second writer even if the management folder was emptied and iceoryx2 no longer knows the
// first one.

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
