//! Error type of all files: an I/O error, or the list of all errors in the content.

use std::fmt::{self, Display};
use std::io;
use std::path::{Path, PathBuf};

/// How many diagnostics a message lists before it only counts the others.
const SHOWN: usize = 12;

/// Longest part of a diagnostic, in characters: a file may have a line of any length, and a message is to be read.
const LONGEST: usize = 400;

/// Error in the content of a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Diagnostic {
    /// Place: a key, a row and column, a byte range.
    pub place: String,
    pub expected: String,
    pub found: String,
}

impl Diagnostic {
    /// Creates a diagnostic at `place`.
    pub fn new(place: impl Display, expected: impl Display, found: impl Display) -> Self {
        Self { place: bounded(&place), expected: bounded(&expected), found: bounded(&found) }
    }
}

/// Its text, cut in the middle: beginning and end are what tells.
fn bounded(part: &dyn Display) -> String {
    let text = part.to_string();
    if text.len() <= LONGEST {
        return text;
    }
    let half = LONGEST / 2;
    let tail: Vec<char> = text.chars().rev().take(half).collect();
    let head: String = text.chars().take(half).collect();
    format!("{head} ... {}", tail.into_iter().rev().collect::<String>())
}

impl Display for Diagnostic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: expected {}, found {}", self.place, self.expected, self.found)
    }
}

/// Error of a file.
#[derive(Debug, thiserror::Error)]
pub enum FormatError {
    /// I/O error.
    #[error("cannot {action} {path}")]
    Io {
        /// `read`, `write`, `list`.
        action: &'static str,
        path: PathBuf,
        source: io::Error,
    },
    /// The content is wrong: everything that could be found in one pass.
    #[error("{path}: {}", list(.diagnostics))]
    Content {
        path: PathBuf,
        /// Errors in file order; never empty.
        diagnostics: Vec<Diagnostic>,
    },
    /// The content cannot be used, for a reason that is a sentence of its own.
    #[error("{path}: {reason}")]
    Refused { path: PathBuf, reason: String },
}

impl FormatError {
    /// I/O error on reading.
    pub fn read(path: &Path, source: io::Error) -> Self {
        Self::Io { action: "read", path: path.into(), source }
    }

    /// I/O error on writing.
    pub fn write(path: &Path, source: io::Error) -> Self {
        Self::Io { action: "write", path: path.into(), source }
    }

    /// A file that cannot be used: what was expected, what was found, and what helps.
    pub fn refused(path: &Path, reason: impl Display) -> Self {
        Self::Refused { path: path.into(), reason: reason.to_string() }
    }

    pub fn one(path: &Path, diagnostic: Diagnostic) -> Self {
        Self::Content { path: path.into(), diagnostics: vec![diagnostic] }
    }

    /// What is wrong without the path, for messages that name the file themselves.
    pub fn cause(&self) -> String {
        match self {
            Self::Io { source, .. } => source.to_string(),
            Self::Content { diagnostics, .. } => list(diagnostics),
            Self::Refused { reason, .. } => reason.clone(),
        }
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
