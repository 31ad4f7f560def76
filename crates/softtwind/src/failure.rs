//! Exit codes. Commands return `anyhow::Result`; errors of usage and configuration are marked where they are found.

use std::error::Error;
use std::fmt::Display;
use std::io::{self, ErrorKind, Write};
use std::process::ExitCode;

/// An error of usage or configuration.
#[derive(Debug, thiserror::Error)]
#[error("{message}")]
struct Mistake {
    exit_code: u8,
    message: String,
}

/// Prints a command's error and returns the exit code: 0 for success or a closed output pipe, 1 run-time failure, 2 usage,
/// 78 configuration.
pub fn exit_code(program: &str, result: anyhow::Result<()>) -> ExitCode {
    let Err(error) = result else { return ExitCode::SUCCESS };
    let is_broken_pipe = |cause: &(dyn Error + 'static)| {
        cause.downcast_ref::<io::Error>().is_some_and(|cause| cause.kind() == ErrorKind::BrokenPipe)
    };
    if error.chain().any(is_broken_pipe) {
        return ExitCode::SUCCESS;
    }
    // A standard error that cannot be written (a full disk) leaves the exit code as the only report.
    let _ = writeln!(io::stderr(), "{program}: {error:#}");
    ExitCode::from(error.downcast_ref::<Mistake>().map_or(1, |mistake| mistake.exit_code))
}

/// An error in the arguments: expected value, found value, remedy. Exit code 2.
pub fn usage(message: impl Display) -> anyhow::Error {
    Mistake { exit_code: 2, message: message.to_string() }.into()
}

/// An error in a file of the user, with its chain of causes. Exit code 78.
pub fn configuration(error: impl Into<anyhow::Error>) -> anyhow::Error {
    Mistake { exit_code: 78, message: format!("{:#}", error.into()) }.into()
}
