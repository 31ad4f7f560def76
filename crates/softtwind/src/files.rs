//! Watches the files of the daemon's own topics. A cleaner of temporary files may remove them while the daemon runs: then new
//! readers find nothing, and a second daemon would start beside this one.

use runtime::threads::ThreadGroup;
use runtime::wire::{Bus, Domain, KeyExpr, Topic};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// Name of the thread.
pub const NAME: &str = "files";
/// Time between two checks.
const INTERVAL: Duration = Duration::from_secs(1);
/// How often the end is checked for.
const STOP_CHECK: Duration = Duration::from_millis(50);

/// Checks until the group is done; ends the daemon when a topic's files are gone.
pub fn watch(group: &ThreadGroup, domain: &Domain, topics: &[Topic]) {
    if let Err(error) = check_until_done(group, domain, topics) {
        group.fail(NAME, error.to_string());
    }
}

fn check_until_done(group: &ThreadGroup, domain: &Domain, topics: &[Topic]) -> anyhow::Result<()> {
    let bus = Bus::open(domain)?;
    let key = KeyExpr::new("**")?;
    let mut next = Instant::now() + INTERVAL;
    while !group.done().load(Ordering::Acquire) {
        std::thread::sleep(STOP_CHECK);
        if Instant::now() < next {
            continue;
        }
        next = Instant::now() + INTERVAL;
        let found = match bus.names(&key) {
            Ok(found) => found,
            Err(_) if !bus.folder().exists() => Vec::new(),
            Err(_cannot_tell) => continue,
        };
        if let Some(gone) = topics.iter().find(|topic| !found.contains(topic)) {
            let cause = format!(
                "the files of the domain are gone: {gone} is not in {} any more; exclude that folder from cleaners of \
                 temporary files (see OPERATIONS.md), then start again",
                bus.folder().display()
            );
            group.fail(NAME, cause);
            return Ok(());
        }
    }
    Ok(())
}
