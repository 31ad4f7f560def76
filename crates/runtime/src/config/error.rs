//! Reading of configuration files and their errors.

use crate::file;
use serde::de::DeserializeOwned;
use std::fmt;
use std::path::{Path, PathBuf};

/// A configuration file that cannot be used; programs leave with exit code 78.
#[derive(Debug, Clone, PartialEq)]
pub struct ConfigError {
    pub path: PathBuf,
    /// All errors in it.
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
    let text = file::read_text(path, file::MAX_TEXT_BYTES)
        .map_err(|error| fail(format!("cannot read the file: {}", error.cause())))?;
    toml::from_str(&text).map_err(|error| fail(error.to_string().trim_end().to_owned()))
}

/// The results for all actuators, or the problems of all of them, each with the name of its actuator.
///
/// # Errors
/// At least one actuator has problems.
pub fn collect<'a, T>(
    path: &Path,
    results: impl IntoIterator<Item = (&'a str, Result<T, Vec<String>>)>,
) -> Result<Vec<T>, ConfigError> {
    let (mut found, mut problems) = (Vec::new(), Vec::new());
    for (actuator, result) in results {
        match result {
            Ok(value) => found.push(value),
            Err(errors) => {
                problems.extend(errors.into_iter().map(|error| format!("actuator `{actuator}`: {error}")))
            }
        }
    }
    ConfigError::unless(path, problems).map(|()| found)
}

impl ConfigError {
    /// Nothing wrong when there are no problems.
    ///
    /// # Errors
    /// The problems, when there are any.
    pub fn unless(path: &Path, problems: Vec<String>) -> Result<(), Self> {
        if problems.is_empty() { Ok(()) } else { Err(Self { path: path.into(), problems }) }
    }
}
