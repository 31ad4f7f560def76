//! Watches the daemon's own files in the folder of the domain. A cleaner of temporary files may remove them while the daemon
//! runs: then new readers find nothing.

use runtime::threads::ThreadGroup;
use runtime::wire::OwnFiles;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// Name of the thread.
pub const NAME: &str = "files";
/// Time between two checks.
const INTERVAL: Duration = Duration::from_secs(1);
/// How often the end is checked for.
const STOP_CHECK: Duration = Duration::from_millis(50);

/// Checks until the group is done; ends the daemon when files are gone.
pub fn watch(group: &ThreadGroup, own: &OwnFiles) {
    let mut next = Instant::now() + INTERVAL;
    while !group.done().load(Ordering::Acquire) {
        std::thread::sleep(STOP_CHECK);
        if Instant::now() < next {
            continue;
        }
        next = Instant::now() + INTERVAL;
        if let Some(file) = own.removed().first() {
            let cause = format!(
                "files of the domain are gone, such as {}; exclude that folder from cleaners of temporary files (see \
                 OPERATIONS.md), then start again",
                file.display()
            );
            return group.fail(NAME, cause);
        }
    }
}
