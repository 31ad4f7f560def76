//! Clock, process runs, scheduling and transport of the operating system.

/// The transport: inter-process, single-threaded ports.
pub(crate) type Ipc = iceoryx2::prelude::ipc::Service;

/// Folder of POSIX shared memory.
pub(crate) const SHM_DIR: &str = "/dev/shm";

/// Suffix of the name of an open file that was removed.
pub(crate) const REMOVED: &str = " (deleted)";

/// This process's user.
pub(crate) fn uid() -> u32 {
    // SAFETY: the call has no arguments and cannot fail.
    unsafe { libc::geteuid() }
}

/// Nanoseconds of the machine's monotonic clock (since boot, the same in every process, never stepped).
///
/// All time stamps on the wire are of this clock, so a step of the wall clock changes nothing.
pub fn now_ns() -> u64 {
    let mut time = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: `time` is a valid, writable timespec and the clock id is a constant of the operating system.
    unsafe { libc::clock_gettime(libc::CLOCK_MONOTONIC, &mut time) };
    // The monotonic clock is never negative, and 2^64 ns are 584 years.
    (time.tv_sec as u64).wrapping_mul(1_000_000_000).wrapping_add(time.tv_nsec as u64)
}

/// A random number that identifies a run of a program; readers detect a restart of the sender by it. It is never zero: zero
/// means "no sender yet".
pub fn boot_id() -> u64 {
    // The system's random numbers fail only on kernels without the call; the start time tells runs apart there.
    getrandom::u64().unwrap_or_else(|_| now_ns()) | 1
}

/// Makes the calling thread one that interrupts no other when it wakes (`SCHED_BATCH`): it runs as soon as a core is idle. Needs no
/// rights; a thread with real-time rights keeps them.
pub fn background_thread() {
    let parameters = libc::sched_param { sched_priority: 0 };
    // SAFETY: the parameters live across the call; 0 means the calling thread.
    unsafe {
        if libc::sched_getscheduler(0) == libc::SCHED_OTHER {
            let _ordinary_otherwise = libc::sched_setscheduler(0, libc::SCHED_BATCH, &parameters);
        }
    }
}

#[cfg(test)]
#[path = "../tests/unit/sys.rs"]
mod tests;
