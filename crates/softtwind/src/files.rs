//! Watches the daemon's files in the folder of the shared-memory domain. Without them, for example after a cleaner of temporary
//! files, new readers find no topics.

use runtime::thread_group::{StopFlag, ThreadResult};
use runtime::wire::{OwnFiles, background_thread};
use std::time::Duration;

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
