//! Names and folders of a shared-memory domain's files.
//!
//! In folders that are open to all users (/tmp, /dev/shm) anybody may be the first to make a file of any name. A name there has a number
//! at its end. Programs of one user agree on the number without a place of their own to write it down: it is that of the file which the
//! user already has, or else the lowest that nobody has taken. A stranger who takes names beforehand therefore only makes the number
//! larger.

use crate::sys::{SHM_DIR, uid};
use iceoryx2::prelude::{Config, SemanticString};
use std::collections::BTreeSet;
use std::fs::{DirBuilder, DirEntry, Metadata};
use std::io::{self, ErrorKind};
use std::os::unix::fs::{DirBuilderExt, MetadataExt};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicU64;

/// Ending of the writers' lock files.
const WRITER_LOCK: &str = ".writer";

/// Ending of the counter of nodes.
const COUNTER: &str = ".global_mgmt";

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

/// Name of the start lock's file. Shared-memory domains in one folder have one lock.
pub(super) const LOCK_FILE: &str = "softtwin.lock";
/// Folders in the domain's folder.
const NODES: &str = "nodes";
const SERVICES: &str = "services";

impl Places {
    /// Names that softtwin and iceoryx2 use in the domain's folder, beside those that begin with the prefix.
    pub(super) const NAMES: [&str; 3] = [LOCK_FILE, NODES, SERVICES];

    pub(crate) fn new(config: Config) -> Self {
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        let prefix = text(config.global.prefix.as_bytes());
        // Without a slash at the end: the path's text is part of the names of writers' locks.
        let root = Path::new(&text(config.global.root_path().as_bytes())).components().collect();
        Self { config, prefix, root, next_search_ns: Arc::default() }
    }

    /// Folder with one folder and three monitor files for each node (member).
    pub(super) fn nodes(&self) -> PathBuf {
        self.root.join(NODES)
    }

    /// Folder with a description of each service (topic).
    pub(super) fn services(&self) -> PathBuf {
        self.root.join(SERVICES)
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

    /// Shared-memory files of this user. Others may make files of such names in /dev/shm; they have no meaning.
    pub(super) fn segments(&self) -> Vec<PathBuf> {
        let user = uid();
        let is_own = |entry: &DirEntry| entry.metadata().is_ok_and(|about| about.uid() == user);
        let found = entries(Path::new(SHM_DIR), |name| self.owns_segment(name)).filter(is_own);
        found.map(|entry| entry.path()).collect()
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

/// The process id within a node's or a port's number: seconds, nanoseconds, process id, counter, each of 32 bits.
pub(crate) fn process_of(id: u128) -> u32 {
    (id >> 64) as u32
}

/// Whether the rest of a file's name, behind the prefix, is that of the counter from which iceoryx2 numbers the nodes.
pub(crate) fn is_counter_of(rest: &str) -> bool {
    rest.ends_with(COUNTER) && rest.split_once('_').is_some_and(|(digits, _)| is_type_hash(digits))
}

pub(super) fn is_counter(path: &Path) -> bool {
    name(path).ends_with(COUNTER)
}

fn is_type_hash(text: &str) -> bool {
    text.len() == 40 && text.bytes().all(|byte| byte.is_ascii_hexdigit())
}

/// The entries of a folder whose name is wanted; none when the folder cannot be read.
pub(super) fn files(folder: &Path, wanted: impl Fn(&str) -> bool) -> Vec<PathBuf> {
    entries(folder, wanted).map(|entry| entry.path()).collect()
}

fn entries(folder: &Path, wanted: impl Fn(&str) -> bool) -> impl Iterator<Item = DirEntry> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries.filter(move |entry| entry.file_name().to_str().is_some_and(&wanted))
}

/// The last part of a path, empty if it is not UTF-8.
pub(super) fn name(path: &Path) -> &str {
    path.file_name().and_then(|name| name.to_str()).unwrap_or_default()
}

impl Places {
    /// Beginning of the paths of all writers' locks. A number from the folder's path distinguishes shared-memory domains with the
    /// same prefix.
    pub(crate) fn writer_locks(&self) -> String {
        let folder = hash(self.root.as_os_str().as_encoded_bytes());
        format!("{SHM_DIR}/{}softtwin_{folder:016x}_", self.prefix)
    }

    /// Lock file of a topic's writer in /dev/shm.
    pub(crate) fn writer_lock(&self, topic: &str) -> PathBuf {
        let path = format!("{}{:016x}", self.writer_locks(), hash(topic.as_bytes()));
        let file = name(Path::new(&path));
        let number = claimed(Path::new(SHM_DIR), Metadata::is_file, |found| {
            number_of_ending(found.strip_prefix(file)?.strip_suffix(WRITER_LOCK)?)
        });
        PathBuf::from(format!("{path}{}{WRITER_LOCK}", ending(number)))
    }

    /// True if a file in /dev/shm is a writer's lock of this shared-memory domain.
    pub(crate) fn is_writer_lock(&self, file: &str) -> bool {
        let path = Path::new(SHM_DIR).join(file);
        path.to_str()
            .is_some_and(|path| path.starts_with(&self.writer_locks()) && path.ends_with(WRITER_LOCK))
    }
}

/// FNV-1a, 64 bits: the same in every version of softtwin.
fn hash(bytes: &[u8]) -> u64 {
    bytes
        .iter()
        .fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3))
}

