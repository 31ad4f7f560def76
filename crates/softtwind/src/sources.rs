//! The sources of a bridge, from its scene.

use runtime::bridge::{BridgeDevices, Sources};
use runtime::config::{self, ActuatorSpec, ConfigError, Scene};
use runtime::source::Devices;
use std::path::Path;
use std::sync::{Arc, Mutex};

/// The devices of the bridge with their counters; others after a reload.
pub type SharedDevices = Arc<Mutex<BridgeDevices>>;

/// Opens all sources; actuators without one are fed by another program.
pub fn open(scene: &Scene, path: &Path, devices: &Devices) -> Result<Sources, ConfigError> {
    let open = |actuator: &ActuatorSpec| {
        let opened = actuator.open_source(&scene.folder, devices)?;
        Some(opened.map(|source| (actuator.name.clone(), source)))
    };
    let opened =
        scene.actuators.iter().filter_map(|actuator| Some((actuator.name.as_str(), open(actuator)?)));
    let sources = config::collect(path, opened)?;
    let none =
        "no actuator has a source or a valve; add [actuator.source], [actuator.sensors.NAME] or [actuator.valve], or use --trace"
            .to_owned();
    let has_nothing = sources.is_empty() && scene.actuators.iter().all(|actuator| actuator.valve.is_none());
    ConfigError::unless(path, if has_nothing { vec![none] } else { Vec::new() })?;
    Ok(sources)
}
