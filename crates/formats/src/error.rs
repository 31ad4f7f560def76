//! One error type for all files: a refusal of the operating system, or the list of everything that is wrong.

use std::fmt::{self, Display};
use std::io;
use std::path::{Path, PathBuf};

/// How many diagnostics a message lists before it only counts the others.
const SHOWN: usize = 12;

/// One thing that is wrong with a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Diagnostic {
    /// Where: a key, a row and column, a byte range.
    pub place: String,
    /// What belongs there.
    pub expected: String,
    /// What is there.
    pub found: String,
}

impl Diagnostic {
    /// A diagnostic at `place`.
    pub fn new(place: impl Display, expected: impl Display, found: impl Display) -> Self {
        Self { place: place.to_string(), expected: expected.to_string(), found: found.to_string() }
    }
}

impl Display for Diagnostic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: expected {}, found {}", self.place, self.expected, self.found)
    }
}

/// Why a file was refused.
#[derive(Debug, thiserror::Error)]
pub enum FormatError {
    /// The operating system refused.
    #[error("cannot {action} {path}")]
    Io {
        /// `read`, `write`, `list`.
        action: &'static str,
        /// The file.
        path: PathBuf,
        /// Its reason.
        source: io::Error,
    },
    /// The content is wrong: everything that could be found in one pass.
    #[error("{path}: {}", list(.diagnostics))]
    Content {
        /// The file.
        path: PathBuf,
        /// What is wrong, in file order; never empty.
        diagnostics: Vec<Diagnostic>,
    },
}

impl FormatError {
    /// The operating system's refusal to read.
    pub fn read(path: &Path, source: io::Error) -> Self {
        Self::Io { action: "read", path: path.into(), source }
    }

    /// The operating system's refusal to write.
    pub fn write(path: &Path, source: io::Error) -> Self {
        Self::Io { action: "write", path: path.into(), source }
    }

    /// A single diagnostic.
    pub fn one(path: &Path, diagnostic: Diagnostic) -> Self {
        Self::Content { path: path.into(), diagnostics: vec![diagnostic] }
    }

    /// `Ok(value)` where there are no diagnostics.
    ///
    /// # Errors
    /// [`FormatError::Content`] with all of them.
    pub fn check<T>(value: T, path: &Path, diagnostics: Vec<Diagnostic>) -> Result<T, Self> {
        if diagnostics.is_empty() { Ok(value) } else { Err(Self::Content { path: path.into(), diagnostics }) }
    }
}

/// The value, or `None` with its diagnostic added to the list.
pub fn collect<T>(result: Result<T, Diagnostic>, diagnostics: &mut Vec<Diagnostic>) -> Option<T> {
    result.map_err(|diagnostic| diagnostics.push(diagnostic)).ok()
}

fn list(diagnostics: &[Diagnostic]) -> String {
    let mut text: Vec<String> = diagnostics.iter().take(SHOWN).map(Diagnostic::to_string).collect();
    if diagnostics.len() > SHOWN {
        text.push(format!("and {} more problems", diagnostics.len() - SHOWN));
    }
    text.join("\n  ")
}
