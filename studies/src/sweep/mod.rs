//! The sweep of random states over a model, and its half-widths against fresh finite elements.

mod checks;
pub mod extent;

use crate::testbed::Testbed;
use anyhow::Context;
use extent::Extent;
use rom::model::Model;
use rom::snapshots::RegimeKind;
use serde_json::{Value, json};
use softtwin::{files, output, range};
use std::path::{Path, PathBuf};
use train::draws::Draws;

const EXAMPLES: &str = "\
Examples:
    softtwin-studies sweep
  Half-widths against 40 new states (about 10 s each) that contact at pressures below 5 kPa:
    softtwin-studies sweep --fresh 40 --below-mpa 0.005 --database target/sweep";

const NOTES: &str = "\
At random states inside the contact range the force must not be negative, must grow with pressure and fall with the gap. At the
onset of contact the coordinates, stress and force of both regimes must agree within the limits. The new states are simulated into a folder; states already in it are not
solved again. Ends with 1 if a check fails.";

/// Sweep random states over a model: monotonic force, continuity, half-widths against fresh finite elements.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES, after_help = NOTES)]
pub struct Args {
    /// Model file.
    #[arg(long, value_name = "FILE.twin", default_value = "models/pneunet/pneunet.twin")]
    model: PathBuf,
    #[command(flatten)]
    extent: Extent,
    /// Number of new states to simulate; their errors are compared with the half-widths (0 to 10000).
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = range::count(0, 10_000), requires = "database")]
    fresh: usize,
    /// Draw the new states at pressures below this, in MPa.
    #[arg(long, value_name = "MPA", default_value_t = range::MAX_PRESSURE_MPA, value_parser = range::pressure_mpa)]
    below_mpa: f64,
    /// Folder of the new states.
    #[arg(long, value_name = "DIR")]
    database: Option<PathBuf>,
    /// Actuator that is simulated.
    #[arg(long, value_name = "FILE.toml", default_value = "models/pneunet/actuator.toml")]
    actuator: PathBuf,
}

/// Draws per new state: those below a pressure can be rare.
const TRIES: usize = 10_000;

impl Args {
    /// Sweeps, simulates, prints.
    pub fn run(self) -> anyhow::Result<()> {
        let model = files::model(&self.model)?;
        let sweep = self.extent.sweep(&model)?;
        let fresh = match &self.database {
            Some(folder) if self.fresh > 0 => Some(self.fresh(&model, folder)?),
            _ => None,
        };
        let outside: Vec<String> = fresh.iter().flatten().flat_map(beyond).collect();
        output::json(&json!({ "sweep": sweep, "fresh": fresh, "beyond_their_halfwidths": outside }))?;
        self.extent.check(&sweep)?;
        let coverage = model.regime(RegimeKind::Contact).map_or(0.0, |regime| regime.halfwidths.coverage);
        let most = ((1.0 - coverage) * 3.0 * self.fresh as f64).ceil() as usize;
        anyhow::ensure!(
            outside.len() <= most,
            "expected at most {most} values beyond their half-widths of {} states, found {}",
            self.fresh,
            outside.len()
        );
        Ok(())
    }

    /// The cases of `softtwin evaluate` on states simulated now.
    fn fresh(&self, model: &Model, folder: &Path) -> anyhow::Result<Vec<Value>> {
        let mut draws = Draws::new(model, RegimeKind::Contact, self.extent.seed)?;
        let drawn = (0..self.fresh * TRIES).filter_map(|_| draws.draw(|state| state));
        let wanted = drawn.filter(|state| state.pressure_mpa() < self.below_mpa).take(self.fresh);
        let mut list = String::from("case,regime,split,pressure_mpa,gap_mm\n");
        for (k, state) in wanted.enumerate() {
            let (pressure_mpa, gap_mm) = (state.pressure_mpa(), state.gap_mm());
            list += &format!("sweep{k:04},contact,check,{pressure_mpa:.9},{gap_mm:.6}\n");
        }
        let found = list.lines().count() - 1;
        anyhow::ensure!(
            found == self.fresh,
            "only {found} states inside the training range are below {} MPa",
            self.below_mpa
        );
        let testbed = Testbed::new("sweep")?;
        let list = text(&testbed.write("cases.csv", list)?);
        let (folder, actuator, model) = (text(folder), text(&self.actuator), text(&self.model));
        testbed
            .run("softtwin", &["simulate", "--actuator", &actuator, "--cases", &list, "--out", &folder])?;
        let evaluate = ["evaluate", &model, "--database", &folder, "--split", "check", "--json"];
        let mut report: Value = serde_json::from_str(&testbed.run("softtwin", &evaluate)?)?;
        serde_json::from_value(report["cases"].take()).context("the evaluation has no cases")
    }
}

/// Values of a case that are off by more than their half-widths.
fn beyond(case: &Value) -> Vec<String> {
    let covered = case["covered"].as_object().into_iter().flatten();
    let missed = covered.filter(|(_, within)| **within == Value::Bool(false));
    missed.map(|(what, _)| format!("{}: {what}", case["case"].as_str().unwrap_or_default())).collect()
}

fn text(path: &Path) -> String {
    path.display().to_string()
}
