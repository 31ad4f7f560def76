//! Which programs see one another, and whether a running program's own files are still there.

use crate::WireError;
use crate::leftover::{Places, claimed, ending, is_counter_of, number_of_ending, own_folder, process_of};
use crate::sys::{REMOVED, SHM_DIR, uid};
use iceoryx2::prelude::{Config, FileName, Path as IoxPath, SemanticString};
use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::fs::Metadata;
use std::os::unix::fs::{DirBuilderExt, MetadataExt};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Longest path of a socket: `sun_path` has 108 bytes, the last is zero.
const SOCKET_PATH_BYTES: usize = 107;
/// Behind folder and prefix a socket's name has a slash, a number of 128 bits (39 digits) and `.event`. All other names
/// may be longer: a file name may have 255 bytes, of which 90 follow the prefix.
const MAX_NAME_BYTES: usize = SOCKET_PATH_BYTES - 1 - 39 - ".event".len();

/// Permission of a folder's group, or of everybody, to make and remove files in it.
const OTHERS_WRITE: u32 = 0o022;

/// A shared-memory domain: programs of different domains do not see one another.
///
/// It belongs to one user, the owner of its folder, which no other user may enter; without a folder this is `/tmp/softtwin-<uid>`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Domain {
    /// Prefix of all file and shared-memory names: `iox2_<name>_u<uid>_`, or `iox2_u<uid>_` without a name. Where another
    /// user has taken the names of that prefix, a number follows the user's, as in `iox2_u<uid>-1_`.
    pub prefix: String,
    /// Folder of the management files; `None`: the user's own.
    pub root: Option<String>,
}

impl Default for Domain {
    fn default() -> Self {
        Self::of(None, None)
    }
}

/// Folder of the user's own domains: `/tmp/softtwin-<uid>`, with a number behind it where that name is another user's.
fn own_root() -> Result<String, WireError> {
    let name = format!("softtwin-{}", uid());
    let made = own_folder(Path::new("/tmp"), &name);
    let cause = |error| WireError::Node { cause: format!("/tmp/{name}: {error}") };
    made.map(|path| path.display().to_string()).map_err(cause)
}

impl Domain {
    /// Shared-memory domain by name and folder.
    pub fn of(name: Option<&str>, root: Option<String>) -> Self {
        // In /dev/shm the names of all users are in one folder: those of one user's domains must not be another's.
        let name = name.map(|name| format!("{name}_")).unwrap_or_default();
        Self { prefix: format!("iox2_{name}u{}_", uid()), root }
    }

    /// Named shared-memory domain in the user's own folder.
    pub fn named(name: &str) -> Self {
        Self::of(Some(name), None)
    }

    /// Shared-memory domain of the environment: `SOFTTWIN_DOMAIN` is its name, `SOFTTWIN_ROOT` its folder.
    pub fn from_env() -> Self {
        Self::given(None, None)
    }

    /// As [`Self::from_env`], with the name and the folder that are given instead.
    pub fn given(name: Option<&str>, root: Option<&str>) -> Self {
        let env = |key: &str| std::env::var(key).ok().filter(|value| !value.is_empty());
        let name = name.map(str::to_owned).or_else(|| env("SOFTTWIN_DOMAIN"));
        Self::of(name.as_deref(), root.map(str::to_owned).or_else(|| env("SOFTTWIN_ROOT")))
    }

    /// Shared-memory domain with a [unique name](Self::unique_name).
    pub fn isolated(label: &str) -> Self {
        Self::named(&Self::unique_name(label))
    }

    /// Unique name of a shared-memory domain, for tests and examples that run in parallel.
    pub fn unique_name(label: &str) -> String {
        use std::sync::atomic::{AtomicU32, Ordering};
        static NEXT: AtomicU32 = AtomicU32::new(0);
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        // Short, because the length of a name is limited.
        let moment = crate::now_ns() as u16;
        format!("{label}_{}_{moment:x}_{number}", std::process::id())
    }

    /// Removes the counter segment that outlives the last program, for a shared-memory domain of one run (a test, a
    /// demonstration) after the end of all its programs. Returns the number of removed files.
    pub fn remove_leftovers(&self) -> std::io::Result<usize> {
        let places = self.places().map_err(std::io::Error::other)?;
        let counters = places.counter_segments();
        counters.iter().try_for_each(std::fs::remove_file)?;
        Ok(counters.len())
    }

    /// iceoryx2's configuration. The host's configuration file is ignored on purpose: quality of service is fixed in this crate,
    /// and all programs of one shared-memory domain must agree.
    fn config(&self) -> Result<Config, WireError> {
        let bad = |what: &'static str, value: &str| WireError::BadDomain { what, value: value.to_owned() };
        let mut config = Config::default();
        let prefix = self.claimed_prefix();
        config.global.prefix = FileName::new(prefix.as_bytes()).map_err(|_| bad("prefix", &prefix))?;
        let root = self.root.clone().map_or_else(own_root, Ok)?;
        config.global.set_root_path(&IoxPath::new(root.as_bytes()).map_err(|_| bad("root", &root))?);
        Ok(config)
    }

    /// The prefix with the number under which this user has the counter of nodes in /dev/shm, or can make it. All other names
    /// there contain a moment in nanoseconds, which nobody can guess.
    pub(crate) fn claimed_prefix(&self) -> String {
        let stem = self.prefix.trim_end_matches('_');
        let number = claimed(Path::new(SHM_DIR), Metadata::is_file, |name| {
            let (digits, rest) = name.strip_prefix(stem)?.split_once('_')?;
            is_counter_of(rest).then(|| number_of_ending(digits)).flatten()
        });
        format!("{stem}{}_", ending(number))
    }

