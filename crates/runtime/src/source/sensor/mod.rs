//! Devices: sources that send a reading when they have one.
//!
//! Each runs in a thread of its own (Tokio for the waiting, one thread, no pool) and hands readings to the bridge through
//! a bounded queue. A device that fails sends nothing: the twin notices the silence by its deadline. What went wrong is
//! counted in [`super::SensorCounters`] and logged when it changes, not each time.

mod device;
mod filter;
mod lines;
mod modbus;
mod register;
mod serial;
mod stream;

pub use filter::{Filter, FilterSpec};
pub use lines::{LineBuffer, LineError, MAX_LINE_BYTES, parse_line};
pub use modbus::ModbusSpec;
pub use register::{Encoding, Quantity, RegisterSpec, Table, WordOrder};
pub use serial::{Parity, SerialSpec};
pub use stream::LinesSpec;
