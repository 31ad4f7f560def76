//! Which programs see one another.

use crate::WireError;
use iceoryx2::prelude::{Config, FileName, Path, SemanticString};

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
    /// A domain with a name: prefix `iox2_<name>_`, default root.
    pub fn named(name: &str) -> Self {
        Self { prefix: format!("iox2_{name}_"), root: None }
    }

    /// The domain that the environment asks for: `SOFTTWIN_DOMAIN` is its name, `SOFTTWIN_ROOT` its folder.
    pub fn from_env() -> Self {
        let mut domain = match std::env::var("SOFTTWIN_DOMAIN") {
            Ok(name) if !name.is_empty() => Self::named(&name),
            _ => Self::default(),
        };
        domain.root = std::env::var("SOFTTWIN_ROOT").ok().filter(|root| !root.is_empty());
        domain
    }

    /// A domain nobody else is in: for tests and examples that must not meet each other.
    pub fn isolated(label: &str) -> Self {
        use std::sync::atomic::{AtomicU32, Ordering};
        static NEXT: AtomicU32 = AtomicU32::new(0);
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        Self::named(&format!("{label}_{}_{:x}_{number}", std::process::id(), crate::now_ns()))
    }

    /// Removes the management segment that outlives the last program of a domain: for domains that were made for one
    /// run (a test, a demonstration) and that everybody has left. Returns how many files went.
    ///
    /// # Errors
    /// The system's refusal to list or to remove.
    pub fn remove_leftovers(&self) -> std::io::Result<usize> {
        let mut removed = 0;
        for entry in std::fs::read_dir(crate::port::SHM_DIR)? {
            let entry = entry?;
            if self.owns_management_segment(&entry.file_name().to_string_lossy()) {
                std::fs::remove_file(entry.path())?;
                removed += 1;
            }
        }
        Ok(removed)
    }

    /// `<prefix><40 hex digits>_....global_mgmt`: the digits keep domain `a` from taking the files of domain `a_b`.
    fn owns_management_segment(&self, file: &str) -> bool {
        let Some(rest) = file.strip_prefix(&self.prefix) else { return false };
        let digits = rest.bytes().take_while(u8::is_ascii_hexdigit).count();
        digits == 40 && rest.ends_with(".global_mgmt")
    }

    /// iceoryx2's configuration for this domain. The host's configuration file is ignored on purpose: quality of service
    /// is fixed in this crate, and two programs of one domain must agree.
    pub(crate) fn config(&self) -> Result<Config, WireError> {
        let bad = |what: &'static str, value: &str| WireError::BadDomain { what, value: value.to_owned() };
        let mut config = Config::default();
        config.global.prefix =
            FileName::new(self.prefix.as_bytes()).map_err(|_| bad("prefix", &self.prefix))?;
        if let Some(root) = &self.root {
            config.global.set_root_path(&Path::new(root.as_bytes()).map_err(|_| bad("root", root))?);
        }
        Ok(config)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_domain_owns_its_own_management_segment_only() {
        let rest = "9204dd183d1c4d8e1ff592a30766ffa6765aa8b5_node.0_10_0.global_mgmt";
        let domain = Domain::named("a");
        assert!(domain.owns_management_segment(&format!("iox2_a_{rest}")));
        assert!(!domain.owns_management_segment(&format!("iox2_a_b_{rest}")), "that is domain a_b");
        assert!(!domain.owns_management_segment(&format!("iox2_{rest}")), "that is the default domain");
        assert!(!domain.owns_management_segment("iox2_a_123.data"), "that is somebody's data");
    }
}
