//! The table `[ros2]` of the configuration.

use runtime::file::named_in;
use runtime::known_model::KnownModel;
use serde::Deserialize;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The table as written in the file.
#[derive(Debug, Clone, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Ros2File {
    domain_id: u32,
    node: String,
    models: Vec<PathBuf>,
    marker_full_scale_mpa: f64,
}

impl Default for Ros2File {
    fn default() -> Self {
        Self { domain_id: 0, node: "softtwin".into(), models: Vec::new(), marker_full_scale_mpa: 0.5 }
    }
}

/// The node of ROS 2, checked.
#[derive(Debug, Clone)]
pub struct Ros2 {
    /// `ROS_DOMAIN_ID` of the node.
    pub domain_id: u32,
    /// Name of the node.
    pub node: String,
    /// Known models: surfaces and inputs.
    pub models: Arc<[KnownModel]>,
    /// Von Mises stress at the end of the markers' colour scale, MPa.
    pub marker_full_scale_mpa: f64,
}

/// Checks the table of the configuration file `config` and reads its models; adds errors to `problems`.
pub fn check_config(file: Ros2File, config: &Path, problems: &mut Vec<String>) -> Ros2 {
    let Ros2File { domain_id, node, models, marker_full_scale_mpa } = file;
    if domain_id > 232 {
        problems.push(format!("ros2.domain_id: expected 0 to 232, found {domain_id}"));
    }
    if !node.starts_with(|c: char| c.is_ascii_alphabetic()) || node != ros_name(&node) {
        problems.push(format!("ros2.node: expected a letter, then letters, digits, `_`, found {node:?}"));
    }
    if !(marker_full_scale_mpa > 0.0 && marker_full_scale_mpa.is_finite()) {
        problems.push(format!(
            "ros2.marker_full_scale_mpa: expected more than 0 MPa, found {marker_full_scale_mpa}"
        ));
    }
    let mut read = |path: PathBuf| {
        let path = named_in(config, path);
        let model = KnownModel::read(&path);
        model.map_err(|error| problems.push(format!("ros2.models: {error} ({})", path.display()))).ok()
    };
    let models = models.into_iter().filter_map(&mut read).collect();
    Ros2 { domain_id, node, models, marker_full_scale_mpa }
}

/// Name of an actuator or node set with `_` for every character that ROS does not allow.
pub fn ros_name(name: &str) -> String {
    name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect()
}
