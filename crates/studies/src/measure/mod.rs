//! What readers, questions, further actuators, a gateway and viewers cost the twin, measured with real processes.
//!
//! Run from the repository's folder with a release build of all programs beside this one; the machine should have nothing else
//! to do. Results are one JSON object a line.

mod clients;
mod fingers;
mod gateway;
mod view;

use anyhow::Context;
use serde::Serialize;
use serde_json::Value;
use softtwin::daemon::Daemon;
use softtwin::output;
use softtwin::testbed::Testbed;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

const EXAMPLES: &str = "\
Examples:
    cargo build --release --workspace --bins
    target/release/softtwin-studies measure clients --seconds 60
    target/release/softtwin-studies measure fingers --fingers 10
  With the gateway, which another build makes:
    cargo build --release -p gateway --features network --bins
    target/release/softtwin-studies measure gateway --seconds 60 --rounds 3
    target/release/softtwin-studies measure view

Run it in the repository's folder, on a machine that has nothing else to do. One JSON object a line.";

/// Measure what readers, questions, actuators, the gateway and viewers cost a running twin.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(clap::Subcommand)]
enum What {
    Clients(clients::Args),
    Fingers(fingers::Args),
    Gateway(gateway::Args),
    View(view::Args),
}

impl Args {
    /// Measures and prints.
    pub fn run(self) -> anyhow::Result<()> {
        match self.what {
            What::Clients(args) => args.run(),
            What::Fingers(args) => args.run(),
            What::Gateway(args) => args.run(),
            What::View(args) => args.run(),
        }
    }
}

/// Time of each measurement.
#[derive(clap::Args)]
struct Duration {
    /// Seconds of each measurement.
    #[arg(long, value_name = "S", default_value_t = 60.0, value_parser = seconds)]
    seconds: f64,
}

fn seconds(text: &str) -> Result<f64, String> {
    let seconds: f64 = text.parse().map_err(|_| format!("expected a number, found {text}"))?;
    if (1.0..=86_400.0).contains(&seconds) { Ok(seconds) } else { Err("expected 1 to 86400 seconds".into()) }
}

/// The model that is measured.
fn model() -> anyhow::Result<PathBuf> {
    let path = Path::new("models/pneunet/pneunet.twin");
    path.canonicalize()
        .with_context(|| format!("expected {} below this folder; run this in the repository", path.display()))
}

/// A running twin and its bridge.
struct Twin {
    // Dropped in this order: the folder goes when nobody uses it any more.
    bridge: Daemon,
    twin: Daemon,
    testbed: Testbed,
}

impl Twin {
    /// Starts both and waits until they are ready. `twin` and `bridge` are further arguments.
    fn start(testbed: Testbed, scene: &Path, twin: &[&OsStr], bridge: &[&OsStr]) -> anyhow::Result<Self> {
        let twin = testbed.daemon("twin", scene, twin)?;
        let bridge = testbed.daemon("bridge", scene, bridge)?;
        Ok(Self { bridge, twin, testbed })
    }

    /// The twin's own reports, one a second; the first may cover time before the call.
    fn health(&self, reports: usize) -> anyhow::Result<Vec<Value>> {
        let count = reports.to_string();
        let text =
            self.testbed.run("softtwin", &["echo", "softtwin/finger/health", "--count", &count, "--json"])?;
        let sample = |line: &str| Ok(serde_json::from_str::<Value>(line)?["sample"].take());
        text.lines().map(sample).collect()
    }

    fn stop(mut self) -> anyhow::Result<()> {
        self.bridge.stop()?;
        self.twin.stop()
    }
}

/// Prints one result.
fn print(what: &str, result: impl Serialize) -> anyhow::Result<()> {
    output::json(&serde_json::json!({ "what": what, "result": result }))
}
