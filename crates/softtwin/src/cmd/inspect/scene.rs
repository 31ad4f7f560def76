//! `softtwin inspect SCENE.toml`: what a scene will load, how many bytes, and how long a sample takes, measured here and now.

use crate::failure::configuration;
use crate::report;
use runtime::config::Scene;
use runtime::explain::{Explained, explain};
use runtime::load::load_scene;
use std::path::Path;

/// Prints what each actuator of a scene loads and costs.
pub fn explain_scene(path: &Path, json: bool) -> anyhow::Result<()> {
    let scene = Scene::load(path).map_err(configuration)?;
    let loaded = load_scene(&scene, path).map_err(configuration)?;
    let explained: Vec<Explained> = loaded.iter().map(explain).collect();
    report::print(&explained, json)
}
