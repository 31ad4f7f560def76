//! Arguments of `softtwin hold`.

use super::goal::Goal;
use crate::live::DomainArgs;
use std::path::PathBuf;

const EXAMPLES: &str = "\
Examples:
  Hold a contact force until Ctrl-C:
    softtwin hold --scene config/scenes/force.toml --force-n 0.3
  See it before it runs: the same loop on a simulated actuator, with a picture:
    softtwin hold --scene config/scenes/force.toml --force-n 0.3 --simulate --out hold.svg
  Follow a series of targets (columns t_s and one of force_n, tip_y_mm, angle_deg, pressure_mpa):
    softtwin hold --scene config/scenes/force.toml --trace targets.csv";

const NOTES: &str = "\
Settings of the controller: [actuator.control] of the scene; range, rate and force limit: [actuator.valve]. With --json the last line is a JSON \
object: `followed` is the mean over the last quarter of what `measured_by` measured (without a sensor the model's value), `final_error` that minus \
the target. A fault lets go of the valve and ends the command with code 1. The law: docs/control.md";

/// Hold a force, a height of the tip, an angle or a pressure by driving the valve.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES, after_help = NOTES)]
pub struct Args {
    /// Scene of the twin; its model is the controller's.
    #[arg(long, value_name = "FILE")]
    pub(super) scene: PathBuf,
    /// Actuator; default: the scene's first.
    #[arg(long, value_name = "NAME")]
    pub(super) actuator: Option<String>,
    #[command(flatten)]
    pub(super) target: TargetArgs,
    /// Gap that is assumed if the twin's states have none, mm.
    #[arg(long = "gap", value_name = "MM", value_parser = crate::range::gap_mm)]
    pub(super) gap_mm: Option<f64>,
    /// Ends after this number of seconds; default: never, or 2 after the end of the trace. It always ends when no reading has come for a second.
    #[arg(long, value_name = "S", value_parser = crate::range::seconds)]
    pub(super) seconds: Option<f64>,
    /// The owner's name, by which another one is refused.
    #[arg(long, value_name = "NAME", default_value = "softtwin-hold")]
    pub(super) owner: String,
    /// Runs on a simulated actuator with the memory and swing of the settings, other stiffness, lag and play, and reports.
    #[arg(long)]
    pub(super) simulate: bool,
    /// Picture of the simulation (.svg, .png).
    #[arg(long, value_name = "FILE", requires = "simulate", help_heading = "Output")]
    pub(super) out: Option<PathBuf>,
    /// One JSON object.
    #[arg(long, help_heading = "Output")]
    pub(super) json: bool,
    #[command(flatten)]
    pub(super) domain: DomainArgs,
}

/// Wanted value; without one, control.hold of the scene where it is at the beginning.
#[derive(clap::Args)]
#[group(multiple = false)]
pub(super) struct TargetArgs {
    /// Contact force to hold, N.
    #[arg(long, value_name = "N", value_parser = crate::range::number(0.0, 1e6), help_heading = "Target")]
    pub(super) force_n: Option<f64>,
    /// Height of the scene's marker, mm; without markers the model's tip_y_mm, or the height of the middle of its end face.
    #[arg(long, value_name = "MM", allow_negative_numbers = true, value_parser = crate::range::number(-1e4, 1e4), help_heading = "Target")]
    pub(super) tip_y_mm: Option<f64>,
    /// The model's observable in degrees.
    #[arg(long, value_name = "DEG", allow_negative_numbers = true, value_parser = crate::range::number(-3600.0, 3600.0), help_heading = "Target")]
    pub(super) angle_deg: Option<f64>,
    /// Pressure: MPa, or with a unit (50kPa, 0.5bar, 7psi).
    #[arg(long = "pressure", value_name = "MPA", value_parser = crate::range::pressure_mpa, help_heading = "Target")]
    pub(super) pressure_mpa: Option<f64>,
    /// Series of targets.
    #[arg(long, value_name = "FILE.csv", help_heading = "Target")]
    pub(super) trace: Option<PathBuf>,
}

impl Args {
    /// Duration of the run, s; infinite until Ctrl-C.
    pub(super) fn seconds(&self, goal: &Goal) -> f64 {
        self.seconds.unwrap_or_else(|| goal.end_s().map_or(f64::INFINITY, |end_s| end_s + 2.0))
    }
}

#[cfg(test)]
#[path = "../../../tests/unit/cmd_hold_args.rs"]
mod tests;
