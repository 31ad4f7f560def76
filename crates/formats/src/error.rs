//! One error for all files: what could not be read or written, or the list of everything that is wrong with it.

use std::fmt::{self, Display};
use std::io;
use std::path::{Path, PathBuf};

/// How many problems are spelt out before the rest is only counted.
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
    /// A problem at `place`.
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
    /// The content is wrong; every problem that could be found in one pass.
    #[error("{path}: {}", list(.problems))]
    Content {
        /// The file.
        path: PathBuf,
        /// What is wrong, in file order; never empty.
        problems: Vec<Diagnostic>,
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

    /// A single problem.
    pub fn one(path: &Path, problem: Diagnostic) -> Self {
        Self::Content { path: path.into(), problems: vec![problem] }
    }

    /// `Ok(value)` when there is no problem.
    pub fn unless<T>(value: T, path: &Path, problems: Vec<Diagnostic>) -> Result<T, Self> {
        if problems.is_empty() { Ok(value) } else { Err(Self::Content { path: path.into(), problems }) }
    }
}

fn list(problems: &[Diagnostic]) -> String {
    let mut text: Vec<String> = problems.iter().take(SHOWN).map(Diagnostic::to_string).collect();
    if problems.len() > SHOWN {
        text.push(format!("and {} more problems", problems.len() - SHOWN));
    }
    text.join("\n  ")
}
