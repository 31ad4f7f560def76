//! What an owner wants of a real pressure source, and for how long.

use super::payload::payload;

payload! {
    /// One setpoint. Hold-to-run: it counts until `valid_for_ns` after `t_publish_ns`; without a newer one the valve then takes its
    /// safe value. On the topic `override` it is the operator's and wins over the setpoint's until it is released.
    Setpoint "softtwin.Setpoint" 96 {
        /// The run of the owner that sent it.
        0 boot_id: u64 = 0, "", Show::Hex;
        /// Counts up by one per setpoint within a run, beginning at 1.
        8 seq: u64 = 0, "";
        /// When the reading that it answers was taken; 0: it answers none.
        16 t_sensor_ns: u64 = 0, "ns";
        /// When it was sent.
        24 t_publish_ns: u64 = 0, "ns";
        /// How long it counts from then on. Of an override 0: until it is released.
        32 valid_for_ns: u64 = 0, "ns";
        /// Gauge pressure that is wanted; NaN: none. Of an override NaN: released.
        40 pressure_mpa: f64 = f64::NAN, "MPa";
        /// Name of the owner, zero-padded.
        48 owner: [u8; 32] = [0; 32], "", Show::Name;
        /// Zero; for later values.
        80 reserved: [u64; 2] = [0; 2], "";
    }
    json [seq, t_sensor_ns, t_publish_ns, valid_for_ns, pressure_mpa, owner, boot_id]
}
