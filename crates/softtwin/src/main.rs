//! The program `softtwin`: trains, inspects, predicts, evaluates, listens and draws.
#![forbid(unsafe_code)]

use clap::Parser;
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
    command: softtwin::Command,
}

fn main() -> ExitCode {
    let cli = Cli::parse(); // exits with 2 on wrong usage
    runtime::service::start_logging("warn");
    softtwin::failure::exit_code("softtwin", cli.command.run())
}