// ---- names that others may have taken ----

/// Tries to make a folder while strangers take the names. They have to be quicker each time.
const TRIES: u32 = 1000;

/// Number of this user's file among those of `folder` whose names `number_in` recognises; the lowest free number if there is none.
/// A file of another kind counts as taken, because a stranger can give a file of this user a second name by a hard link.
pub(crate) fn claimed(
    folder: &Path,
    is_kind: fn(&Metadata) -> bool,
    number_in: impl Fn(&str) -> Option<u32>,
) -> u32 {
    let (user, mut own, mut taken) = (uid(), None, BTreeSet::new());
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let Some(number) = entry.file_name().to_str().and_then(&number_in) else { continue };
        match entry.metadata() {
            Ok(about) if about.uid() == user && is_kind(&about) => {
                own = Some(own.map_or(number, |own: u32| own.min(number)))
            }
            Ok(_) => drop(taken.insert(number)),
            Err(_) => {} // gone
        }
    }
    own.unwrap_or_else(|| (0..).find(|number| !taken.contains(number)).unwrap_or_default())
}

/// The folder `parent/name` of this user alone, which is made if it is missing. Where the name is another user's, a number
/// follows it.
///
/// # Errors
/// The folder cannot be made.
pub fn own_folder(parent: &Path, name: &str) -> io::Result<PathBuf> {
    // A link is not the folder, wherever it leads.
    let is_own = |path: &Path| {
        std::fs::symlink_metadata(path).is_ok_and(|found| found.is_dir() && found.uid() == uid())
    };
    let first = parent.join(name);
    if is_own(&first) {
        return Ok(first);
    }
    for _ in 0..TRIES {
        let number = claimed(parent, Metadata::is_dir, |found| number_of_ending(found.strip_prefix(name)?));
        let path = parent.join(format!("{name}{}", ending(number)));
        match DirBuilder::new().mode(0o700).create(&path) {
            Ok(()) => return Ok(path),
            Err(error) if error.kind() != ErrorKind::AlreadyExists => return Err(error),
            Err(_) if is_own(&path) => return Ok(path),
            Err(_) => {} // taken since the look
        }
    }
    Err(io::Error::new(ErrorKind::AlreadyExists, format!("{}: other users take all names", first.display())))
}

/// The end of a name with this number: nothing for 0, `-1`, `-2` and so on.
pub(crate) fn ending(number: u32) -> String {
    if number == 0 { String::new() } else { format!("-{number}") }
}

/// Reads what [`ending`] writes.
pub(crate) fn number_of_ending(text: &str) -> Option<u32> {
    let number = text.strip_prefix('-').map_or(Some(0), |digits| digits.parse().ok())?;
    (ending(number) == text).then_some(number)
}

#[cfg(test)]
#[path = "../../tests/unit/leftover_places.rs"]
mod tests;
