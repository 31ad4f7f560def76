//! Names of a shared-memory domain in /dev/shm, which is open to all users: files of other users there, and the permissions of the counter.

use super::places::{Places, is_counter};
use super::unused;
use crate::WireError;
use crate::domain::uid;
use crate::now_ns;
use std::fs::{Metadata, OpenOptions, Permissions};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;

/// Ratio of the pause after a search to its duration.
const PAUSE: u64 = 20;

/// File that keeps iceoryx2 from creating or opening shared memory.
pub(crate) enum Obstacle {
    /// It has no size; iceoryx2 would wait indefinitely for its growth.
    Empty(PathBuf),
    /// It belongs to a user who is no member.
    Foreign(PathBuf, u32),
}

impl Places {
    /// First obstacle in /dev/shm. A foreign file is removed where the system allows it (root).
    ///
    /// A program with many topics calls this for each of them. After a search without a result none takes place for [`PAUSE`] times
    /// its duration, some hundreds of microseconds in a small domain.
    pub(crate) fn obstacle(&self) -> Option<Obstacle> {
        let begin_ns = now_ns();
        if begin_ns < self.next_search_ns.load(Ordering::Relaxed) {
            return None;
        }
        let found = self.search_obstacle();
        if found.is_none() {
            let end_ns = now_ns();
            self.next_search_ns.store(end_ns + PAUSE * (end_ns - begin_ns), Ordering::Relaxed);
        }
        found
    }

    fn search_obstacle(&self) -> Option<Obstacle> {
        let is_private = self.group().is_none();
        self.segments().into_iter().find_map(|path| {
            let about = std::fs::symlink_metadata(&path).ok()?;
            // Files of members of a shared domain are their own until they are granted to the group.
            if is_private && self.is_foreign(&about) && std::fs::remove_file(&path).is_err() {
                return Some(Obstacle::Foreign(path, about.uid()));
            }
            (about.len() == 0).then_some(Obstacle::Empty(path))
        })
    }

    /// Error that names a file of a user who is no member, or a counter that this user cannot remove.
    pub(crate) fn blocked_name(&self, blocks: impl Fn(&Path, &Metadata) -> bool) -> Option<WireError> {
        self.segments().into_iter().find_map(|path| {
            let about = std::fs::symlink_metadata(&path).ok()?;
            blocks(&path, &about)
                .then(|| WireError::BlockedName { path: path.display().to_string(), owner: about.uid() })
        })
    }

    /// Whether a file belongs to a user who is no member of the shared-memory domain.
    pub(crate) fn is_foreign(&self, about: &Metadata) -> bool {
        let root = std::fs::metadata(&self.root).map_or_else(|_| uid(), |root| root.uid());
        ![0, uid(), root].contains(&about.uid()) && self.group() != Some(about.gid())
    }

    /// Removes the counter that cannot be read, or names it. It is made again with the next node; the nodes' numbers stay unique by
    /// their time and process.
    pub(crate) fn without_damaged_counter(&self) -> Option<WireError> {
        let left = self.counter_segments().into_iter().filter(|path| !unused::remove(path)).count();
        if left == 0 {
            None
        } else {
            self.blocked_name(|path, about| is_counter(path) && about.uid() != uid())
        }
    }

    /// Takes the counter, which iceoryx2 makes open to all users, back to the members.
    pub(crate) fn restrict_counters(&self) {
        let mode = if self.group().is_some() { 0o660 } else { 0o600 };
        for path in self.counter_segments() {
            let file = OpenOptions::new().read(true).custom_flags(libc::O_NOFOLLOW).open(&path);
            let about = file.as_ref().ok().and_then(|file| file.metadata().ok());
            let (Ok(file), Some(about)) = (file, about) else { continue };
            if about.uid() == uid() && about.mode() & 0o7777 != mode {
                let _unchanged_on_errors = file.set_permissions(Permissions::from_mode(mode));
            }
        }
    }
}
