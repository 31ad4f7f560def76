//! The sources of a bridge, opened at its start and on SIGHUP, which replaces those that changed in the scene.

use runtime::bridge::{BridgeDevices, Sources};
use runtime::config::{self, ActuatorSpec, ConfigError, Scene};
use runtime::service;
use runtime::source::Devices;
use runtime::thread_group::StopFlag;
use runtime::valve::ValveSpec;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::Sender;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Interval of checks of the flag.
const INTERVAL: Duration = Duration::from_millis(20);

/// The current devices of the bridge with their counters.
pub type SharedDevices = Arc<Mutex<BridgeDevices>>;

/// Opens all sources; another program publishes the readings of actuators without one.
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
    let has_nothing =
        sources.is_empty() && scene.actuators.iter().all(|actuator| actuator.all_valves().next().is_none());
    ConfigError::unless(path, if has_nothing { vec![none] } else { Vec::new() })?;
    Ok(sources)
}

/// Replaces sources on request.
pub struct BridgeReloader {
    pub scene: Scene,
    pub sources: Sender<Sources>,
    pub devices: SharedDevices,
    /// Open device paths: valves keep theirs, new sensors share them.
    pub paths: Devices,
}

impl BridgeReloader {
    /// Reads the scene again each time `requested` is set, until `end`. On any error the sources stay unchanged, and the error is
    /// logged.
    pub fn run(
        mut self,
        requested: &AtomicBool,
        end: &StopFlag,
        path: &Path,
        load: impl Fn() -> Result<Scene, ConfigError> + Clone + Send + 'static,
    ) {
        while !end.is_set() {
            if requested.swap(false, Ordering::Relaxed) {
                service::notify_reloading();
                let Some(loaded) = end.unless_set(load.clone()) else { return };
                match loaded
                    .map_err(|error| error.to_string())
                    .and_then(|scene| self.reload(scene, path, end))
                {
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

    /// Replaces changed sources; returns the names of their actuators.
    fn reload(&mut self, mut scene: Scene, path: &Path, end: &StopFlag) -> Result<Vec<String>, String> {
        let (running, new) = (shape(&self.scene), shape(&scene));
        if running != new {
            return Err(format!(
                "the scene has {new}, this bridge runs {running}; restart the bridge for that"
            ));
        }
        let mut valves = self.scene.actuators.iter().zip(&scene.actuators);
        if let Some((actuator, _)) =
            valves.find(|(old, new)| (&old.valve, &old.valves) != (&new.valve, &new.valves))
        {
            let name = &actuator.name;
            return Err(format!("the valve of `{name}` has other settings; restart the bridge for that"));
        }
        let whole = scene.clone();
        let has_changed: Vec<bool> = self.scene.actuators.iter().zip(&scene.actuators).map(differ).collect();
        if !has_changed.contains(&true) {
            return Ok(Vec::new());
        }
        for (actuator, has_changed) in scene.actuators.iter_mut().zip(has_changed) {
            // Sensors may share a device: all of them are reopened, or none.
            if !has_changed && actuator.sensors.is_empty() {
                actuator.source = None;
            }
        }
        let (path, paths) = (path.to_owned(), self.paths.clone());
        let opened = end.unless_set(move || open(&scene, &path, &paths)).ok_or("the bridge ends")?;
        let opened = opened.map_err(|error| error.to_string())?;
        let names: Vec<String> = opened.iter().map(|(name, _)| name.clone()).collect();
        let mut devices = self.devices.lock().unwrap_or_else(PoisonError::into_inner);
        devices.retain(|(name, ..)| !names.contains(name));
        for (name, source) in &opened {
            let of_source = source.devices().into_iter();
            devices.extend(of_source.map(|(sensor, counters)| (name.clone(), sensor, counters)));
        }
        drop(devices);
        // The loop takes them in its next iteration, unless it has ended.
        let _ended = self.sources.send(opened);
        self.scene = whole;
        Ok(names)
    }
}

/// True if an actuator has other sources.
fn differ((old, new): (&ActuatorSpec, &ActuatorSpec)) -> bool {
    (&old.source, &old.sensors, &old.pace) != (&new.source, &new.sensors, &new.pace)
}

/// The parts of a scene that a reload cannot change: actuators, which of them have readings, valves.
fn shape(scene: &Scene) -> String {
    let mut shape = String::new();
    for actuator in &scene.actuators {
        let readings =
            if actuator.source.is_some() || !actuator.sensors.is_empty() { "readings" } else { "none" };
        let valves = actuator.valve.iter().chain(actuator.valves.values());
        let valves: Vec<String> = valves.map(ValveSpec::describe).collect();
        let valves = if valves.is_empty() { "no valve".to_owned() } else { valves.join(", ") };
        shape += &format!("`{}` ({readings}, {valves}) ", actuator.name);
    }
    shape.trim_end().to_owned()
}
