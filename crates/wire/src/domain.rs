//! Which programs see one another.

use crate::WireError;
use crate::leftover::Places;
use iceoryx2::prelude::{Config, FileName, Path, SemanticString};

/// Longest path of a socket: `sun_path` has 108 bytes, the last is zero.
const SOCKET_PATH_BYTES: usize = 107;
/// Behind folder and prefix a socket's name has a slash, a number of 128 bits (39 digits) and `.event`. All other names
/// may be longer: a file name may have 255 bytes, of which 90 follow the prefix.
const MAX_NAME_BYTES: usize = SOCKET_PATH_BYTES - 1 - 39 - ".event".len();

/// A shared-memory domain: programs of different domains do not see one another.
///
/// The default domain is iceoryx2's own, so that plain iceoryx2 clients reach a twin without configuration.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Domain {
    /// Prefix of all file and shared-memory names; iceoryx2's default is `iox2_`.
    pub prefix: String,
    /// Folder of the management files; `None`: iceoryx2's default in the system's temporary folder.
    pub root: Option<String>,
}

impl Default for Domain {
    fn default() -> Self {
        Self { prefix: "iox2_".into(), root: None }
    }
}

impl Domain {
    /// Named shared-memory domain: prefix `iox2_<name>_`, default root.
    pub fn named(name: &str) -> Self {
        Self { prefix: format!("iox2_{name}_"), root: None }
    }

    /// Shared-memory domain of the environment: `SOFTTWIN_DOMAIN` is its name, `SOFTTWIN_ROOT` its folder.
    pub fn from_env() -> Self {
        let mut domain = match std::env::var("SOFTTWIN_DOMAIN") {
            Ok(name) if !name.is_empty() => Self::named(&name),
            _ => Self::default(),
        };
        domain.root = std::env::var("SOFTTWIN_ROOT").ok().filter(|root| !root.is_empty());
        domain
    }

    /// Unique shared-memory domain, for tests and examples that run in parallel.
    pub fn isolated(label: &str) -> Self {
        use std::sync::atomic::{AtomicU32, Ordering};
        static NEXT: AtomicU32 = AtomicU32::new(0);
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        // Short, because the length of a name is limited.
        let moment = crate::now_ns() as u32;
        Self::named(&format!("{label}_{}_{moment:x}_{number}", std::process::id()))
    }

    /// Removes the counter segment that outlives the last program, for a shared-memory domain of one run (a test, a
    /// demonstration) after the end of all its programs. Returns the number of removed files.
    ///
    /// # Errors
    /// I/O errors.
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
        if let Some(root) = &self.root {
            config.global.set_root_path(&Path::new(root.as_bytes()).map_err(|_| bad("root", root))?);
        }
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
