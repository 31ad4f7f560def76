//! One reading.

use super::payload::payload;

/// Most markers of one actuator.
pub const MARKERS_MAX: usize = 8;

payload! {
    /// One reading of the sensors of one actuator, stamped by the bridge.
    SensorSample "softtwin.Sensor" 256 {
        /// The run of the bridge that sent it.
        0 boot_id: u64 = 0, "", Show::Hex;
        /// Counts up by one per reading within a run, beginning at 1.
        8 seq: u64 = 0, "";
        /// When the reading was taken.
        16 t_sensor_ns: u64 = 0, "ns";
        /// Gauge pressure in the chambers.
        24 pressure_mpa: f64 = f64::NAN, "MPa";
        /// Distance from the underside of the undeformed base to the plate.
        32 gap_mm: f64 = f64::NAN, "mm";
        /// Measured contact force; NaN without a load cell.
        40 measured_force_n: f64 = f64::NAN, "N";
        /// Time in the source's own trace (replays); NaN when there is none.
        48 t_trace_s: f64 = f64::NAN, "s";
        /// 0: good; anything else is the sensor's own fault code.
        56 status: u32 = 0, "";
        /// Coordinates below: three for each marker of the scene, 0 without markers.
        60 marker_values: u32 = 0, "";
        /// Measured x, y, z of the first marker, of the second, ..., in the camera's frame; NaN where one was not seen.
        64 markers_mm: [f64; 3 * MARKERS_MAX] = [f64::NAN; 3 * MARKERS_MAX], "mm", Show::Counted("marker_values");
    }
    json [seq, t_sensor_ns, pressure_mpa, gap_mm, measured_force_n, markers_mm, t_trace_s, status, boot_id]
}
