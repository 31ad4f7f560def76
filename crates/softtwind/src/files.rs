//! Watches the daemon's own files in the folder of the domain. A cleaner of temporary files may remove them while the daemon
//! runs: then new readers find nothing.

use runtime::thread_group::{StopFlag, ThreadResult};
use runtime::wire::{OwnFiles, background_thread};
use std::time::Duration;

/// Name of the thread.
pub const NAME: &str = "files";
/// Time between two checks.
const INTERVAL: Duration = Duration::from_secs(1);

/// Checks until `end`; an error when files are gone.
pub fn watch(own: &OwnFiles, end: &StopFlag) -> ThreadResult {
    background_thread();
    loop {
        end.pause(INTERVAL);
        if end.is_set() {
            return Ok(());
        }
        if let Some(file) = own.removed().first() {
            let file = file.display();
            return Err(format!(
                "files of the domain are gone, such as {file}; exclude that folder from cleaners of temporary files (see \
                 OPERATIONS.md), then start again"
            )
            .into());
        }
    }
}
