//! Watches a program's files in the folder of the shared-memory domain and in /dev/shm. Without them, for example after a cleaner of
//! temporary files, other programs do not find its topics, and it does not find the topics of programs that were restarted.

use std::time::Duration;
use wire::thread_group::{StopFlag, ThreadResult};
use wire::{OwnFiles, background_thread};

/// Name of the thread.
pub const NAME: &str = "files";
/// Time between two checks.
const INTERVAL: Duration = Duration::from_secs(1);

/// Checks until `end`; an error if files were removed.
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
                "files in shared memory were removed, such as {file}; exclude that folder from cleaners of temporary files (see \
                 OPERATIONS.md), then start again"
            )
            .into());
        }
    }
}
