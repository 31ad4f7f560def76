//! A running twin that is measured, and what the measurements share.

use crate::testbed::Testbed;
use anyhow::Context;
use serde::Serialize;
use serde_json::Value;
use softtwin::daemon::Daemon;
use softtwin::{output, range};
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

/// Time of each measurement.
#[derive(clap::Args)]
pub struct Duration {
    /// Seconds of each measurement.
    #[arg(long, value_name = "S", default_value_t = 60.0, value_parser = range::seconds)]
    pub seconds: f64,
}

/// The model that is measured.
pub fn model() -> anyhow::Result<PathBuf> {
    let path = Path::new("models/pneunet/pneunet.twin");
    path.canonicalize()
        .with_context(|| format!("expected {} below this folder; run this in the repository", path.display()))
}

/// A running twin and its bridge.
pub struct Twin {
    // Dropped in this order: the folder is removed last.
    bridge: Daemon,
    /// The twin.
    pub twin: Daemon,
    /// Folder and domain.
    pub testbed: Testbed,
}

impl Twin {
    /// Starts both and waits until they are ready. `twin` and `bridge` are further arguments.
    pub fn start(testbed: Testbed, scene: &Path, twin: &[&OsStr], bridge: &[&OsStr]) -> anyhow::Result<Self> {
        let twin = testbed.daemon("twin", scene, twin)?;
        let bridge = testbed.daemon("bridge", scene, bridge)?;
        Ok(Self { bridge, twin, testbed })
    }

    /// The twin's own reports, one a second; the first may cover time before the call.
    pub fn health(&self, reports: usize) -> anyhow::Result<Vec<Value>> {
        let count = reports.to_string();
        let text =
            self.testbed.run("softtwin", &["echo", "softtwin/finger/health", "--count", &count, "--json"])?;
        let sample = |line: &str| Ok(serde_json::from_str::<Value>(line)?["sample"].take());
        text.lines().map(sample).collect()
    }

    /// Stops both.
    pub fn stop(mut self) -> anyhow::Result<()> {
        self.bridge.stop()?;
        self.twin.stop()
    }
}

/// Prints one result.
pub fn print(what: &str, result: impl Serialize) -> anyhow::Result<()> {
    output::json(&serde_json::json!({ "what": what, "result": result }))
}
