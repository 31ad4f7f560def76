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
