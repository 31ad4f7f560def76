//! The order of a help: what the command does, its examples, usage, options, notes.

/// Template of a help whose examples stand in `before_help`.
pub const TEMPLATE: &str = runtime::service::HELP_TEMPLATE;

/// Gives a command and all below it this order.
#[must_use]
pub fn with_examples(command: clap::Command) -> clap::Command {
    command.help_template(TEMPLATE).mut_subcommands(with_examples)
}
