//! Places and names of a shared-memory domain's files.

use crate::sys::SHM_DIR;
use iceoryx2::prelude::{Config, SemanticString};
use std::fs::Metadata;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicU64;

/// Ending of the writers' lock files.
const WRITER_LOCK: &str = ".writer";

/// Folders of the writers' locks of a shared domain: only users who may write there publish what drives an actuator, or the rest.
const CONTROL: &str = "control";
const PUBLISH: &str = "publish";
/// Folders keep their group for what is made in them.
pub(super) const SET_GROUP: u32 = 0o2000;
/// Kinds of topics that drive an actuator, third chunks of their names; a cavity may follow.
const DRIVING: [&str; 4] = ["setpoint", "override", "target", "command"];

/// The folders and names of one domain.
#[derive(Debug, Clone)]
pub(crate) struct Places {
    pub(crate) config: Config,
    /// Prefix of all file names.
    pub(crate) prefix: String,
    /// Folder of the management files.
    pub(crate) root: PathBuf,
    /// When /dev/shm is to be searched for obstacles again, ns.
    pub(super) next_search_ns: Arc<AtomicU64>,
}

impl Places {
    pub(crate) fn new(config: Config) -> Self {
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        let prefix = text(config.global.prefix.as_bytes());
        // Without a slash at the end: the path's text is part of the names of writers' locks.
        let root = Path::new(&text(config.global.root_path().as_bytes())).components().collect();
        Self { config, prefix, root, next_search_ns: Arc::default() }
    }

    /// Folder with one folder and three monitor files for each node (member).
    pub(super) fn nodes(&self) -> PathBuf {
        self.root.join("nodes")
    }

    /// Folder with a description of each service (topic).
    pub(super) fn services(&self) -> PathBuf {
        self.root.join("services")
    }

    /// Part of a file name after the prefix; `None` for a file of another shared-memory domain.
    pub(super) fn own<'a>(&self, file: &'a str) -> Option<&'a str> {
        file.strip_prefix(&self.prefix)
    }

    /// True for a file in /dev/shm of this shared-memory domain: `<prefix><40 hexadecimal digits>_...`. The digits distinguish the
    /// names `a` and `a_b`.
    pub(super) fn owns_segment(&self, file: &str) -> bool {
        self.own(file).and_then(|rest| rest.split_once('_')).is_some_and(|(digits, _)| is_type_hash(digits))
    }

    /// True if a file in /dev/shm stays as long as this process has it open: samples of ports in this process, members of a service.
    pub(crate) fn is_own_segment(&self, path: &Path) -> bool {
        let file = name(path);
        let port = || file.rsplit_once('_').and_then(|(_, end)| end.strip_suffix(".data")?.parse().ok());
        let is_ours = || port().is_some_and(|port| process_of(port) == std::process::id());
        path.starts_with(SHM_DIR) && self.owns_segment(file) && (file.ends_with(".dynamic") || is_ours())
    }

    /// Shared-memory files.
    pub(super) fn segments(&self) -> Vec<PathBuf> {
        files(Path::new(SHM_DIR), |name| self.owns_segment(name))
    }

    /// Counters from which iceoryx2 numbers the nodes; they remain when no process has them open.
    pub(crate) fn counter_segments(&self) -> Vec<PathBuf> {
        self.segments().into_iter().filter(|path| is_counter(path)).collect()
    }

    /// Descriptions of the services: `<prefix><40 hexadecimal digits>.service`.
    pub(crate) fn service_files(&self) -> Vec<PathBuf> {
        files(&self.services(), |name| {
            self.own(name).and_then(|rest| rest.strip_suffix(".service")).is_some_and(is_type_hash)
        })
    }
}

/// Group with access to a folder (setgid bit); `None`: only its owner has.
pub(crate) fn group_of(folder: &Metadata) -> Option<u32> {
    (folder.mode() & SET_GROUP != 0).then(|| folder.gid())
}

/// The process id within a node's or a port's number: seconds, nanoseconds, process id, counter, each of 32 bits.
pub(crate) fn process_of(id: u128) -> u32 {
    (id >> 64) as u32
}

pub(super) fn is_counter(path: &Path) -> bool {
    name(path).ends_with(".global_mgmt")
}

fn is_type_hash(text: &str) -> bool {
    text.len() == 40 && text.bytes().all(|byte| byte.is_ascii_hexdigit())
}

/// The entries of a folder whose name is wanted; none when the folder cannot be read.
pub(super) fn files(folder: &Path, wanted: impl Fn(&str) -> bool) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries
        .filter(|entry| entry.file_name().to_str().is_some_and(&wanted))
        .map(|entry| entry.path())
        .collect()
}

/// True for the name of a folder of those who may publish.
pub(super) fn is_right(path: &Path) -> bool {
    matches!(name(path), CONTROL | PUBLISH)
}

/// The last part of a path, empty if it is not UTF-8.
pub(super) fn name(path: &Path) -> &str {
    path.file_name().and_then(|name| name.to_str()).unwrap_or_default()
}

impl Places {
    /// Beginning of the paths of all writers' locks. A number from the folder's path distinguishes shared-memory domains with the
    /// same prefix.
    pub(crate) fn writer_locks(&self) -> String {
        let folder = number(self.root.as_os_str().as_encoded_bytes());
        format!("{SHM_DIR}/{}softtwin_{folder:016x}_", self.prefix)
    }

    /// Lock file of a topic's writer, in /dev/shm, or in a shared domain's folder of those who may publish it.
    pub(crate) fn writer_lock(&self, topic: &str) -> PathBuf {
        let file = format!("{:016x}{WRITER_LOCK}", number(topic.as_bytes()));
        match self.right_to_write(topic) {
            Some(folder) => folder.join(file),
            None => PathBuf::from(format!("{}{file}", self.writer_locks())),
        }
    }

    /// Group with access; `None`: the owner alone.
    pub(crate) fn group(&self) -> Option<u32> {
        group_of(&std::fs::metadata(&self.root).ok()?)
    }

    /// Folder of a shared domain whose writers may publish `topic`.
    pub(crate) fn right_to_write(&self, topic: &str) -> Option<PathBuf> {
        let is_driving = topic.split('/').nth(2).is_some_and(|kind| DRIVING.contains(&kind));
        self.group().map(|_| self.root.join(if is_driving { CONTROL } else { PUBLISH }))
    }

    /// True if a file in /dev/shm is a writer's lock of this shared-memory domain.
    pub(crate) fn is_writer_lock(&self, file: &str) -> bool {
        let path = Path::new(SHM_DIR).join(file);
        path.to_str()
            .is_some_and(|path| path.starts_with(&self.writer_locks()) && path.ends_with(WRITER_LOCK))
    }
}

/// FNV-1a, 64 bits: the same in every version of softtwin.
fn number(bytes: &[u8]) -> u64 {
    bytes
        .iter()
        .fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3))
}

#[cfg(test)]
#[path = "../../tests/unit/leftover_places.rs"]
mod tests;
