//! Tests of `src/cmd/mod.rs`.

use super::*;
use clap::Subcommand;

/// Columns of a help that goes to no terminal; longer lines are folded.
const PIPED_WIDTH: usize = 100;

fn check(command: &clap::Command) {
    let name = command.get_name();
    let text = command.get_before_help().map(ToString::to_string).unwrap_or_default();
    assert!(text.starts_with("Example"), "{name} --help has no example: {text}");
    let is_command =
        |line: &&str| ["softtwin", "sudo", "--"].iter().any(|s| line.trim_start().starts_with(s));
    let long = text.lines().filter(is_command).find(|line| line.len() >= PIPED_WIDTH);
    assert_eq!(long, None, "{name}: a command folded without a backslash cannot be pasted");
    command.get_subcommands().for_each(check);
}

#[test]
fn every_help_has_examples_without_folded_lines() {
    let tool = Command::augment_subcommands(clap::Command::new("softtwin").before_help("Example"));
    [tool, softtwind::command(), demo::command()].iter().for_each(check);
}

#[test]
fn list_of_commands_fits_eighty_columns() {
    let listed = Command::groups(&Command::augment_subcommands(clap::Command::new("softtwin")));
    assert_eq!(listed.lines().find(|line| line.len() > HELP_WIDTH), None, "{listed}");
    assert!(
        listed.lines().filter(|line| line.starts_with("  ") && !line.starts_with("   ")).count() <= 30,
        "{listed}"
    );
}
