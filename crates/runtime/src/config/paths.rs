//! Path-valued keys of a scene. Each is resolved against the folder of the scene file, once, when the file is read.

use super::{ActuatorSpec, Scene};
use crate::source::{SensorSpec, SerialSpec, SourceSpec};
use formats::file::named_in;
use std::io;
use std::path::{Path, PathBuf};

impl Scene {
    /// Makes every path of the scene in `file` absolute, and finds its folder.
    ///
    /// # Errors
    /// The current folder is not accessible.
    pub(super) fn resolve_paths(&mut self, file: &Path) -> io::Result<()> {
        let file = std::path::absolute(file)?;
        self.folder = named_in(&file, "");
        for actuator in &mut self.actuators {
            for path in actuator.paths_mut().into_iter().filter(|path| !path.as_os_str().is_empty()) {
                *path = named_in(&file, &*path);
            }
            // A program without a slash is found by PATH.
            for program in actuator.programs_mut().filter(|program| program.contains('/')) {
                *program = named_in(&file, &*program).to_string_lossy().into_owned();
            }
        }
        Ok(())
    }
}

impl ActuatorSpec {
    fn paths_mut(&mut self) -> Vec<&mut PathBuf> {
        let mut paths = vec![&mut self.model];
        if let Some(SourceSpec::Replay(replay)) = &mut self.source {
            paths.push(&mut replay.trace);
            paths.extend(&mut replay.log);
        }
        let mut lines: Vec<&mut Option<SerialSpec>> = Vec::new();
        for sensor in self.sensors.values_mut() {
            lines.push(match sensor {
                SensorSpec::Modbus(sensor) => &mut sensor.serial,
                SensorSpec::Lines(sensor) => &mut sensor.serial,
            });
        }
        for valve in self.valve.iter_mut().chain(self.valves.values_mut()) {
            lines.extend(valve.modbus.as_mut().map(|valve| &mut valve.serial));
            lines.extend(valve.lines.as_mut().map(|valve| &mut valve.serial));
            paths.extend(valve.iio.as_mut().map(|valve| &mut valve.root));
        }
        paths.extend(lines.into_iter().flatten().map(|serial| &mut serial.port));
        paths
    }

    /// Names of the programs that its sensors read from.
    fn programs_mut(&mut self) -> impl Iterator<Item = &mut String> {
        self.sensors.values_mut().filter_map(|sensor| match sensor {
            SensorSpec::Lines(sensor) => sensor.command.as_mut()?.first_mut(),
            SensorSpec::Modbus(_) => None,
        })
    }
}

#[cfg(test)]
#[path = "../../tests/unit/config_paths.rs"]
mod tests;
