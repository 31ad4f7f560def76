//! Resources of the machine: space in a file system, limits of this process.

use std::ffi::CString;
use std::io;
use std::os::unix::ffi::OsStrExt;
use std::path::Path;

/// Space in a file system, bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Space {
    /// Free for this user.
    pub free_bytes: u64,
    pub total_bytes: u64,
}

/// Space in the file system of `path`.
pub fn space(path: &Path) -> io::Result<Space> {
    let found = file_system(path)?;
    let bytes = |blocks: u64| blocks.saturating_mul(found.f_frsize as u64);
    Ok(Space { free_bytes: bytes(found.f_bavail), total_bytes: bytes(found.f_blocks) })
}

/// Whether the files of `path` live in memory, where opening or removing one waits for no disk.
pub fn is_in_memory(path: &Path) -> io::Result<bool> {
    let kind = file_system(path)?.f_type;
    Ok(kind == libc::TMPFS_MAGIC || kind == RAMFS_MAGIC)
}

/// The file system of `path`.
fn file_system(path: &Path) -> io::Result<libc::statfs> {
    let path = CString::new(path.as_os_str().as_bytes())?;
    // SAFETY: an all-zero `statfs` is a valid value of this plain C structure.
    let mut found: libc::statfs = unsafe { std::mem::zeroed() };
    // SAFETY: `path` is a terminated string and `found` is writable; both live across the call.
    if unsafe { libc::statfs(path.as_ptr(), &mut found) } != 0 {
        return Err(io::Error::last_os_error());
    }
    Ok(found)
}

/// Number of a ramfs (linux/magic.h).
const RAMFS_MAGIC: libc::__fsword_t = 0x8584_58f6;

/// Whether this process may write to `path`.
pub fn is_writable(path: &Path) -> bool {
    let Ok(path) = CString::new(path.as_os_str().as_bytes()) else { return false };
    // SAFETY: `path` is a terminated string that lives across the call.
    unsafe { libc::access(path.as_ptr(), libc::W_OK) == 0 }
}

/// Largest SCHED_FIFO priority this process may take; `None`: any (root).
pub fn fifo_priority_limit() -> Option<u64> {
    if is_root() { None } else { limit(libc::RLIMIT_RTPRIO) }
}

/// Memory this process may lock, bytes; `None`: all.
pub fn locked_memory_limit() -> Option<u64> {
    if is_root() { None } else { limit(libc::RLIMIT_MEMLOCK) }
}

fn is_root() -> bool {
    // SAFETY: the call has no arguments and cannot fail.
    unsafe { libc::geteuid() == 0 }
}

/// `None`: no limit. A limit that cannot be read counts as none: the refusal itself comes with its own message.
fn limit(resource: libc::__rlimit_resource_t) -> Option<u64> {
    let mut found = libc::rlimit { rlim_cur: 0, rlim_max: 0 };
    // SAFETY: `found` is writable across the call and the resource is a constant the kernel knows.
    let known = unsafe { libc::getrlimit(resource, &mut found) } == 0;
    (known && found.rlim_cur != libc::RLIM_INFINITY).then_some(found.rlim_cur)
}

#[cfg(test)]
#[path = "../tests/unit/machine.rs"]
mod tests;
