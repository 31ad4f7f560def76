//! `softtwind`: the daemon. `bridge` feeds readings into shared memory, `twin` answers them with states and fields. In addition
//! the parts that all programs share at the command line (exit codes, output, ranges of arguments, child processes, samples
//! as one line, latencies, installed files) and the demonstration.
//!
//! The start-up order is the order of `bridge::run` and `twin::run`: banner, whole configuration, shared memory and topics, ready,
//! loop, summary. Nothing is bound before the whole configuration has been checked.
#![forbid(unsafe_code)]
// Results go through `output!`, which survives a closed pipe; `println!` would panic there.
#![warn(clippy::print_stdout)]

pub mod daemon;
pub mod demo;
pub mod failure;
pub mod help;
pub mod latency;
pub mod output;
pub mod range;
pub mod shared_files;
pub mod text;

mod bridge;
mod bridge_reload;
mod metrics;
mod options;
mod reading_use;
mod reload;
mod reporter;
mod side_services;
mod twin;

pub use options::DomainArgs;

use clap::{CommandFactory, Parser};
use runtime::config::ConfigError;
use runtime::service;
use std::process::ExitCode;

/// Run-time failure.
const EXIT_FAILURE: u8 = 1;
/// Configuration: no restart will cure it (`EX_CONFIG`, see `RestartPreventExitStatus` in the units).
const EXIT_CONFIG: u8 = 78;

/// The command line, for the manual.
pub fn command() -> clap::Command {
    options::Options::command()
}

/// The program: reads the command line, logs, runs; returns the exit code.
pub fn main() -> ExitCode {
    service::keep_memory_small();
    let options = options::Options::parse(); // clap itself leaves with 2 on wrong usage
    service::start_logging("info");
    let ended = match options.command {
        options::Command::Bridge(options) => bridge::run(&options),
        options::Command::Twin(options) => twin::run(&options),
    };
    match ended {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            tracing::error!("{error:#}");
            let is_of_a_file = error.chain().any(|cause| cause.is::<ConfigError>());
            let configuration = is_of_a_file || failure::names_no_domain(&error);
            ExitCode::from(if configuration { EXIT_CONFIG } else { EXIT_FAILURE })
        }
    }
}
