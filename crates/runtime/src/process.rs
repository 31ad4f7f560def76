//! Ending the programs we started, the way the system asks for.

use std::process::Child;

/// Asks a child process to end (SIGTERM); nothing happens when it has ended already.
///
/// # Errors
/// The system's refusal.
pub fn terminate(child: &mut Child) -> std::io::Result<()> {
    if child.try_wait()?.is_some() {
        return Ok(());
    }
    // SAFETY: the child has not been waited for (just checked, and it is borrowed mutably), so its number is still its own.
    match unsafe { libc::kill(child.id() as libc::pid_t, libc::SIGTERM) } {
        0 => Ok(()),
        _ => Err(std::io::Error::last_os_error()),
    }
}
