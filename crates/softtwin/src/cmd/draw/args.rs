//! The arguments of `softtwin draw`.

use crate::failure::usage;
use crate::options::setting;
use crate::picture::states::Look;
use anyhow::Result;
use std::path::PathBuf;

const EXAMPLES: &str = "\
Examples:
  One state of the body, the plate 40 mm below the base:
    softtwin draw models/pneunet/pneunet.twin \\
      --pressure 50kPa --gap 40 --out state.png
  The same seen from the side, coloured by displacement, for a dark page:
    softtwin draw finger.twin --pressure 50kPa --gap 40 \\
      --view side --field displacement --theme dark --out state.png
  The modes of the contact regime (the paper's Fig. 6), three gaps at five pressures (its Fig. 9):
    softtwin draw finger.twin --modes contact --out modes.png
    softtwin draw finger.twin --fig9 --out scenes.png
  A whole scene: both fingers of the gripper and the block between them
    softtwin draw config/scenes/gripper.toml \\
      --pressure 79kPa --view side --out gripper.png
  The markers of a measured model:
    softtwin draw arm.twin --set p_seg1_a_mpa=0.02 --out arm.png
  A case of a database, as computed by the finite elements:
    softtwin draw models/pneunet/database --case 17 --out case.png
  What a model has learnt: contact force over pressure and gap with the training states, and three others
    softtwin draw finger.twin --chart force-map \\
      --database models/pneunet/database --out force.png
    softtwin draw finger.twin --chart singular-values --out modes.svg
    softtwin draw finger.twin --chart coefficients --out coefficients.svg
    softtwin draw finger.twin --chart observables --out observables.svg
  A recording over time: pressure, gap, force, observables, latency; with a model also displacement and stress
    softtwin draw run.mcap --model finger.twin --out run.png
  A table of a bench: its inputs and outputs over time
    softtwin draw run1.csv --log log.toml --out run.png";

/// Largest pressure and gap that are drawn.
const MAX_PRESSURE_MPA: f64 = 100.0;
const MAX_GAP_MM: f64 = 10_000.0;

/// Draw a picture of a body, of what a model has learnt, or of a recording over time.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES)]
pub struct Args {
    /// Model (.twin), scene (.toml), database folder (with --case), recording (.mcap or its folder), or a bench's table (with --log).
    #[arg(value_name = "SOURCE")]
    pub source: PathBuf,
    /// Picture to write: .png; charts and recordings also .svg.
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    pub out: PathBuf,
    /// Draw what the model has learnt instead of a body.
    #[arg(long, value_name = "KIND", conflicts_with_all = ["pressure_mpa", "gap_mm", "settings", "modes", "fig9", "case"])]
    pub chart: Option<Chart>,
    /// Database whose states are marked in the force map.
    #[arg(long, value_name = "DIR", requires = "chart")]
    pub database: Option<PathBuf>,
    /// Model that computes displacement and stress along a recording.
    #[arg(long, value_name = "FILE.twin", conflicts_with = "log")]
    pub model: Option<PathBuf>,
    /// Mapping of the columns of a bench's table.
    #[arg(long, value_name = "FILE.toml")]
    pub log: Option<PathBuf>,
    /// Case of the database, by its name.
    #[arg(long, value_name = "NAME", help_heading = "State")]
    pub case: Option<String>,
    /// Pressure in the chambers: MPa, or with a unit such as 50kPa, 0.5bar, 7psi; 0 to 100 MPa.
    #[arg(long = "pressure", value_name = "MPA", value_parser = crate::range::pressure_mpa, help_heading = "State")]
    pub pressure_mpa: Option<f64>,
    /// Gap from the underside of the undeformed base to the plate, mm (0 to 10000); no plate when left out.
    #[arg(long = "gap", value_name = "MM", value_parser = crate::range::gap_mm, help_heading = "State")]
    pub gap_mm: Option<f64>,
    /// Another input of the model; default: its nominal value.
    #[arg(long = "set", value_name = "NAME=VALUE", value_parser = setting, help_heading = "State")]
    pub settings: Vec<(String, f64)>,
    /// Draw the POD modes of a regime: free or contact.
    #[arg(long, value_name = "REGIME", conflicts_with_all = ["pressure_mpa", "gap_mm", "fig9", "settings"], help_heading = "State")]
    pub modes: Option<String>,
    /// Draw gaps 80, 40 and 15 mm at 0.01, 0.025, 0.04, 0.055 and 0.07 MPa, or states in the model's training range.
    #[arg(long, conflicts_with_all = ["pressure_mpa", "gap_mm"], help_heading = "State")]
    pub fig9: bool,
    #[command(flatten)]
    pub look: Look,
}

/// What a model has learnt.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Chart {
    /// Contact force over pressure and gap.
    ForceMap,
    /// Singular values by regime and group.
    SingularValues,
    /// Leading modal coefficients of the free regime over its inputs.
    Coefficients,
    /// Observables of the free regime, outputs of a measured model, over the inputs.
    Observables,
}

impl Args {
    /// The pressure (MPa) of the state to draw, checked together with the gap.
    pub fn pressure_mpa(&self) -> Result<f64> {
        let pressure = self.pressure_mpa.ok_or_else(|| {
            usage("which state? give --pressure (and --gap), --modes, --fig9 or --chart; see --help for examples")
        })?;
        let gap_mm = self.gap_mm.unwrap_or(0.0);
        if (0.0..=MAX_PRESSURE_MPA).contains(&pressure) && (0.0..=MAX_GAP_MM).contains(&gap_mm) {
            return Ok(pressure);
        }
        Err(usage(format!(
            "expected a pressure of 0 to {MAX_PRESSURE_MPA} MPa and a gap of 0 to {MAX_GAP_MM} mm, found {pressure} MPa, {gap_mm} mm"
        )))
    }
}
