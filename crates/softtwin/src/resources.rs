//! Resources that a process has used, from `/proc`; `None` without it. A process is `self` or its number.

use std::fs::read_to_string;

/// Ticks a second of the times in `/proc`: fixed by Linux's interface to programs, whatever the kernel's own clock.
const TICKS_PER_S: f64 = 100.0;

/// Processor time of all threads, user and system (s).
pub fn cpu_s(process: &str) -> Option<f64> {
    cpu_of(&read_to_string(format!("/proc/{process}/stat")).ok()?)
}

/// A number of `/proc/PROCESS/status`: memory in kB (`VmHWM` the largest resident, `VmRSS` resident now, `RssAnon` its own), or
/// `Threads`.
pub fn status(process: &str, key: &str) -> Option<u64> {
    status_of(&read_to_string(format!("/proc/{process}/status")).ok()?, key)
}

/// Fields 14 and 15; the program's name before them may hold blanks, so they are counted from its closing bracket.
fn cpu_of(stat: &str) -> Option<f64> {
    let mut fields = stat.rsplit_once(')')?.1.split_ascii_whitespace().skip(11);
    let mut ticks = || fields.next()?.parse::<f64>().ok();
    Some((ticks()? + ticks()?) / TICKS_PER_S)
}

fn status_of(status: &str, key: &str) -> Option<u64> {
    let line = status.lines().find_map(|line| line.strip_prefix(key)?.strip_prefix(':'))?;
    line.split_ascii_whitespace().next()?.parse().ok()
}

#[cfg(test)]
#[path = "../tests/unit/resources.rs"]
mod tests;
