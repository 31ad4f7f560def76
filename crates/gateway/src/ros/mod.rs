//! The twins as a node of ROS 2, on the wire of `rmw_zenoh` (docs/ros2.md): tokens make node and topics appear in the graph, keys hold
//! type and hash, messages are CDR with an attachment of number, time and sender.

mod message;
mod services;
mod topics;
mod wire_format;

use crate::link::Link;
use runtime::file::named_in;
use runtime::known_model::KnownModel;
use serde::Deserialize;
use services::{Call, Services};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::SyncSender;
use std::thread;
use std::time::{Duration, Instant};
use topics::Outlets;
use wire::{Bus, KeyExpr};
use wire_format::{Names, ros_name, token};

pub use services::{channel as calls, run as answer_calls};
pub use topics::{announce_readings, reading, run_commands};

/// Interval of scans of the local topics and of checks for subscribers.
const SCAN: Duration = Duration::from_millis(250);
/// Longest sleep while a topic is read.
const PACE: Duration = Duration::from_millis(2);
/// Longest sleep otherwise.
const TICK: Duration = Duration::from_millis(50);

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

/// Publishes samples until the gateway ends, fields at most every `period`, and announces the services of the twins, whose requests go to
/// `calls`.
pub fn run(
    link: &Link,
    ros: &Ros2,
    keys: &[KeyExpr],
    period: Duration,
    calls: SyncSender<Call>,
) -> anyhow::Result<()> {
    let bus = Bus::open(&link.domain)?;
    let names = Names::new(ros, link);
    let _node = token(link, names.node())?;
    let offset_ns = recording::wall_offset_ns();
    let (mut outlets, mut services) = (Outlets::default(), Services::new(calls));
    let mut scan_at = Instant::now();
    while link.is_running() {
        let now = Instant::now();
        if now >= scan_at {
            scan_at = now + SCAN;
            let mut found = Vec::new();
            for key in keys {
                found.extend(bus.topics(key)?);
            }
            outlets.announce(link, &names, ros, &found)?;
            outlets.adjust(&bus);
            services.announce(link, &names, &found)?;
        }
        outlets.pump(offset_ns, now, period);
        thread::sleep(if outlets.is_read() { PACE } else { TICK });
    }
    Ok(())
}

/// Messages written by `rosbags`, as hexadecimal digits.
#[cfg(test)]
#[path = "../../tests/unit/golden.rs"]
mod golden;
