//! Bounded retries while others create or remove the same resource, and which resource is exhausted when a port cannot be created.

use crate::WireError;
use crate::leftover::Places;
use crate::sys::SHM_DIR;
use std::path::Path;
use std::time::{Duration, Instant};

/// How long to wait for others who create or remove the same topic.
const FLUX_TIMEOUT: Duration = Duration::from_secs(2);
/// How long a program whose place is taken waits for others that are just creating something, to remove leftovers then.
const SWEEP_PATIENCE: Duration = Duration::from_millis(200);
/// Pause between tries; the others need a few hundred microseconds.
const FLUX_PAUSE: Duration = Duration::from_millis(2);

/// Why a try failed.
pub(crate) enum Refusal {
    /// For good.
    Final(WireError),
    /// For good, unless the places that are taken are those of dead programs.
    Full(WireError),
    /// Because another program is creating or removing resources, or died while doing so.
    Passing(String),
}

/// Tries until success, a final refusal, or [`FLUX_TIMEOUT`]. What dead programs left is removed between two tries.
pub(crate) fn within<T>(
    places: &Places,
    name: &str,
    mut attempt: impl FnMut() -> Result<T, Refusal>,
) -> Result<T, WireError> {
    let begin = Instant::now();
    let mut tries = 0;
    // Before a try all leftovers were removed, by this program or by another one that starts at the same time.
    let mut is_swept = false;
    loop {
        tries += 1;
        let tried = locked(places, &mut attempt)?;
        let refusal = match tried {
            Ok(done) => return Ok(done),
            Err(Refusal::Final(WireError::NoSuchTopic { topic })) => {
                return Err(WireError::NoSuchTopic { topic });
            }
            Err(refusal) => refusal,
        };
        if let Some(error) = exhausted_resource(name, places) {
            return Err(error);
        }
        let over = begin.elapsed() > FLUX_TIMEOUT;
        match refusal {
            Refusal::Final(error) => return Err(error),
            Refusal::Full(error) if over || is_swept => return Err(error),
            Refusal::Passing(cause) if over => {
                return Err(WireError::InFlux { topic: name.into(), tries, cause });
            }
            Refusal::Full(_) => (_, is_swept) = places.try_sweep(SWEEP_PATIENCE),
            Refusal::Passing(_) => {
                places.sweep(FLUX_PAUSE);
                std::thread::sleep(FLUX_PAUSE);
            }
        }
    }
}

/// One try under the start lock, which keeps other programs from removing our incomplete resources.
fn locked<T>(
    places: &Places,
    attempt: impl FnOnce() -> Result<T, Refusal>,
) -> Result<Result<T, Refusal>, WireError> {
    let path = || places.lock_path().display().to_string();
    let lock = places.lock_to_create(FLUX_TIMEOUT).map_err(|error| {
        let cause = format!("{}: {error}", path());
        exhausted_resource(&path(), places).unwrap_or(WireError::Node { cause })
    })?;
    let waited_ms = FLUX_TIMEOUT.as_millis() as u64;
    let _lock = lock.ok_or_else(|| WireError::StartLocked { path: path(), waited_ms })?;
    Ok(match places.empty_segment() {
        Some(path) => Err(Refusal::Passing(format!(
            "{} has no size: it is being made, or was truncated",
            path.display()
        ))),
        None => attempt(),
    })
}

// ---- which resource is exhausted: iceoryx2 reports all of them as an internal failure ----

/// Names what is used up; `None`: it was something else.
fn exhausted_resource(name: &str, places: &Places) -> Option<WireError> {
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
    let status = file_system(folder)?;
    let cause = match (status.f_files > 0 && status.f_favail == 0, blocks_count && status.f_bavail == 0) {
        (true, _) => "all inodes are in use",
        (false, true) => "the file system is full",
        (false, false) => return None,
    };
    let (name, folder) = (name.to_owned(), folder.display().to_string());
    Some(WireError::NoFiles { name, folder, cause: cause.to_owned() })
}

/// Free space of the file system of `folder`; `None` on errors.
pub(super) fn file_system(folder: &Path) -> Option<libc::statvfs> {
    let path = std::ffi::CString::new(folder.as_os_str().as_encoded_bytes()).ok()?;
    // SAFETY: all-zero is a valid statvfs; the path is a C string that lives across the call.
    let (code, status) = unsafe {
        let mut status: libc::statvfs = std::mem::zeroed();
        (libc::statvfs(path.as_ptr(), &mut status), status)
    };
    (code == 0).then_some(status)
}

#[cfg(test)]
#[path = "../../tests/unit/port_retry.rs"]
mod tests;
