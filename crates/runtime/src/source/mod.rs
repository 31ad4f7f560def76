//! Sources of readings: traces, formulas, devices.
//!
//! A device path (an address, a serial port, a program) has a thread (`devices.rs`; Tokio for the waiting, one thread, no pool).
//! Each sensor sends its answers to the bridge through a bounded queue (`sensor.rs`); `mixed.rs` combines the newest values of
//! all sensors into readings. The values of a device that fails grow old, or the twin notices the silence by its deadline.
//! Failures are counted in [`SensorCounters`] and logged when they change.

mod devices;
mod lines;
mod log_limit;
mod mixed;
mod modbus;
mod plugin;
mod reading;
mod recorded;
mod replay;
mod sensor;
mod serial;
mod simulate;
mod spec;
mod stream;
mod trace;

pub use devices::Devices;
pub use lines::{Cells, LineBuffer, LineError, MAX_LINE_BYTES, parse_cells};
pub use modbus::{ByteOrder, Encoding, ModbusConnection, RegisterAt, Table};
pub(crate) use reading::value_mut;
pub use reading::{BridgeWaker, InputNames, Poll, Reading, SensorCounters, Source, SourceReader};
pub use recorded::TraceError;
pub use replay::ReplaySpec;
pub use sensor::{Filter, FilterSpec, SensorQuantity, ValueSpec, Values};
pub use serial::{ModbusPath, Parity, SerialSpec};
pub use simulate::{Profile, SimulateSpec};
pub use spec::{LinesSensor, ModbusSensor, PaceSpec, SensorSpec, Sensors, open as open_sensors};
pub use stream::Cell;
pub use trace::SensorTrace;
pub use trace::in_another_unit;

use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// A source as written in a scene file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum SourceSpec {
    Replay(ReplaySpec),
    /// A formula.
    Simulate(SimulateSpec),
}

impl SourceSpec {
    /// Opens the source. Relative paths are taken from `folder` (the scene file's). `inputs`: names of the measured inputs of its
    /// readings.
    ///
    /// # Errors
    /// Every problem of the specification and of the trace it names; a formula with `inputs`.
    pub fn open(&self, folder: &Path, inputs: &InputNames) -> Result<Box<dyn Source>, Vec<String>> {
        match (self, inputs.iter().next()) {
            (Self::Replay(spec), _) => spec.open(folder, inputs),
            (Self::Simulate(spec), None) => spec.open(),
            (Self::Simulate(_), Some(name)) => Err(vec![format!(
                "source: expected one that can have {name}, which `inputs` says is measured: [actuator.sensors.NAME] or a \
                 trace; found {}",
                self.describe()
            )]),
        }
    }

    /// The source in words, for logs.
    pub fn describe(&self) -> String {
        match self {
            Self::Replay(spec) => {
                format!("the trace {} at {} times its speed", spec.trace.display(), spec.speed)
            }
            Self::Simulate(spec) => format!("a formula, {} readings a second", spec.rate_hz),
        }
    }

    /// Source that replays `trace` at its recorded rate.
    pub fn replay_of(trace: PathBuf) -> Self {
        Self::Replay(ReplaySpec { trace, ..ReplaySpec::default() })
    }
}
