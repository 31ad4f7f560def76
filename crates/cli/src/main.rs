//! The program `softtwin-demo`: `softtwin demo` alone, without what the other commands need, so that a first build is short.
#![forbid(unsafe_code)]

use clap::FromArgMatches;
use cli::demo;
use std::process::ExitCode;

fn main() -> ExitCode {
    let matches = demo::command().get_matches(); // exits with 2 on wrong usage
    let demo = demo::Args::from_arg_matches(&matches).unwrap_or_else(|error| error.exit());
    runtime::service::start_logging("warn");
    cli::failure::exit_code("softtwin-demo", demo.run())
}
