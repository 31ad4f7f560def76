//! What a controller wants of a pressure source.

use iceoryx2::prelude::ZeroCopySend;

/// One pressure command: controller to valve (or to a simulated plant).
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend)]
#[type_name("softtwin.Command.v2")]
#[repr(C)]
pub struct Command {
    /// The run of the controller that sent it, see [`crate::boot_id`].
    pub boot_id: u64,
    /// Counts up by one per command within a run, beginning at 1.
    pub seq: u64,
    /// Time stamp of the reading that the command answers, see [`crate::now_ns`]; 0: none.
    pub t_sensor_ns: u64,
    /// When it was sent.
    pub t_publish_ns: u64,
    /// Gauge pressure that is wanted, MPa.
    pub pressure_mpa: f64,
    /// Zero; room for later values.
    pub reserved: u64,
}

super::layout!(Command, 48, {
    boot_id: 0,
    seq: 8,
    t_sensor_ns: 16,
    t_publish_ns: 24,
    pressure_mpa: 32,
    reserved: 40,
});

/// A command with nothing known.
impl Default for Command {
    fn default() -> Self {
        Self { boot_id: 0, seq: 0, t_sensor_ns: 0, t_publish_ns: 0, pressure_mpa: f64::NAN, reserved: 0 }
    }
}
