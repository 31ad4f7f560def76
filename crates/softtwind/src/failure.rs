//! Exit codes. Commands return `anyhow::Result`; errors of usage and configuration are marked where they are found.

use std::error::Error;
use std::fmt::Display;
use std::io::{self, ErrorKind, Write};
use std::process::ExitCode;
use wire::WireError;

/// An error of usage or configuration.
#[derive(Debug, thiserror::Error)]
#[error("{message}")]
struct Mistake {
    exit_code: u8,
    message: String,
}

/// Prints a command's error, with `--json` as one JSON object, and returns the exit code of the program: 0 without an error or if
/// the reader of the output closed the pipe; 1 run-time failure, 2 usage, 65 a model that does not explain the data, 78 configuration.
pub fn exit_code(program: &str, result: anyhow::Result<()>) -> ExitCode {
    let Err(error) = result else { return ExitCode::SUCCESS };
    let is_broken_pipe = |cause: &(dyn Error + 'static)| {
        cause.downcast_ref::<io::Error>().is_some_and(|cause| cause.kind() == ErrorKind::BrokenPipe)
    };
    if error.chain().any(is_broken_pipe) {
        return ExitCode::SUCCESS;
    }
    let exit_code = match error.downcast_ref::<Mistake>() {
        Some(mistake) => mistake.exit_code,
        None if names_no_domain(&error) => 78,
        None => 1,
    };
    // A standard error that cannot be written (a full disk) leaves the exit code as the only report.
    let _ = match std::env::args_os().any(|argument| argument == "--json") {
        true => writeln!(io::stderr(), "{}", as_json(&error, exit_code)),
        false => writeln!(io::stderr(), "{program}: {}", text_of(&error)),
    };
    ExitCode::from(exit_code)
}

/// An error with its causes. The message of a library's error often ends with its cause, which is then not said once more.
fn text_of(error: &anyhow::Error) -> String {
    error.chain().map(ToString::to_string).fold(String::new(), |text, cause| match text.contains(&cause) {
        true => text,
        false if text.is_empty() => cause,
        false => format!("{text}: {cause}"),
    })
}

/// Whether a program was told to join a shared-memory domain that is another user's or has an impossible name.
pub fn names_no_domain(error: &anyhow::Error) -> bool {
    error.chain().any(|cause| cause.downcast_ref().is_some_and(WireError::is_configuration))
}

/// One JSON object with the error's `code`: `usage`, `unexplained_data`, `configuration` or `run_time`.
fn as_json(error: &anyhow::Error, exit_code: u8) -> serde_json::Value {
    let code = match exit_code {
        2 => "usage",
        65 => "unexplained_data",
        78 => "configuration",
        _ => "run_time",
    };
    serde_json::json!({ "code": code, "exit_code": exit_code, "error": text_of(error) })
}

/// An error in the arguments: expected value, found value, remedy. Exit code 2.
pub fn usage(message: impl Display) -> anyhow::Error {
    Mistake { exit_code: 2, message: message.to_string() }.into()
}

/// The model does not explain the data. Exit code 65.
pub fn unexplained(message: impl Display) -> anyhow::Error {
    Mistake { exit_code: 65, message: message.to_string() }.into()
}

/// An error in a file the user gave; the text keeps the whole chain of causes. Exit code 78.
pub fn configuration(error: impl Into<anyhow::Error>) -> anyhow::Error {
    Mistake { exit_code: 78, message: text_of(&error.into()) }.into()
}
