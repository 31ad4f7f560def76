//! `softtwin grasp`.

use crate::failure::{configuration, usage};
use crate::report;
use recording::message::Json;
use runtime::config::Scene;
use runtime::grasp::GraspModel;
use std::path::PathBuf;
use wire::Payload;

const EXAMPLES: &str = "\
Examples:
    softtwin grasp --scene config/scenes/gripper.toml --pressure-mpa 0.079
  Another object, for a script:
    softtwin grasp --scene config/scenes/gripper.toml --pressure-mpa 0.05 \\
      --friction 0.3 --mass-g 30 --json

The object is held when n mu F >= s m g, with the smallest of the n finger forces as F. A running twin publishes the same \
as softtwin/<scene>/grasp.";

/// Show whether a gripper holds its object at a pressure, and from which pressure on it does.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES)]
pub struct Args {
    /// Scene file with a [grasp].
    #[arg(long, value_name = "FILE")]
    scene: PathBuf,
    /// Pressure of all fingers in MPa.
    #[arg(long, value_name = "MPA", value_parser = crate::range::pressure_mpa, help_heading = "State")]
    pressure_mpa: f64,
    /// Gap of all fingers in mm, where neither scene nor model fixes it.
    #[arg(long, value_name = "MM", value_parser = crate::range::gap_mm, help_heading = "State")]
    gap_mm: Option<f64>,
    /// Mass of the object in g instead of the scene's.
    #[arg(long, value_name = "G", value_parser = crate::range::number(0.0, 1e9))]
    mass_g: Option<f64>,
    /// Friction coefficient instead of the scene's.
    #[arg(long, value_name = "MU", value_parser = crate::range::number(0.0, 100.0))]
    friction: Option<f64>,
    /// One JSON object.
    #[arg(long, help_heading = "Output")]
    json: bool,
}

impl Args {
    /// Evaluates the grasp and prints it.
    pub fn run(self) -> anyhow::Result<()> {
        let mut scene = Scene::load(&self.scene).map_err(configuration)?;
        let Some(spec) = &mut scene.grasp else {
            return Err(usage(format!("--scene: {} has no [grasp]", self.scene.display())));
        };
        spec.mass_g = self.mass_g.unwrap_or(spec.mass_g);
        spec.friction = self.friction.unwrap_or(spec.friction);
        if let Some(problem) = scene.problems().first() {
            return Err(usage(problem));
        }
        let Some(mut model) = GraspModel::load(&scene, &self.scene).map_err(configuration)? else {
            return Err(usage("--scene: it has no [grasp]"));
        };
        let grasp = model.at(self.pressure_mpa, self.gap_mm.unwrap_or(f64::NAN));
        report::print(&Json::new(grasp.view()), self.json)
    }
}
