//! Which programs see one another.

use crate::WireError;
use crate::leftover::{Places, group_of};
use iceoryx2::prelude::{Config, FileName, Path, SemanticString};
use std::os::unix::fs::{DirBuilderExt, MetadataExt};

/// Longest path of a socket: `sun_path` has 108 bytes, the last is zero.
const SOCKET_PATH_BYTES: usize = 107;
/// Behind folder and prefix a socket's name has a slash, a number of 128 bits (39 digits) and `.event`. All other names
/// may be longer: a file name may have 255 bytes, of which 90 follow the prefix.
const MAX_NAME_BYTES: usize = SOCKET_PATH_BYTES - 1 - 39 - ".event".len();

/// A shared-memory domain: programs of different domains do not see one another.
///
/// Without a folder it is private to the user: folder `/tmp/softtwin-<uid>`, which no other user may enter. The shared-memory domain
/// of a given folder is private to the folder's owner, or shared by the folder's group if it has the setgid bit (OPERATIONS.md).
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Domain {
    /// Prefix of all file and shared-memory names: `iox2_<name>_u<uid>_`, or `iox2_u<uid>_` without a name; `uid` is the folder's owner.
    pub prefix: String,
    /// Folder of the management files; `None`: the user's own.
    pub root: Option<String>,
}

impl Default for Domain {
    fn default() -> Self {
        Self::of(None, None)
    }
}

/// This process's user.
pub(crate) fn uid() -> u32 {
    // SAFETY: the call has no arguments and cannot fail.
    unsafe { libc::geteuid() }
}

/// Folder of the user's own domains.
pub(crate) fn own_root() -> String {
    format!("/tmp/softtwin-{}", uid())
}

impl Domain {
    /// Shared-memory domain by name and folder.
    pub fn of(name: Option<&str>, root: Option<String>) -> Self {
        // In /dev/shm the names of all users are in one folder: those of one user's domains must not be another's.
        let owner =
            root.as_ref().and_then(|root| std::fs::metadata(root).ok()).map_or_else(uid, |root| root.uid());
        let name = name.map(|name| format!("{name}_")).unwrap_or_default();
        Self { prefix: format!("iox2_{name}u{owner}_"), root }
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
        config.global.prefix =
            FileName::new(self.prefix.as_bytes()).map_err(|_| bad("prefix", &self.prefix))?;
        let root = self.root.clone().unwrap_or_else(own_root);
        config.global.set_root_path(&Path::new(root.as_bytes()).map_err(|_| bad("root", &root))?);
        Ok(config)
    }

    /// Places of the files.
    ///
    /// # Errors
    /// [`WireError::BadDomain`] and [`WireError::LongDomain`] for invalid paths.
    pub(crate) fn places(&self) -> Result<Places, WireError> {
        let given = self.root.as_ref().map_or(0, String::len);
        // Before iceoryx2 sees the names: it ends the program when they do not fit.
        self.require_short(given)?;
        let places = Places::new(self.config()?);
        self.require_short(places.root.as_os_str().len())?;
        Ok(places)
    }

    /// Checks that this user's programs may join, before they make a file; makes the user's own folder. `/tmp` is open to all:
    /// another user may have made that folder before.
    ///
    /// Files that a user makes in a private domain of another one, root too, cannot be opened by that one's programs: these
    /// would wait for them.
    ///
    /// # Errors
    /// [`WireError::ForeignFolder`], [`WireError::OthersDomain`].
    pub(crate) fn require_membership(&self) -> Result<(), WireError> {
        let Some(root) = &self.root else {
            let folder = own_root();
            let _exists_already = std::fs::DirBuilder::new().mode(0o700).create(&folder);
            return match std::fs::symlink_metadata(&folder) {
                Ok(found) if found.is_dir() && found.uid() == uid() => Ok(()),
                Ok(found) => Err(WireError::ForeignFolder { folder, owner: found.uid() }),
                Err(_) => Ok(()), // the first file that is made there gives the reason
            };
        };
        match std::fs::metadata(root) {
            Ok(found) if found.is_dir() && found.uid() != uid() && group_of(&found).is_none() => {
                Err(WireError::OthersDomain { folder: root.clone(), owner: found.uid(), user: uid() })
            }
            _ => Ok(()),
        }
    }

    fn require_short(&self, root_bytes: usize) -> Result<(), WireError> {
        let found = root_bytes + self.prefix.len();
        if found <= MAX_NAME_BYTES {
            return Ok(());
        }
        Err(WireError::LongDomain {
            prefix: self.prefix.clone(),
            root: self.root.clone().unwrap_or_default(),
            found,
            allowed: MAX_NAME_BYTES,
        })
    }
}

#[cfg(test)]
#[path = "../tests/unit/domain.rs"]
mod tests;
