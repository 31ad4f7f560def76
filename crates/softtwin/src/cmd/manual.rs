//! `softtwin manual`: the help of the programs as man pages and as completions of shells.

use crate::failure::usage;
use anyhow::Context;
use clap::Subcommand;
use clap_complete::Shell;
use std::fs::create_dir_all;
use std::path::{Path, PathBuf};

const EXAMPLES: &str = "\
Examples:
  softtwin manual --out build/manual
  man build/manual/man1/softtwin-predict.1

Writes DIR/man1 and DIR/completions. The Debian package installs both.";

/// Write man pages and shell completions of softtwin, softtwind and softtwin-demo.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES, hide = true)]
pub struct Args {
    /// Folder to write into; made when it is missing.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

impl Args {
    /// Writes the files.
    pub fn run(self) -> anyhow::Result<()> {
        if self.out.is_file() {
            return Err(usage(format!("--out: expected a folder, found a file ({})", self.out.display())));
        }
        let tool = clap::Command::new("softtwin")
            .version(env!("CARGO_PKG_VERSION"))
            .about("Digital twin of a soft pneumatic actuator: from pressure and gap to the whole deformed, stressed body");
        let programs =
            [super::Command::augment_subcommands(tool), softtwind::command(), softtwind::demo::command()];
        let [man, completions] = ["man1", "completions"].map(|name| self.out.join(name));
        create_dir_all(&man).with_context(|| man.display().to_string())?;
        create_dir_all(&completions).with_context(|| completions.display().to_string())?;
        programs.into_iter().try_for_each(|program| write(program, &man, &completions))
    }
}

/// A man page shows nothing before the name of its program: examples go to its end.
fn with_examples(command: clap::Command) -> clap::Command {
    let parts = [command.get_before_help(), command.get_after_help()];
    let text: Vec<String> = parts.into_iter().flatten().map(ToString::to_string).collect();
    command.after_help(text.join("\n\n")).mut_subcommands(with_examples)
}

fn write(mut program: clap::Command, man: &Path, completions: &Path) -> anyhow::Result<()> {
    // One page a program and one a sub-command: softtwin.1, softtwin-train.1, ... Before the completions, which add `help`.
    clap_mangen::generate_to(with_examples(program.clone()), man)
        .with_context(|| man.display().to_string())?;
    let name = program.get_name().to_owned();
    for shell in [Shell::Bash, Shell::Zsh, Shell::Fish] {
        clap_complete::generate_to(shell, &mut program, &name, completions)?;
    }
    Ok(())
}
