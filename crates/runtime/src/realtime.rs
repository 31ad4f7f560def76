//! Real-time settings of the process: each is asked for, and what was refused is said once, by name.

use crate::config::Realtime;

/// A real-time setting that the system refused.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("realtime.{setting}: refused: {cause}; {remedy}")]
pub struct MissingRight {
    /// Key in the settings file.
    pub setting: &'static str,
    /// The system's word for it.
    pub cause: String,
    /// What to do.
    pub remedy: &'static str,
}

/// Applies the settings to the calling thread (cores, scheduler) and the process (memory). Returns what was refused.
pub fn apply(settings: &Realtime) -> Vec<MissingRight> {
    let mut missing = Vec::new();
    let mut try_it = |wanted: bool, setting, remedy, call: &dyn Fn() -> i32| {
        if wanted && call() != 0 {
            let cause = std::io::Error::last_os_error().to_string();
            missing.push(MissingRight { setting, cause, remedy });
        }
    };
    try_it(
        !settings.cores.is_empty(),
        "cores",
        "name cores that exist and that the process may use",
        &|| pin(&settings.cores),
    );
    try_it(
        settings.fifo_priority > 0,
        "fifo_priority",
        "give CAP_SYS_NICE or a real-time limit (LimitRTPRIO= in the unit)",
        &|| fifo(settings.fifo_priority),
    );
    try_it(
        settings.lock_memory,
        "lock_memory",
        "give CAP_IPC_LOCK or raise the limit (LimitMEMLOCK=infinity in the unit)",
        &lock_memory,
    );
    missing
}

/// Niceness of the threads that answer questions: on a full machine the loop comes first.
const BESIDE_NICE: i32 = 5;

/// Lets the calling thread step back behind the loop. A refusal changes nothing that was promised.
pub fn step_back() {
    // SAFETY: takes no pointers; on Linux 0 is the calling thread.
    let _ordinary_then = unsafe { libc::setpriority(libc::PRIO_PROCESS, 0, BESIDE_NICE) };
}

fn pin(cores: &[usize]) -> i32 {
    // SAFETY: an all-zero cpu_set_t is the empty set; CPU_SET stays within it because core numbers are below 1024
    // (checked with the settings); the set lives across the call.
    unsafe {
        let mut set: libc::cpu_set_t = std::mem::zeroed();
        for core in cores {
            libc::CPU_SET(*core, &mut set);
        }
        libc::sched_setaffinity(0, size_of::<libc::cpu_set_t>(), &set)
    }
}

fn fifo(priority: u8) -> i32 {
    let parameters = libc::sched_param { sched_priority: priority.into() };
    // SAFETY: the parameters live across the call; 0 means the calling thread.
    unsafe { libc::sched_setscheduler(0, libc::SCHED_FIFO, &parameters) }
}

fn lock_memory() -> i32 {
    // SAFETY: takes no pointers; at worst it is refused.
    unsafe { libc::mlockall(libc::MCL_CURRENT | libc::MCL_FUTURE) }
}
