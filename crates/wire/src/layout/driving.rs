//! Pressures that are wanted and written: commands, setpoints, valves.

use super::payload::payload;
use super::{target_kind, valve_interlock, valve_limit, valve_reason};

/// Most values of one target.
pub const TARGET_VALUES_MAX: usize = 64;

payload! {
    /// One pressure command, from a controller to a valve or a simulated plant.
    Command "softtwin.Command" {
        /// The run of the controller that sent it.
        boot_id: u64 = 0, "", Show::Hex;
        /// Counts up by one per command within a run, beginning at 1.
        seq: u64 = 0, "";
        /// When the reading that the command answers was taken; 0: it answers none.
        t_sensor_ns: u64 = 0, "ns";
        /// When it was sent.
        t_publish_ns: u64 = 0, "ns";
        /// Gauge pressure that is wanted.
        pressure_mpa: f64 = f64::NAN, "MPa";
    }
    json [seq, t_sensor_ns, t_publish_ns, pressure_mpa, boot_id]
}

payload! {
    /// One setpoint. Hold-to-run: it counts until `valid_for_ns` after `t_publish_ns`; without a newer one the valve then takes its
    /// safe value. On the topic `override` it is the operator's and wins over the setpoint's until it is released.
    Setpoint "softtwin.Setpoint" {
        /// The run of the owner that sent it.
        boot_id: u64 = 0, "", Show::Hex;
        /// Counts up by one per setpoint within a run, beginning at 1.
        seq: u64 = 0, "";
        /// When the reading that it answers was taken; 0: it answers none.
        t_sensor_ns: u64 = 0, "ns";
        /// When it was sent.
        t_publish_ns: u64 = 0, "ns";
        /// How long it counts from then on. Of an override 0: until it is released.
        valid_for_ns: u64 = 0, "ns";
        /// Gauge pressure that is wanted; NaN: none. Of an override NaN: released.
        pressure_mpa: f64 = f64::NAN, "MPa";
        /// Name of the owner, zero-padded.
        owner: [u8; 32] = [0; 32], "", Show::Name;
    }
    json [seq, t_sensor_ns, t_publish_ns, valid_for_ns, pressure_mpa, owner, boot_id]
}

payload! {
    /// Target of the program that holds a quantity of an actuator; its values have the unit of that quantity. It counts until the next one.
    Target "softtwin.Target" {
        /// The run of the owner that sent it.
        boot_id: u64 = 0, "", Show::Hex;
        /// Counts up by one per target within a run, beginning at 1.
        seq: u64 = 0, "";
        /// When it was sent.
        t_publish_ns: u64 = 0, "ns";
        /// How the values are reached.
        target_kind: u32 = target_kind::STEP, "", Show::Code(target_kind::ALL);
        /// Values below: one of a step or a ramp.
        value_count: u32 = 0, "";
        /// Speed of a ramp in units per second, more than 0.
        rate_per_s: f64 = f64::NAN, "1/s";
        /// Time between the values of a series, more than 0.
        interval_s: f64 = f64::NAN, "s";
        /// The values.
        values: [f64; TARGET_VALUES_MAX] = [f64::NAN; TARGET_VALUES_MAX], "", Show::Counted("value_count");
        /// Name of the owner, zero-padded.
        owner: [u8; 32] = [0; 32], "", Show::Name;
    }
    json [seq, t_publish_ns, target_kind, rate_per_s, interval_s, values, owner, boot_id]
}

payload! {
    /// Value written by the bridge to the valve of an actuator, one per write or attempt.
    Valve "softtwin.Valve" {
        /// The run of the bridge.
        boot_id: u64 = 0, "", Show::Hex;
        /// Counts up by one per sample within a run, beginning at 1.
        seq: u64 = 0, "";
        /// When the reading was taken that the setpoint answers; 0: it answers none.
        t_sensor_ns: u64 = 0, "ns";
        /// When this was sent, after the write.
        t_publish_ns: u64 = 0, "ns";
        /// When the device last confirmed a write; 0: never.
        t_written_ns: u64 = 0, "ns";
        /// Gauge pressure that was written, or was to be written where the device failed.
        pressure_mpa: f64 = f64::NAN, "MPa";
        /// Gauge pressure that the setpoint (or the override) wants; NaN: there is none.
        wanted_mpa: f64 = f64::NAN, "MPa";
        /// Safe value.
        safe_mpa: f64 = f64::NAN, "MPa";
        /// Why this value.
        valve_reason: u32 = valve_reason::NO_SETPOINT, "", Show::Code(valve_reason::ALL);
        /// Interlocks that hold the valve at its safe value, bits.
        valve_interlock: u32 = 0, "", Show::Flags(valve_interlock::ALL);
        /// Limits that changed the written value, bits.
        valve_limit: u32 = 0, "", Show::Flags(valve_limit::ALL);
        /// Zero.
        reserved: u32 = 0, "";
        /// The run of the setpoint's (or the override's) owner.
        setpoint_boot_id: u64 = 0, "", Show::Hex;
        /// Sequence number of that setpoint.
        setpoint_seq: u64 = 0, "";
        /// Name of its owner, zero-padded.
        owner: [u8; 32] = [0; 32], "", Show::Name;
        /// Writes that the device has confirmed since the start.
        writes: u64 = 0, "";
        /// Writes that have failed since the start.
        failures: u64 = 0, "";
        /// Times that the setpoint was not renewed in its time.
        timeouts: u64 = 0, "";
        /// Times that an interlock has closed.
        interlocks: u64 = 0, "";
    }
    json [
        seq, t_sensor_ns, t_publish_ns, t_written_ns, pressure_mpa, wanted_mpa, safe_mpa, valve_reason, valve_interlock,
        valve_limit, owner, setpoint_seq, setpoint_boot_id, writes, failures, timeouts, interlocks, boot_id,
    ]
}
