//! `softtwin`: the tool. Trains, inspects, predicts, evaluates, listens and draws.
//!
//! One file a sub-command under [`cmd`]. This file is the only place that decides exit codes.
#![forbid(unsafe_code)]
// Results go through `output!`, which survives a closed pipe; `println!` would panic there.
#![warn(clippy::print_stdout)]

mod cmd;
mod failure;
mod files;
mod live;
mod load;
mod output;
mod picture;
mod progress;
mod recording_data;
mod render;
mod resources;
mod view;

use clap::Parser;
use failure::Outcome;
use std::process::ExitCode;

const EXAMPLES: &str = "\
Examples:
  softtwin train --database models/pneunet/database --out finger.twin
  softtwin predict --model finger.twin --pressure-mpa 0.05 --gap-mm 40 --out state.vtu
  softtwin <COMMAND> --help    worked examples of every command

Exit codes: 0 done, 1 run-time failure, 2 usage, 78 configuration.
Results go to standard output, everything else to standard error (RUST_LOG=debug for more).";

/// Digital twin of a soft pneumatic actuator: from pressure and gap to the whole deformed, stressed body.
#[derive(Parser)]
#[command(name = "softtwin", version, about, after_help = EXAMPLES, propagate_version = true)]
struct Cli {
    #[command(subcommand)]
    command: cmd::Command,
}

fn main() -> ExitCode {
    let cli = Cli::parse(); // clap itself leaves with 2 on wrong usage
    runtime::service::start_logging("warn");

    match Outcome::of(cli.command.run()) {
        Outcome::Done => ExitCode::SUCCESS,
        Outcome::Failed(message) => leave(1, &message),
        Outcome::Usage(message) => leave(2, &message),
        Outcome::Configuration(message) => leave(78, &message),
    }
}

#[expect(clippy::print_stderr, reason = "the last words of the program, after all output")]
fn leave(code: u8, message: &str) -> ExitCode {
    eprintln!("softtwin: {message}");
    ExitCode::from(code)
}
