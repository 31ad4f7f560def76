//! How a command ends. Commands return `anyhow::Result`; what is the user's mistake is marked where it is found.

use std::fmt::{self, Display};
use std::io::{self, ErrorKind};

/// The ways a command can end; `main` gives each its exit code.
pub enum Outcome {
    /// Everything was done, or the reader of our output had enough (a closed pipe).
    Done,
    /// Something went wrong while running.
    Failed(String),
    /// The arguments do not fit together.
    Usage(String),
    /// A configuration file or an input file the user wrote is wrong.
    Configuration(String),
}

impl Outcome {
    /// Sorts a command's result.
    pub fn of(result: anyhow::Result<()>) -> Self {
        let Err(error) = result else { return Self::Done };
        let broken_pipe = |e: &(dyn std::error::Error + 'static)| {
            e.downcast_ref::<io::Error>().is_some_and(|e| e.kind() == ErrorKind::BrokenPipe)
        };
        if error.chain().any(broken_pipe) {
            return Self::Done;
        }
        let message = format!("{error:#}");
        match error.downcast_ref::<Mistake>() {
            Some(Mistake::Usage(_)) => Self::Usage(message),
            Some(Mistake::Configuration(_)) => Self::Configuration(message),
            None => Self::Failed(message),
        }
    }
}

/// A mistake of the user, which no repetition of the command will cure.
#[derive(Debug)]
pub enum Mistake {
    /// Arguments that do not fit together; exit code 2.
    Usage(String),
    /// A wrong configuration or input file; exit code 78.
    Configuration(String),
}

impl Display for Mistake {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Usage(message) | Self::Configuration(message) => f.write_str(message),
        }
    }
}

impl std::error::Error for Mistake {}

/// An error in the arguments: what was expected, what was found, what to do.
pub fn usage(message: impl Display) -> anyhow::Error {
    Mistake::Usage(message.to_string()).into()
}

/// An error in a file the user gave; the whole chain of causes is kept in the text.
pub fn configuration(error: impl Into<anyhow::Error>) -> anyhow::Error {
    Mistake::Configuration(format!("{:#}", error.into())).into()
}
