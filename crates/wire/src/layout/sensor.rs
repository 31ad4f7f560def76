//! One reading.

use iceoryx2::prelude::ZeroCopySend;

/// One reading of the sensors of one actuator, as stamped by the bridge.
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend)]
#[type_name("softtwin.SensorSample.v2")]
#[repr(C)]
pub struct SensorSample {
    /// The run of the bridge that sent it, see [`crate::boot_id`].
    pub boot_id: u64,
    /// Counts up by one per reading within a run, beginning at 1.
    pub seq: u64,
    /// When the reading was taken, see [`crate::now_ns`].
    pub t_sensor_ns: u64,
    /// Gauge pressure in the chambers, MPa.
    pub pressure_mpa: f64,
    /// Distance from the underside of the undeformed base to the plate, mm.
    pub gap_mm: f64,
    /// Measured contact force, N; NaN when there is no load cell.
    pub measured_force_n: f64,
    /// Time in the source's own trace, s (for replays); NaN when there is none.
    pub t_trace_s: f64,
    /// 0: good; anything else is the sensor's own fault code.
    pub status: u32,
    /// Zero.
    pub reserved: u32,
}

super::layout!(SensorSample, 64, {
    boot_id: 0,
    seq: 8,
    t_sensor_ns: 16,
    pressure_mpa: 24,
    gap_mm: 32,
    measured_force_n: 40,
    t_trace_s: 48,
    status: 56,
    reserved: 60,
});

/// A sample with nothing known.
impl Default for SensorSample {
    fn default() -> Self {
        Self {
            boot_id: 0,
            seq: 0,
            t_sensor_ns: 0,
            pressure_mpa: f64::NAN,
            gap_mm: f64::NAN,
            measured_force_n: f64::NAN,
            t_trace_s: f64::NAN,
            status: 0,
            reserved: 0,
        }
    }
}
