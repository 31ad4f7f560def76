//! Removal of all leftovers of dead programs.

use super::places::{Places, files, is_counter};
use super::unused;
use crate::sys::SHM_DIR;
use std::ops::AddAssign;
use std::path::Path;
use std::sync::Mutex;
use std::time::Duration;

/// Numbers of removed leftovers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Removed {
    /// Programs (iceoryx2's nodes) that had been killed.
    pub nodes: usize,
    /// Incomplete or ownerless files outside the nodes.
    pub files: usize,
    /// Programs that had been killed and could not be removed.
    pub failed: usize,
}

impl Removed {
    /// Whether anything was removed.
    pub fn any(&self) -> bool {
        self.nodes + self.files > 0
    }
}

impl AddAssign for Removed {
    /// Both together; what could not be removed is counted once.
    fn add_assign(&mut self, later: Self) {
        let Self { nodes, files, failed } = later;
        *self = Self { nodes: self.nodes + nodes, files: self.files + files, failed };
    }
}

/// iceoryx2 removes one node at a time in a process and refuses a second one.
static IN_THIS_PROCESS: Mutex<()> = Mutex::new(());

impl Places {
    /// Removes leftovers of dead programs; waits at most `patience` for programs that create resources. After that only incomplete
    /// files are removed, which needs no lock.
    pub(crate) fn sweep(&self, patience: Duration) -> Removed {
        // Incomplete files first: the following steps open files and would wait for their completion.
        let mut removed = Removed { files: self.remove_incomplete(), ..Removed::default() };
        let Ok(Some(_lock)) = self.lock_to_remove(patience) else { return removed };
        let _one_at_a_time = IN_THIS_PROCESS.lock();
        (removed.nodes, removed.failed) = self.remove_dead_nodes();
        removed.files += self.remove_dead_listeners() + self.remove_ownerless();
        removed
    }

    /// Files that no process has open after the removal of dead nodes are ownerless: each user of a service keeps its description
    /// and its memory open.
    fn remove_ownerless(&self) -> usize {
        let is_socket = |file: &str| {
            self.own(file)
                .and_then(|rest| rest.strip_suffix(".event"))
                .is_some_and(|id| id.parse::<u128>().is_ok())
        };
        let sockets = files(&self.root, is_socket);
        let segments = self.segments().into_iter().filter(|path| !is_counter(path));
        let writers = files(Path::new(SHM_DIR), |file| self.is_writer_lock(file));
        let files = self.service_files().into_iter().chain(segments).chain(sockets).chain(writers);
        files.filter(|path| unused::remove(path)).count() + self.remove_empty_node_folders()
    }
}
