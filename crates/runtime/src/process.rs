//! Signals to the programs we started.

use std::process::Child;

/// Sends a signal to a child process, for example SIGTERM, which asks it to end; does nothing when it has ended already.
pub fn signal(child: &mut Child, signal: i32) -> std::io::Result<()> {
    if child.try_wait()?.is_some() {
        return Ok(());
    }
    // SAFETY: the child has not been waited for (just checked, and it is borrowed mutably), so its number is still its own.
    match unsafe { libc::kill(child.id() as libc::pid_t, signal) } {
        0 => Ok(()),
        _ => Err(std::io::Error::last_os_error()),
    }
}