    /// Places of the files.
    ///
    /// # Errors
    /// [`WireError::BadDomain`] and [`WireError::LongDomain`] for invalid paths.
    pub(crate) fn places(&self) -> Result<Places, WireError> {
        let given = self.root.as_ref().map_or(0, String::len);
        // Before iceoryx2 sees the names: it ends the program when they do not fit.
        self.require_short(given, &self.prefix)?;
        let places = Places::new(self.config()?);
        self.require_short(places.root.as_os_str().len(), &places.prefix)?;
        Ok(places)
    }

    fn require_short(&self, root_bytes: usize, prefix: &str) -> Result<(), WireError> {
        let found = root_bytes + prefix.len();
        if found <= MAX_NAME_BYTES {
            return Ok(());
        }
        Err(WireError::LongDomain {
            prefix: prefix.to_owned(),
            root: self.root.clone().unwrap_or_default(),
            found,
            allowed: MAX_NAME_BYTES,
        })
    }
}

impl Places {
    /// Makes the folder if it is missing, and checks that it belongs to this user alone, before any file is made there. Root is
    /// refused in the domain of another user as well: its files would stop that user's programs.
    ///
    /// # Errors
    /// [`WireError::OthersDomain`], [`WireError::OpenFolder`].
    pub(crate) fn require_own_folder(&self) -> Result<(), WireError> {
        let _exists_already = std::fs::DirBuilder::new().recursive(true).mode(0o700).create(&self.root);
        let folder = self.root.display().to_string();
        let Ok(found) = std::fs::metadata(&self.root) else {
            return Ok(()); // the first file that cannot be made there gives the reason
        };
        let mode = found.mode() & 0o7777;
        if found.uid() != uid() {
            return Err(WireError::OthersDomain { folder, owner: found.uid(), user: uid() });
        }
        if mode & OTHERS_WRITE != 0 {
            return Err(WireError::OpenFolder { folder, mode });
        }
        Ok(())
    }
}

/// Files that a program keeps open while its bus is open. May be sent to another thread.
#[derive(Debug, Clone)]
pub struct OwnFiles {
    places: Places,
    /// Folder of the management files by its real path, as the kernel names open files.
    folder: PathBuf,
}

/// A descriptor that another thread is about to close shows a removed file, too; it is gone after this time.
const SECOND_LOOK: Duration = Duration::from_millis(20);

impl OwnFiles {
    /// Files of this program in a shared-memory domain that it has joined.
    ///
    /// # Errors
    /// [`WireError::BadDomain`] and [`WireError::LongDomain`] for invalid paths.
    pub fn of(domain: &Domain) -> Result<Self, WireError> {
        let places = domain.places()?;
        let folder = places.root.canonicalize().unwrap_or_else(|_| places.root.clone());
        Ok(Self { places, folder })
    }

    /// Removed files of this program, for example by a cleaner of temporary folders. If there are any, no other program finds
    /// this one's topics: it should report them and end, to be restarted.
    ///
    /// Takes about 100 us, and 20 ms more if a file is missing. For calls once a second, not for a real-time thread.
    pub fn removed(&self) -> Vec<PathBuf> {
        let first = self.removed_now();
        if first.is_empty() {
            return Vec::new();
        }
        std::thread::sleep(SECOND_LOOK);
        let second = self.removed_now();
        first.into_iter().filter(|(fd, path)| second.get(fd) == Some(path)).map(|(_, path)| path).collect()
    }

    fn removed_now(&self) -> BTreeMap<PathBuf, PathBuf> {
        let entries = std::fs::read_dir("/proc/self/fd").into_iter().flatten().flatten();
        let links = entries.filter_map(|entry| Some((entry.path(), std::fs::read_link(entry.path()).ok()?)));
        links.filter_map(|(fd, link)| Some((fd, self.removed_file(&link)?))).collect()
    }

    fn removed_file(&self, link: &Path) -> Option<PathBuf> {
        let path = link.to_str()?.strip_suffix(REMOVED)?;
        let ours = Path::new(path).starts_with(&self.folder)
            || path.starts_with(&self.places.writer_locks())
            || self.places.is_own_segment(Path::new(path));
        (ours && !self.is_of_an_ended_node(Path::new(path))).then(|| path.into())
    }

    /// Whether the file describes the node of another program, or one of several nodes of this program. Such a file is open here as
    /// well, and is removed when that node ends.
    fn is_of_an_ended_node(&self, path: &Path) -> bool {
        let nodes = self.folder.join("nodes");
        let process =
            |entry: &str| self.places.monitor_id(entry).or_else(|| entry.parse().ok()).map(process_of);
        let entry = path.strip_prefix(&nodes).ok().and_then(|rest| rest.iter().next()?.to_str());
        let is_ours = |entry: &OsStr| entry.to_str().and_then(process) == Some(std::process::id());
        let has_another = || {
            std::fs::read_dir(&nodes).into_iter().flatten().flatten().any(|entry| is_ours(&entry.file_name()))
        };
        entry.and_then(process).is_some_and(|process| process != std::process::id() || has_another())
    }
}

#[cfg(test)]
#[path = "../tests/unit/domain.rs"]
mod tests;
