//! What a valve is told, and why.

use super::payload::payload;
use super::{valve_interlock, valve_limit, valve_reason};

payload! {
    /// What the bridge has written to the valve of an actuator, one for each write or attempt.
    Valve "softtwin.Valve" 176 {
        /// The run of the bridge.
        0 boot_id: u64 = 0, "", Show::Hex;
        /// Counts up by one per sample within a run, beginning at 1.
        8 seq: u64 = 0, "";
        /// When the reading was taken that the setpoint answers; 0: it answers none.
        16 t_sensor_ns: u64 = 0, "ns";
        /// When this was sent, after the write.
        24 t_publish_ns: u64 = 0, "ns";
        /// When the device last confirmed a write; 0: never.
        32 t_written_ns: u64 = 0, "ns";
        /// Gauge pressure that was written, or was to be written where the device failed.
        40 pressure_mpa: f64 = f64::NAN, "MPa";
        /// Gauge pressure that the setpoint (or the override) wants; NaN: there is none.
        48 wanted_mpa: f64 = f64::NAN, "MPa";
        /// Safe value.
        56 safe_mpa: f64 = f64::NAN, "MPa";
        /// Why this value.
        64 valve_reason: u32 = valve_reason::NO_SETPOINT, "", Show::Code(valve_reason::ALL);
        /// What holds the valve at its safe value, bits.
        68 valve_interlock: u32 = 0, "", Show::Flags(valve_interlock::ALL);
        /// What the written value was limited by, bits.
        72 valve_limit: u32 = 0, "", Show::Flags(valve_limit::ALL);
        /// Zero.
        76 reserved: u32 = 0, "";
        /// The run of the setpoint's (or the override's) owner.
        80 setpoint_boot_id: u64 = 0, "", Show::Hex;
        /// Sequence number of that setpoint.
        88 setpoint_seq: u64 = 0, "";
        /// Name of its owner, zero-padded.
        96 owner: [u8; 32] = [0; 32], "", Show::Name;
        /// Writes that the device has confirmed since the start.
        128 writes: u64 = 0, "";
        /// Writes that have failed since the start.
        136 failures: u64 = 0, "";
        /// Times that the setpoint was not renewed in its time.
        144 timeouts: u64 = 0, "";
        /// Times that an interlock has closed.
        152 interlocks: u64 = 0, "";
        /// Zero; for later values.
        160 reserved_more: [u64; 2] = [0; 2], "";
    }
    json [
        seq, t_sensor_ns, t_publish_ns, t_written_ns, pressure_mpa, wanted_mpa, safe_mpa, valve_reason, valve_interlock,
        valve_limit, owner, setpoint_seq, setpoint_boot_id, writes, failures, timeouts, interlocks, boot_id,
    ]
}
