//! Cost of readers, queries, further actuators, a gateway and viewers for the twin, measured with processes.
//!
//! Run from the repository's folder with a release build of all programs beside this one; the machine should have nothing else
//! to do. Results are one JSON object per line.

mod clients;
mod fingers;
mod gateway;
mod latency;
mod model;
mod stress;
mod topics;
mod twin;
mod view;

const EXAMPLES: &str = "\
Examples:
    cargo build --release --workspace --bins
    target/release/softtwin-studies measure clients --seconds 60
    target/release/softtwin-studies measure fingers --fingers 10
  With the gateway, which another build makes:
    cargo build --release -p gateway --features network --bins
    target/release/softtwin-studies measure gateway --seconds 60 --rounds 3
    target/release/softtwin-studies measure view
  Models without a daemon (scripts/check.sh clients makes the Python environment):
    cargo build --release -p capi && target/release/softtwin-studies measure model
  Stress from modes against stress from mechanics; no daemon:
    target/release/softtwin-studies measure stress";

const NOTES: &str = "\
Run it in the repository's folder, on an idle machine. Prints one JSON object per line.";

/// Measure what readers, questions, actuators, the gateway and viewers cost a running twin.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES, after_help = NOTES)]
pub struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(clap::Subcommand)]
enum What {
    Clients(clients::Args),
    Fingers(fingers::Args),
    Gateway(gateway::Args),
    Latency(latency::Args),
    Model(model::Args),
    Stress(stress::Args),
    Topics(topics::Args),
    View(view::Args),
}

impl Args {
    /// Measures and prints.
    pub fn run(self) -> anyhow::Result<()> {
        match self.what {
            What::Clients(args) => args.run(),
            What::Fingers(args) => args.run(),
            What::Gateway(args) => args.run(),
            What::Latency(args) => args.run(),
            What::Model(args) => args.run(),
            What::Stress(args) => args.run(),
            What::Topics(args) => args.run(),
            What::View(args) => args.run(),
        }
    }
}
