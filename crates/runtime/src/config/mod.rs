//! Configuration in two steps: typed by serde (unknown keys are refused), then checked as a whole. All problems are
//! reported at once, each with its key, expected and found.

mod grasp;
mod scene;
mod settings;

pub use grasp::{BlockSpec, GraspSpec, PlaceSpec};
pub use scene::{
    ActuatorSpec, FixedNodes, Gap, Measured, NodesSpec, OutputSpec, Precision, Queries, Scene, StateSpec,
};
pub(crate) use settings::ms_to_ns;
pub use settings::{Limits, OnMissingRights, OutsideDomain, Realtime, Settings};

use serde::de::DeserializeOwned;
use std::fmt;
use std::path::{Path, PathBuf};

/// A configuration file that cannot be used; programs leave with exit code 78.
#[derive(Debug, Clone, PartialEq)]
pub struct ConfigError {
    /// The file.
    pub path: PathBuf,
    /// Everything that is wrong with it.
    pub problems: Vec<String>,
}

impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let count = self.problems.len();
        let plural = if count == 1 { "" } else { "s" };
        write!(f, "{count} problem{plural} in the configuration:")?;
        for problem in &self.problems {
            write!(f, "\n  {}", problem.replace('\n', "\n    "))?;
        }
        write!(f, "\n  ({})", self.path.display())
    }
}

impl std::error::Error for ConfigError {}

/// Reads a TOML file into `T`; unknown keys and wrong types are errors with line and column.
///
/// # Errors
/// A file that cannot be read, is no TOML or does not fit `T`.
pub fn read<T: DeserializeOwned>(path: &Path) -> Result<T, ConfigError> {
    let fail = |problem: String| ConfigError { path: path.into(), problems: vec![problem] };
    let text =
        std::fs::read_to_string(path).map_err(|error| fail(format!("cannot read the file: {error}")))?;
    toml::from_str(&text).map_err(|error| fail(error.to_string().trim_end().to_owned()))
}
