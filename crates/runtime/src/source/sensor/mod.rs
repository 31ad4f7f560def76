//! Devices: sensors that say something when they have it.
//!
//! A device path (an address, a serial port, a program) has a thread of its own (Tokio for the waiting, one thread, no pool);
//! each sensor hands what it has measured to the bridge through a bounded queue, and `mixed` makes readings of it. A device
//! that fails says nothing: its values grow old, or the twin notices the silence by its deadline. What went wrong is counted
//! in [`super::SensorCounters`] and logged when it changes, not each time.

mod calibration;
mod can;
mod devices;
mod feed;
mod filter;
mod iio;
mod lines;
mod mixed;
mod modbus;
mod plugin;
mod register;
mod serial;
mod single_lines;
mod single_modbus;
mod spec;
mod stream;

pub use calibration::{ValueSpec, Values};
pub use can::{ByteOrder, CanNumber, CanSignal};
pub use devices::Devices;
pub use filter::{Filter, FilterSpec};
pub use lines::{LineBuffer, LineError, MAX_LINE_BYTES, parse_line};
pub use modbus::{ModbusConnection, ModbusPath};
pub use register::{Encoding, Quantity, RegisterAt, RegisterSpec, Table, WordOrder};
pub use serial::{Parity, SerialSpec};
pub use single_lines::LinesSpec;
pub use single_modbus::ModbusSpec;
pub use spec::{CanSensor, IioSensor, LinesSensor, ModbusSensor, PaceSpec, SensorSpec, Sensors, open};
pub use stream::Cell;
