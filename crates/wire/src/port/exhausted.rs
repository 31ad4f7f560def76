//! Exhausted resource when a port cannot be created. iceoryx2 reports all of them as an internal failure.

use crate::WireError;
use crate::leftover::Places;
use crate::sys::SHM_DIR;
use std::path::Path;

/// Names what is used up; `None`: it was something else.
pub(crate) fn named(name: &str, places: &Places) -> Option<WireError> {
    // Shared memory that is full is named where it is reserved, with the bytes that are missing.
    too_many_files(name)
        .or_else(|| full(name, &places.root, true))
        .or_else(|| full(name, Path::new(SHM_DIR), false))
}

/// Files that making one port may have open at the same time. What failed has closed its own again.
const FILES_OF_A_PORT: usize = 16;

fn too_many_files(name: &str) -> Option<WireError> {
    let probes: Result<Vec<_>, _> = (0..FILES_OF_A_PORT).map(|_| std::fs::File::open("/dev/null")).collect();
    let error = probes.err()?;
    let used_up = matches!(error.raw_os_error(), Some(libc::EMFILE | libc::ENFILE));
    used_up.then(|| WireError::TooManyFiles {
        name: name.to_owned(),
        cause: error.to_string(),
        limit: limit(),
    })
}

/// Files that this process may have open.
fn limit() -> u64 {
    let mut limit = libc::rlimit { rlim_cur: 0, rlim_max: 0 };
    // SAFETY: `limit` is a valid, writable structure.
    unsafe { libc::getrlimit(libc::RLIMIT_NOFILE, &mut limit) };
    limit.rlim_cur
}

fn full(name: &str, folder: &Path, blocks_count: bool) -> Option<WireError> {
    let status = status(folder)?;
    let cause = match (status.f_files > 0 && status.f_favail == 0, blocks_count && status.f_bavail == 0) {
        (true, _) => "all inodes are in use",
        (false, true) => "the file system is full",
        (false, false) => return None,
    };
    let (name, folder) = (name.to_owned(), folder.display().to_string());
    Some(WireError::NoFiles { name, folder, cause: cause.to_owned() })
}

/// Free space of the file system of `folder`; `None` on errors.
pub(super) fn status(folder: &Path) -> Option<libc::statvfs> {
    let path = std::ffi::CString::new(folder.as_os_str().as_encoded_bytes()).ok()?;
    // SAFETY: all-zero is a valid statvfs; the path is a C string that lives across the call.
    let (code, status) = unsafe {
        let mut status: libc::statvfs = std::mem::zeroed();
        (libc::statvfs(path.as_ptr(), &mut status), status)
    };
    (code == 0).then_some(status)
}
