//! SIGHUP of a bridge: reads its scene again and replaces the sources that have changed, while the others go on.

use crate::sources::{SharedDevices, open};
use runtime::bridge::Sources;
use runtime::config::{ActuatorSpec, ConfigError, Scene};
use runtime::service;
use runtime::source::Devices;
use runtime::thread_group::StopFlag;
use runtime::valve::ValveSpec;
use std::path::Path;
use std::sync::PoisonError;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::Sender;
use std::time::Duration;

/// How often the flag is checked.
const INTERVAL: Duration = Duration::from_millis(20);

/// Replaces sources on request.
pub struct BridgeReloader {
    pub scene: Scene,
    pub sources: Sender<Sources>,
    pub devices: SharedDevices,
    /// Device paths that run: a valve keeps its own, and new sensors on it join.
    pub paths: Devices,
}

impl BridgeReloader {
    /// Reads the scene again each time `requested` is set, until `end`. On any error the sources stay as they are, and the log
    /// says why.
    pub fn run(
        mut self,
        requested: &AtomicBool,
        end: &StopFlag,
        path: &Path,
        load: impl Fn() -> Result<Scene, ConfigError>,
    ) {
        while !end.is_set() {
            if requested.swap(false, Ordering::Relaxed) {
                service::notify_reloading();
                match load().map_err(|error| error.to_string()).and_then(|scene| self.reload(scene, path)) {
                    Ok(replaced) if replaced.is_empty() => {
                        tracing::info!("reloaded: no source has changed");
                    }
                    Ok(replaced) => tracing::info!("reloaded: sources of {} replaced", replaced.join(", ")),
                    Err(cause) => tracing::error!("reload refused, the old sources stay: {cause}"),
                }
                service::notify_reloaded();
            }
            end.pause(INTERVAL);
        }
    }

    /// Returns the actuators whose source was replaced.
    fn reload(&mut self, mut scene: Scene, path: &Path) -> Result<Vec<String>, String> {
        let (running, new) = (shape(&self.scene), shape(&scene));
        if running != new {
            return Err(format!(
                "the scene has {new}, this bridge runs {running}; restart the bridge for that"
            ));
        }
        let mut valves = self.scene.actuators.iter().zip(&scene.actuators);
        if let Some((actuator, _)) = valves.find(|(old, new)| old.valve != new.valve) {
            let name = &actuator.name;
            return Err(format!("the valve of `{name}` has other settings; restart the bridge for that"));
        }
        let whole = scene.clone();
        let has_changed: Vec<bool> = self.scene.actuators.iter().zip(&scene.actuators).map(differ).collect();
        if !has_changed.contains(&true) {
            return Ok(Vec::new());
        }
        for (actuator, has_changed) in scene.actuators.iter_mut().zip(has_changed) {
            // Sensors may share a device: either all of them are opened again, or none.
            if !has_changed && actuator.sensors.is_empty() {
                actuator.source = None;
            }
        }
        let opened = open(&scene, path, &self.paths).map_err(|error| error.to_string())?;
        let names: Vec<String> = opened.iter().map(|(name, _)| name.clone()).collect();
        let mut devices = self.devices.lock().unwrap_or_else(PoisonError::into_inner);
        devices.retain(|(name, ..)| !names.contains(name));
        for (name, source) in &opened {
            let of_source = source.devices().into_iter();
            devices.extend(of_source.map(|(sensor, counters)| (name.clone(), sensor, counters)));
        }
        drop(devices);
        // The loop takes them within a turn, unless it has ended meanwhile.
        let _ended = self.sources.send(opened);
        self.scene = whole;
        Ok(names)
    }
}

/// Whether an actuator's readings come from elsewhere now.
fn differ((old, new): (&ActuatorSpec, &ActuatorSpec)) -> bool {
    (&old.source, &old.sensors, &old.pace) != (&new.source, &new.sensors, &new.pace)
}

/// What cannot change while a bridge runs: the actuators, which of them have readings, and the valves.
fn shape(scene: &Scene) -> String {
    let mut shape = String::new();
    for actuator in &scene.actuators {
        let readings =
            if actuator.source.is_some() || !actuator.sensors.is_empty() { "readings" } else { "none" };
        let valve = actuator.valve.as_ref().map_or("no valve".to_owned(), ValveSpec::describe);
        shape += &format!("`{}` ({readings}, {valve}) ", actuator.name);
    }
    shape.trim_end().to_owned()
}
