//! `softtwin material`: constants of a silicone from its tests.

mod columns;
mod description;
mod fit;
mod report;
mod specimen;

use anyhow::Result;

/// Fit a silicone's law to its tension, shear, biaxial and compression tests.
#[derive(clap::Args)]
#[command(before_help = fit::EXAMPLES)]
pub struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(clap::Subcommand)]
enum What {
    Fit(fit::Args),
}

impl Args {
    /// Runs the chosen command.
    ///
    /// # Errors
    /// Those of the command.
    pub fn run(self) -> Result<()> {
        match self.what {
            What::Fit(args) => args.run(),
        }
    }
}
