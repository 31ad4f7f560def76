//! What a controller wants of a pressure source.

use super::payload::payload;

payload! {
    /// One pressure command, from a controller to a valve or a simulated plant.
    Command "softtwin.Command" 48 {
        /// The run of the controller that sent it.
        0 boot_id: u64 = 0, "", Show::Hex;
        /// Counts up by one per command within a run, beginning at 1.
        8 seq: u64 = 0, "";
        /// When the reading that the command answers was taken; 0: it answers none.
        16 t_sensor_ns: u64 = 0, "ns";
        /// When it was sent.
        24 t_publish_ns: u64 = 0, "ns";
        /// Gauge pressure that is wanted.
        32 pressure_mpa: f64 = f64::NAN, "MPa";
        /// Zero; for later values.
        40 reserved: u64 = 0, "";
    }
    json [seq, t_sensor_ns, t_publish_ns, pressure_mpa, boot_id]
}
