//! Where readings come from. One file a source, one variant of [`SourceSpec`]; a conformance test runs over all of them.

mod named;
mod reading;
mod recorded;
mod replay;
mod replay_rows;
mod sensor;
mod simulate;
mod trace;
mod trace_error;
mod value;

pub use named::InputNames;
pub use reading::{BridgeWaker, Poll, Reading, SensorCounters, Source, SourceReader};
pub use replay::ReplaySpec;
pub use sensor::{
    ByteOrder, CanNumber, CanSensor, CanSignal, Cell, Devices, Encoding, Filter, FilterSpec, IioSensor,
    LineBuffer, LineError, LinesSensor, LinesSpec, MAX_LINE_BYTES, ModbusConnection, ModbusPath,
    ModbusSensor, ModbusSpec, PaceSpec, Parity, Quantity, RegisterAt, RegisterSpec, SensorSpec, Sensors,
    SerialSpec, Table, ValueSpec, Values, WordOrder, open as open_sensors, parse_line,
};
pub use simulate::{Profile, SimulateSpec};
pub use trace::Trace;
pub use trace_error::TraceError;
pub(crate) use value::{FORCE, QUANTITIES};

use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// A source as written in a scene file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum SourceSpec {
    /// A recorded trace.
    Replay(ReplaySpec),
    /// A formula.
    Simulate(SimulateSpec),
    /// Modbus sensors, over TCP or a serial line.
    Modbus(ModbusSpec),
    /// Lines of text, from a serial line or standard input.
    Lines(LinesSpec),
}

impl SourceSpec {
    /// Opens the source. Relative paths are taken from `folder` (the scene file's).
    ///
    /// # Errors
    /// Every problem of the specification and of the trace it names, as text for the user.
    pub fn open(&self, folder: &Path) -> Result<Box<dyn Source>, Vec<String>> {
        self.open_among(folder, &Devices::default(), &InputNames::default())
    }

    /// The same, sharing device paths with the other sources of a scene. `inputs`: what its readings are to carry beside
    /// pressure, gap, force and markers.
    ///
    /// # Errors
    /// As [`Self::open`]; also a path that another source uses otherwise, and a source that has no such inputs.
    pub fn open_among(
        &self,
        folder: &Path,
        devices: &Devices,
        inputs: &InputNames,
    ) -> Result<Box<dyn Source>, Vec<String>> {
        let plain = || match inputs.iter().next() {
            None => Ok(()),
            Some(name) => Err(vec![format!(
                "source: expected one that can have {name}, which `inputs` says is measured: [actuator.sensors.NAME] or a \
                 trace; found {}",
                self.describe()
            )]),
        };
        match self {
            Self::Replay(spec) => spec.open(folder, inputs),
            Self::Simulate(spec) => plain().and_then(|()| spec.open()),
            Self::Modbus(spec) => plain().and_then(|()| spec.open(devices)),
            Self::Lines(spec) => plain().and_then(|()| spec.open(devices)),
        }
    }

    /// The source in words, for logs.
    pub fn describe(&self) -> String {
        let port = |serial: &Option<SerialSpec>, without: &str| {
            serial.as_ref().map_or_else(|| without.to_owned(), |serial| serial.port.display().to_string())
        };
        match self {
            Self::Replay(spec) => {
                format!("the trace {} at {} times its speed", spec.trace.display(), spec.speed)
            }
            Self::Simulate(spec) => format!("a formula, {} readings a second", spec.rate_hz),
            Self::Modbus(spec) => {
                let place = spec.tcp.clone().unwrap_or_else(|| port(&spec.serial, "no port"));
                format!("Modbus at {place}, {} polls a second", spec.poll_hz)
            }
            Self::Lines(spec) => format!("lines of text from {}", port(&spec.serial, "standard input")),
        }
    }

    /// The source that replays `trace` as it was recorded.
    pub fn replay_of(trace: PathBuf) -> Self {
        Self::Replay(ReplaySpec { trace, ..ReplaySpec::default() })
    }
}
