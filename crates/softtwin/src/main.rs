//! `softtwin`, the users' tool: trains, inspects, predicts, evaluates, shows and records what twins publish, draws.
//!
//! Each sub-command has a file under [`cmd`]. Exit codes are decided in [`failure`].
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
mod resources;
mod view;

use clap::Parser;
use failure::exit_code_and_message;
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
    let cli = Cli::parse(); // clap itself exits with 2 on wrong usage
    runtime::service::start_logging("warn");

    match exit_code_and_message(cli.command.run()) {
        None => ExitCode::SUCCESS,
        Some((code, message)) => fail(code, &message),
    }
}

#[expect(clippy::print_stderr, reason = "the last output of the program; nothing else can report it")]
fn fail(code: u8, message: &str) -> ExitCode {
    eprintln!("softtwin: {message}");
    ExitCode::from(code)
}
