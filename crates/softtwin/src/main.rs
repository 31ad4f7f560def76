//! The program `softtwin`: trains, inspects, predicts, evaluates, listens and draws.
#![forbid(unsafe_code)]

use clap::{CommandFactory, FromArgMatches, Parser};
use picture::EndingError;
use std::process::ExitCode;

const EXAMPLES: &str = "\
Example: a recorded pressure trace becomes live fields
  softtwin demo --seconds 10
  softtwin COMMAND --help      what a command does, worked examples, all options";

const CODES: &str = "\
Exit codes: 0 done, 1 run-time failure, 2 usage, 78 configuration.
Results go to standard output, everything else to standard error (RUST_LOG=debug for more).";

/// Digital twin of a soft pneumatic actuator: from pressure and gap to the whole deformed, stressed body.
#[derive(Parser)]
#[command(name = "softtwin", version, about, before_help = EXAMPLES, after_help = CODES, propagate_version = true)]
struct Cli {
    #[command(subcommand)]
    command: softtwin::Command,
}

fn main() -> ExitCode {
    let cli = parse();
    runtime::service::start_logging("warn");
    let ended = cli.command.run().map_err(|error| match error.is::<EndingError>() {
        true => softtwin::failure::usage(error),
        false => error,
    });
    softtwin::failure::exit_code("softtwin", ended)
}

/// Reads the command line; wrong usage ends the program with 2, help with 0.
fn parse() -> Cli {
    let command = Cli::command();
    let groups = softtwin::Command::groups(&command);
    let template = format!(
        "{{about}}\n\n{{before-help}}{{usage-heading}} {{usage}}\n\n{groups}\nOptions:\n{{options}}{{after-help}}"
    );
    let mut command = softtwin::help::with_examples(command).help_template(template);
    let parsed = command.try_get_matches_from_mut(std::env::args_os());
    parsed
        .and_then(|found| Cli::from_arg_matches(&found))
        .unwrap_or_else(|error| error.format(&mut command).exit())
}
