//! The program `softtwin-demo`: `softtwin demo` without the dependencies of the other commands, for a short first build.
#![forbid(unsafe_code)]

use clap::FromArgMatches;
use softtwind::demo;
use std::process::ExitCode;

fn main() -> ExitCode {
    let matches = demo::command().get_matches(); // exits with 2 on wrong usage
    let demo = demo::Args::from_arg_matches(&matches).unwrap_or_else(|error| error.exit());
    runtime::service::start_logging("warn");
    softtwind::failure::exit_code("softtwin-demo", demo.run())
}
