//! Query of the operating system whether any process has a file open or mapped.

use std::fs::{File, Metadata, OpenOptions};
use std::io::ErrorKind;
use std::os::fd::AsRawFd;
use std::os::unix::fs::{FileTypeExt, MetadataExt, OpenOptionsExt};
use std::os::unix::net::UnixDatagram;
use std::path::Path;

/// `fcntl` command for the signal on an open of a leased file (not in the `libc` crate for glibc).
const F_SETSIG: libc::c_int = 10;

/// Removes the file (or socket) at `path` if no process has it open or mapped. Returns whether it was removed.
pub(super) fn remove(path: &Path) -> bool {
    let Ok(metadata) = std::fs::symlink_metadata(path) else { return false };
    if metadata.file_type().is_socket() {
        return is_dead_socket(path) && std::fs::remove_file(path).is_ok();
    }
    // During the lease no other process has this file open, so none is about to remove it.
    lease(path, &metadata)
        .is_some_and(|file| names_this_file(path, &file) && std::fs::remove_file(path).is_ok())
}

/// Whether some process has the file at `path` open or mapped. A file that is not there is not in use.
pub(super) fn is_in_use(path: &Path) -> bool {
    std::fs::symlink_metadata(path).is_ok_and(|metadata| lease(path, &metadata).is_none())
}

/// Opens the file if no other process has it open. Later opens wait until the returned file is closed.
///
/// The operating system grants a write lease (`fcntl(2)`, `F_SETLEASE`) only if the file is open nowhere else; a mapping keeps
/// its file open. `None`: the file is in use, or the query failed.
fn lease(path: &Path, metadata: &Metadata) -> Option<File> {
    let readable = metadata.mode() & 0o400 != 0;
    let file = OpenOptions::new()
        .read(readable)
        .write(!readable)
        .custom_flags(libc::O_NOFOLLOW | libc::O_NONBLOCK)
        .open(path)
        .ok()?;
    let fd = file.as_raw_fd();
    // SAFETY: the descriptor is open for both calls, which take a plain number. SIGURG is ignored by default; the usual
    // signal of a lease, SIGIO, would end the process.
    let granted = unsafe {
        libc::fcntl(fd, F_SETSIG, libc::SIGURG) == 0 && libc::fcntl(fd, libc::F_SETLEASE, libc::F_WRLCK) == 0
    };
    granted.then_some(file)
}

/// Whether `path` still names the open `file`, and not a newer one of the same name.
pub(crate) fn names_this_file(path: &Path, file: &File) -> bool {
    match (std::fs::symlink_metadata(path), file.metadata()) {
        (Ok(named), Ok(open)) => (named.dev(), named.ino()) == (open.dev(), open.ino()),
        _ => false,
    }
}

/// True if no process has the datagram socket bound: connections are then refused.
fn is_dead_socket(path: &Path) -> bool {
    let connected = UnixDatagram::unbound().and_then(|socket| socket.connect(path));
    connected.is_err_and(|error| error.kind() == ErrorKind::ConnectionRefused)
}

#[cfg(test)]
#[path = "../../tests/unit/leftover_unused.rs"]
mod tests;
