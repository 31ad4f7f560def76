//! Members of a shared-memory domain (iceoryx2's nodes): detection and removal of dead ones.

use super::places::{Places, files, name, process_of};
use super::unused;
use crate::sys::Ipc;
use iceoryx2::node::{DeadNodeView, Node, NodeDetails, NodeState, NodeView};
use iceoryx2::prelude::CallbackProgression;
use std::collections::BTreeSet;
use std::fs::Metadata;
use std::os::unix::fs::{MetadataExt, OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Bytes of the process identity in a node's context file; zeros are no process.
const NO_PROCESS: [u8; 16] = [0; 16];

/// Time during which files of nodes without a process are polled before they count as in use: a program that reads them may have
/// to wait for its core. Programs of another container, whose processes are invisible here, delay each start by it.
const POLLING: Duration = Duration::from_millis(300);
const BETWEEN_LOOKS: Duration = Duration::from_millis(1);

impl Places {
    /// Removes the dead nodes; returns how many were removed and how many could not be. Only under the exclusive start lock.
    pub(super) fn remove_dead_nodes(&self) -> (usize, usize) {
        let dead = self.dead_nodes();
        if dead.is_empty() {
            return (0, 0);
        }
        for &id in &dead {
            self.complete(id);
        }
        let mut views = Vec::new();
        // A node that cannot be listed stays; it is counted below.
        let _ = Node::<Ipc>::list(&self.config, |state| {
            if let NodeState::Dead(view) = state {
                views.push(*view.id());
            }
            CallbackProgression::Continue
        });
        for id in views.iter().filter(|id| dead.contains(&id.value())) {
            // The usual call takes the settings from the node's details, which a node that was killed early does
            // not have; it would then clean up iceoryx2's default domain and report success.
            let details = NodeDetails::__internal_new(&None, &self.config);
            let _ = DeadNodeView::<Ipc>::__internal_try_remove_stale_resources(*id, details);
        }
        let left = self.node_ids();
        let failed = dead.iter().filter(|id| left.contains(id)).count();
        (dead.len() - failed, failed)
    }

    /// Nodes with a file: alive, dead, incomplete or partly removed.
    fn node_ids(&self) -> BTreeSet<u128> {
        let monitors = files(&self.nodes(), |name| self.monitor_id(name).is_some());
        let monitored = monitors.iter().filter_map(|path| self.monitor_id(name(path)));
        let folders = files(&self.nodes(), |name| name.parse::<u128>().is_ok());
        let ours = folders.iter().filter(|folder| !files(folder, |file| self.own(file).is_some()).is_empty());
        monitored.chain(ours.filter_map(|folder| name(folder).parse().ok())).collect()
    }

    /// The node to which a file of [`Self::monitor`] belongs.
    pub(crate) fn monitor_id(&self, file: &str) -> Option<u128> {
        self.own(file)?.split_once(".node_monitor")?.0.parse().ok()
    }

    /// A file by which iceoryx2 watches a node: `""` is locked while the node lives, `_owner_lock` while it is removed,
    /// `_context` holds the identity of its process.
    fn monitor(&self, id: u128, part: &str) -> PathBuf {
        self.nodes().join(format!("{}{id}.node_monitor{part}", self.prefix))
    }

    fn node_folder(&self, id: u128) -> PathBuf {
        self.nodes().join(id.to_string())
    }

    /// Unused nodes. Another program that reads the files of a dead node looks like its owner; if no process has the node's number,
    /// the query is repeated.
    fn dead_nodes(&self) -> Vec<u128> {
        let end = Instant::now() + POLLING;
        let (mut undecided, mut dead) = (self.node_ids(), Vec::new());
        loop {
            let (in_use, unused): (BTreeSet<u128>, BTreeSet<u128>) =
                undecided.into_iter().partition(|&id| self.lives(id));
            dead.extend(unused);
            undecided = in_use.into_iter().filter(|&id| !is_process(process_of(id))).collect();
            if undecided.is_empty() || Instant::now() >= end {
                return dead;
            }
            std::thread::sleep(BETWEEN_LOOKS);
        }
    }

    /// A living node has its details and its context file open, one of them from its first moment on. The other two files
    /// must not be opened here: closing them would release the locks that this very process may hold on them.
    fn lives(&self, id: u128) -> bool {
        let details = self.node_folder(id).join(format!("{}node.details", self.prefix));
        unused::is_in_use(&details) || unused::is_in_use(&self.monitor(id, "_context"))
    }

    /// Brings a dead node, killed while it was made or removed, into the state of one that was killed while it ran: that is
    /// the only state that iceoryx2 removes. What cannot be written here fails again, and is counted, when it is removed.
    fn complete(&self, id: u128) {
        for file in files(&self.node_folder(id), |file| self.own(file).is_some()) {
            if std::fs::metadata(&file).is_ok_and(|metadata| service_is_incomplete(&metadata)) {
                let _ = std::fs::remove_file(&file);
            }
        }
        for (part, content, mode) in
            [("", &[][..], 0o600), ("_owner_lock", &[], 0o600), ("_context", &NO_PROCESS, 0o400)]
        {
            let path = self.monitor(id, part);
            let complete =
                |found: Metadata| found.mode() & 0o777 == mode && found.len() >= content.len() as u64;
            if !std::fs::metadata(&path).is_ok_and(complete) {
                let _ = rewrite(&path, content, mode);
            }
        }
    }

    /// Removes folders of nodes that were killed before their first file was made. Such a folder does not say to which domain
    /// it belongs, and nothing in it can be open: a process that lives and carries the folder's number keeps it.
    pub(super) fn remove_empty_node_folders(&self) -> usize {
        let folders =
            files(&self.nodes(), |name| name.parse::<u128>().is_ok_and(|id| !is_process(process_of(id))));
        // Only empty folders can be removed.
        folders.iter().filter(|folder| std::fs::remove_dir(folder).is_ok()).count()
    }
}

pub(super) fn is_process(pid: u32) -> bool {
    Path::new("/proc").join(pid.to_string()).exists()
}

fn rewrite(path: &Path, content: &[u8], mode: u32) -> std::io::Result<()> {
    let _absent_is_fine = std::fs::remove_file(path);
    let mut file = std::fs::OpenOptions::new().write(true).create_new(true).mode(0o600).open(path)?;
    std::io::Write::write_all(&mut file, content)?;
    file.set_permissions(std::fs::Permissions::from_mode(mode))
}

impl Places {
    /// Removes incomplete resources of dead creators; returns their number. Needs no lock: a live creator has the file open from
    /// its creation on.
    pub(crate) fn remove_incomplete(&self) -> usize {
        let segments = self.segments().into_iter().filter(|path| has(path, segment_is_incomplete));
        let services = self.service_files().into_iter().filter(|path| has(path, service_is_incomplete));
        segments.chain(services).filter(|path| unused::remove(path)).count()
    }
}

fn has(path: &Path, property: impl Fn(&Metadata) -> bool) -> bool {
    std::fs::symlink_metadata(path).is_ok_and(|metadata| property(&metadata))
}

/// Shared memory is write-only until it is complete.
fn segment_is_incomplete(metadata: &Metadata) -> bool {
    metadata.len() == 0 || metadata.mode() & 0o400 == 0
}

/// Descriptions are written once and read-only from then on.
fn service_is_incomplete(metadata: &Metadata) -> bool {
    metadata.mode() & 0o200 != 0
}
