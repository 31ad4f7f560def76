//! What keeps a program from joining although nobody holds it: files of other users in the domain's folder, shared memory
//! without a size, a damaged counter of nodes.

use super::places::{Places, name};
use super::unused;
use crate::now_ns;
use crate::sys::uid;
use std::fs::{OpenOptions, Permissions};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;

/// Ratio of the pause after a search to its duration.
const PAUSE: u64 = 20;
/// Beginning of the names of folders that are moved aside.
const ASIDE: &str = "aside-";

impl Places {
    /// Removes files that another user made in the domain's folder, usually root by hand: this user's programs cannot open
    /// them. The folder's owner may remove them, but not what is in a folder of another user, which is moved aside.
    pub(crate) fn remove_files_of_others(&self) {
        let is_ours = |name: &str| self.own(name).is_some() || Places::NAMES.contains(&name);
        remove_files_of_others(&self.root, is_ours);
        for folder in [self.nodes(), self.services()] {
            remove_files_of_others(&folder, |_| true);
        }
    }

    /// Shared memory without a size, for whose growth iceoryx2 would wait indefinitely.
    ///
    /// A program with many topics calls this for each of them. After a search without a result none takes place for [`PAUSE`] times
    /// its duration, some hundreds of microseconds in a small domain.
    pub(crate) fn empty_segment(&self) -> Option<PathBuf> {
        let begin_ns = now_ns();
        if begin_ns < self.next_search_ns.load(Ordering::Relaxed) {
            return None;
        }
        let is_empty = |path: &PathBuf| std::fs::symlink_metadata(path).is_ok_and(|about| about.len() == 0);
        let found = self.segments().into_iter().find(is_empty);
        if found.is_none() {
            let end_ns = now_ns();
            self.next_search_ns.store(end_ns + PAUSE * (end_ns - begin_ns), Ordering::Relaxed);
        }
        found
    }

    /// Removes a counter that cannot be read. It is made again with the next node; the nodes' numbers stay unique by
    /// their time and process.
    pub(crate) fn remove_damaged_counter(&self) {
        for path in self.counter_segments() {
            unused::remove(&path);
        }
    }

    /// Takes the counter, which iceoryx2 makes open to all users, back to this one. False: it is not there, because another
    /// user took its name at the same moment.
    pub(crate) fn restrict_counter(&self) -> bool {
        let counters = self.counter_segments();
        for path in &counters {
            let file = OpenOptions::new().read(true).custom_flags(libc::O_NOFOLLOW).open(path);
            if let Ok(file) = file {
                let _unchanged_on_errors = file.set_permissions(Permissions::from_mode(0o600));
            }
        }
        !counters.is_empty()
    }
}

fn remove_files_of_others(folder: &Path, is_ours: impl Fn(&str) -> bool) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        let is_foreign = std::fs::symlink_metadata(&path).is_ok_and(|about| about.uid() != uid());
        if !is_foreign || name(&path).starts_with(ASIDE) || !is_ours(name(&path)) {
            continue;
        }
        if std::fs::remove_file(&path).is_err() && std::fs::remove_dir(&path).is_err() {
            // What cannot be moved is named by the first program that cannot open it.
            let _ = std::fs::rename(&path, folder.join(format!("{ASIDE}{}-{}", name(&path), now_ns())));
        }
    }
}
