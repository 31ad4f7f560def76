//! The program `softtwin-studies`: reproduces the project's own figures and measures its programs. Users need none of it.
#![forbid(unsafe_code)]

use clap::Parser;
use std::process::ExitCode;

const EXAMPLES: &str = "\
Examples:
  softtwin-studies report --database models/pneunet/database    docs/report: the paper's tables and figures
  softtwin-studies validate                                     finite elements against the paper, a commercial solver, finer meshes
  softtwin-studies <COMMAND> --help                             worked examples of every command";

const NOTES: &str = "\
Exit codes: 0 done, 1 run-time failure or a missed bound, 2 usage, 78 configuration.
Results go to standard output, everything else to standard error (RUST_LOG=debug for more).";

/// The project's own studies: accuracy, speed, comparisons, long runs.
#[derive(Parser)]
#[command(name = "softtwin-studies", version, about, before_help = EXAMPLES, after_help = NOTES, propagate_version = true)]
struct Cli {
    #[command(subcommand)]
    command: studies::Command,
}

fn main() -> ExitCode {
    let cli = Cli::parse(); // exits with 2 on wrong usage
    runtime::service::start_logging("warn");
    softtwin::failure::exit_code("softtwin-studies", cli.command.run())
}
