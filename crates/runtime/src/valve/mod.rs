//! Valves: from the setpoint of one owner to a device, with time-out, limits, interlocks and the operator's override
//! ([docs/control.md](../../../../docs/control.md)). Each valve has a thread of its own; the bridge's loop knows nothing of it.

mod decide;
mod device;
mod drive;
mod spec;

pub use drive::{OpenValve, ValveCounters, ValveError, Valves, open, start};
pub use spec::{IioValve, LinesValve, ModbusValve, ValveSpec, WatchdogSpec};
