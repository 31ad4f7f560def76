//! Real-time settings of the process: each is requested, and each refusal is reported once, by name.

use crate::config::Realtime;
use std::fs::{File, OpenOptions};
use std::io::Write as _;
use std::path::Path;

/// A real-time setting that the system refused.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("realtime.{setting}: refused: {cause}; {remedy}")]
pub struct MissingRight {
    /// Key in the settings file.
    pub setting: &'static str,
    pub cause: String,
    pub remedy: &'static str,
}

/// Real-time settings granted until this is dropped, and the refused ones.
#[derive(Debug)]
pub struct Granted {
    pub missing: Vec<MissingRight>,
    /// The request that keeps the cores awake; closing the file withdraws it.
    _awake: Option<File>,
}

/// Applies the settings to the calling thread (cores, scheduler), the process (memory) and the machine (sleep of cores).
pub fn apply(settings: &Realtime) -> Granted {
    let mut granted = Granted { missing: Vec::new(), _awake: None };
    granted._awake =
        granted.request(settings.stay_awake, "stay_awake", AWAKE_REMEDY, || stay_awake(CPU_LATENCY));
    granted.request(
        !settings.cores.is_empty(),
        "cores",
        "name cores that exist and that the process may use",
        || pin(&settings.cores),
    );
    granted.request(
        settings.fifo_priority > 0,
        "fifo_priority",
        "give CAP_SYS_NICE or a real-time limit (LimitRTPRIO= in the unit)",
        || fifo(settings.fifo_priority),
    );
    granted.request(
        settings.lock_memory,
        "lock_memory",
        "give CAP_IPC_LOCK or raise the limit (LimitMEMLOCK=infinity in the unit)",
        lock_memory,
    );
    granted
}

impl Granted {
    /// Requests a setting that is wanted; keeps a refusal for the message.
    fn request<T>(
        &mut self,
        wanted: bool,
        setting: &'static str,
        remedy: &'static str,
        call: impl FnOnce() -> std::io::Result<T>,
    ) -> Option<T> {
        let refused = |cause: std::io::Error| {
            self.missing.push(MissingRight { setting, cause: cause.to_string(), remedy });
        };
        wanted.then(call)?.map_err(refused).ok()
    }
}

const AWAKE_REMEDY: &str =
    "let the user write to /dev/cpu_dma_latency (a udev rule; DeviceAllow= in the unit)";

/// Where Linux takes requests for the longest wake-up a core may have, as an i32 in microseconds.
const CPU_LATENCY: &str = "/dev/cpu_dma_latency";

/// Requests that idle cores poll instead of sleeping: a sleeping core takes tens of microseconds to wake.
fn stay_awake(device: impl AsRef<Path>) -> std::io::Result<File> {
    let mut request = OpenOptions::new().write(true).open(device)?;
    request.write_all(&0_i32.to_ne_bytes())?;
    Ok(request)
}

/// Cores that a set of them has room for.
const CORES: usize = libc::CPU_SETSIZE as usize;

/// Niceness of the side services: on a busy machine the loop comes first.
const SIDE_SERVICE_NICE: i32 = 5;

/// Lets the calling thread run behind the loop. Without it, it only runs at the ordinary priority.
pub fn lower_priority() {
    // SAFETY: takes no pointers; on Linux 0 is the calling thread.
    let _ordinary_otherwise = unsafe { libc::setpriority(libc::PRIO_PROCESS, 0, SIDE_SERVICE_NICE) };
}

/// The calling thread runs on these cores only, and so do the threads and processes that it starts from now on. Needs no rights.
///
/// # Errors
/// Operating-system error: no such core, or none permitted.
pub fn pin(cores: &[usize]) -> std::io::Result<()> {
    // SAFETY: an all-zero cpu_set_t is the empty set; CPU_SET takes numbers below 1024 only; the set lives across the call.
    done(unsafe {
        let mut set: libc::cpu_set_t = std::mem::zeroed();
        for core in cores.iter().filter(|core| **core < CORES) {
            libc::CPU_SET(*core, &mut set);
        }
        libc::sched_setaffinity(0, size_of::<libc::cpu_set_t>(), &set)
    })
}

/// The cores that the calling thread may run on.
pub fn cores() -> std::io::Result<Vec<usize>> {
    // SAFETY: the set lives across the call, which fills it; CPU_ISSET takes numbers below 1024 only.
    unsafe {
        let mut set: libc::cpu_set_t = std::mem::zeroed();
        done(libc::sched_getaffinity(0, size_of::<libc::cpu_set_t>(), &mut set))?;
        Ok((0..CORES).filter(|core| libc::CPU_ISSET(*core, &set)).collect())
    }
}

fn fifo(priority: u8) -> std::io::Result<()> {
    let parameters = libc::sched_param { sched_priority: priority.into() };
    // SAFETY: the parameters live across the call; 0 means the calling thread.
    done(unsafe { libc::sched_setscheduler(0, libc::SCHED_FIFO, &parameters) })
}

fn lock_memory() -> std::io::Result<()> {
    // SAFETY: takes no pointers; at worst it is refused.
    done(unsafe { libc::mlockall(libc::MCL_CURRENT | libc::MCL_FUTURE) })
}

/// Result of a system call from its return code.
fn done(code: i32) -> std::io::Result<()> {
    if code == 0 { Ok(()) } else { Err(std::io::Error::last_os_error()) }
}

#[cfg(test)]
#[path = "../tests/unit/realtime.rs"]
mod tests;
