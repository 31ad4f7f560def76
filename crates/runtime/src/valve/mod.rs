//! Valves: from the setpoint of one owner to a device, with time-out, limits, interlocks and the operator's override
//! ([docs/control.md](../../../../docs/control.md)). Each valve has its own thread; the bridge's loop is not involved.

mod decide;
mod device;
mod drive;
mod spec;

pub use drive::{OpenValve, ValveCounters, ValveError, Valves, open, start};
pub use spec::{IioValve, LinesValve, ModbusValve, ValveSpec, WatchdogSpec};
