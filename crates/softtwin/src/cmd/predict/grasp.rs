//! `softtwin predict SCENE.toml`: whether a gripper holds its object, and from which pressure on it does.

use crate::failure::{configuration, usage};
use crate::report;
use recording::message::Json;
use runtime::config::Scene;
use runtime::grasp::GraspModel;
use std::path::Path;
use wire::Payload;

/// The object of a scene with a `[grasp]`.
#[derive(clap::Args)]
#[command(next_help_heading = "Grasp")]
pub struct GraspArgs {
    /// Mass of the object in g instead of the scene's.
    #[arg(long, value_name = "G", value_parser = crate::range::number(0.0, 1e9))]
    mass_g: Option<f64>,
    /// Friction coefficient instead of the scene's.
    #[arg(long, value_name = "MU", value_parser = crate::range::number(0.0, 100.0))]
    friction: Option<f64>,
}

impl GraspArgs {
    /// Evaluates the grasp and prints it.
    pub fn run(self, path: &Path, pressure_mpa: f64, gap_mm: Option<f64>, json: bool) -> anyhow::Result<()> {
        let mut scene = Scene::load(path).map_err(configuration)?;
        let Some(spec) = &mut scene.grasp else {
            return Err(usage(format!("{}: expected a scene with [grasp], found none", path.display())));
        };
        spec.mass_g = self.mass_g.unwrap_or(spec.mass_g);
        spec.friction = self.friction.unwrap_or(spec.friction);
        if let Some(problem) = scene.problems().first() {
            return Err(usage(problem));
        }
        let Some(mut model) = GraspModel::load(&scene, path).map_err(configuration)? else {
            return Err(usage("expected a scene with [grasp], found none"));
        };
        let grasp = model.at(pressure_mpa, gap_mm.unwrap_or(f64::NAN));
        report::print(&Json::new(grasp.view()), json)
    }
}
