//! The sub-commands, one file each. To add one: a `mod` line and a line in `commands!`.
//!
//! A command's file has a `pub struct Args` (clap derive: names, units, examples) and `impl Args { pub fn run(self) ->
//! anyhow::Result<()> }`. What the user got wrong is marked with [`crate::failure`]; results are printed with `output!`.

use hold::tune;
use softtwind::demo;

mod build;
mod calibrate;
mod compare;
mod design;
mod doctor;
mod draw;
mod echo;
mod evaluate;
mod export;
mod get;
mod hold;
mod import;
mod inspect;
mod learn;
mod list;
mod manual;
mod material;
mod mesh;
mod new;
mod pack;
mod predict;
mod record;
mod replay;
mod sample;
mod setpoint;
mod simulate;
mod top;
mod train;
mod view;

/// Declares the enum clap parses into, its dispatch, and the groups in which help lists the commands.
macro_rules! commands {
    ($($heading:literal: $($variant:ident => $module:ident),* $(,)?;)*) => {
        /// Sub-command; each variant's text is the doc comment of its `Args`.
        #[derive(clap::Subcommand)]
        pub enum Command { $($($variant($module::Args),)*)* }

        impl Command {
            /// Headings and the names of their commands, in the order of the help.
            const GROUPS: &[(&str, &[&str])] = &[$(($heading, &[$(stringify!($module)),*])),*];

            /// Runs the chosen command.
            pub fn run(self) -> anyhow::Result<()> {
                match self { $($(Self::$variant(args) => args.run(),)*)* }
            }
        }
    };
}

commands! {
    "Make a model": New => new, Material => material, Build => build, Mesh => mesh, Sample => sample, Simulate => simulate,
        Import => import, Pack => pack, Train => train, Learn => learn;
    "Ask a model": Predict => predict, Design => design, Inspect => inspect, Export => export, Draw => draw;
    "Measure": Evaluate => evaluate, Compare => compare, Calibrate => calibrate;
    "Run and watch": Demo => demo, View => view, Top => top, List => list, Echo => echo, Get => get, Record => record,
        Replay => replay, Doctor => doctor;
    "Drive": Hold => hold, Setpoint => setpoint, Tune => tune;
    "": Manual => manual;
}

impl Command {
    /// The commands of a program in their groups, one line each, for its help.
    pub fn groups(program: &clap::Command) -> String {
        let about = |name: &str| {
            let name = &name.replace('_', "-");
            let found = program.get_subcommands().find(|command| command.get_name() == name);
            found.and_then(|command| command.get_about()).map_or_else(String::new, ToString::to_string)
        };
        let line = |name: &&str| {
            let about = folded(&about(name), HELP_WIDTH - NAME_WIDTH).join(&format!("\n{:NAME_WIDTH$}", ""));
            format!("  {:<width$} {about}\n", name.replace('_', "-"), width = NAME_WIDTH - 3)
        };
        let group = |(heading, names): &(&str, &[&str])| {
            format!("{heading}:\n{}", names.iter().map(line).collect::<String>())
        };
        Self::GROUPS
            .iter()
            .filter(|(heading, _)| !heading.is_empty())
            .map(group)
            .collect::<Vec<_>>()
            .join("\n")
    }
}

/// Columns of the help, and where a command's line begins to say what it does.
const HELP_WIDTH: usize = 80;
const NAME_WIDTH: usize = 18;

/// Words in lines of at most `width` columns.
fn folded(text: &str, width: usize) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if line.is_empty() => line.push_str(word),
            Some(line) if line.len() + 1 + word.len() <= width => *line += &format!(" {word}"),
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

#[cfg(test)]
#[path = "../../tests/unit/cmd.rs"]
mod tests;
