//! The program `softtwin-demo`: `softtwin demo` alone, without what the other commands need, so that a first build is short.
#![forbid(unsafe_code)]

use clap::Parser;
use std::process::ExitCode;

/// Digital twin of a soft pneumatic actuator, demonstration.
#[derive(Parser)]
#[command(name = "softtwin-demo", version)]
struct Cli {
    #[command(flatten)]
    demo: cli::demo::Args,
}

fn main() -> ExitCode {
    let cli = Cli::parse(); // exits with 2 on wrong usage
    runtime::service::start_logging("warn");
    cli::failure::exit_code("softtwin-demo", cli.demo.run())
}
