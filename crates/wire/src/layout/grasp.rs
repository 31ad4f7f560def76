//! Whether a gripper holds its object.

use super::payload::payload;
use super::{VERSION, flags, grasp_status};

/// Most fingers of one grasp.
pub const FINGERS_MAX: usize = 8;

payload! {
    /// The grasp of one scene: `n` fingers hold an object by friction when `n mu min(F) >= s m g`.
    ///
    /// The smallest finger force counts for all of them: what one finger pushes more than the others moves the object
    /// instead of holding it.
    Grasp "softtwin.Grasp" 312 {
        /// Layout version.
        0 layout_version: u32 = VERSION, "";
        /// Set flags of all fingers.
        4 flags: u32 = flags::NO_DATA, "", Show::Flags(flags::ALL);
        /// The run of the twin.
        8 boot_id: u64 = 0, "", Show::Hex;
        /// Counts up by one per grasp within a run, beginning at 1.
        16 seq: u64 = 0, "";
        /// When the oldest of the readings behind it was taken.
        24 t_sensor_ns: u64 = 0, "ns";
        /// When the grasp was sent.
        32 t_publish_ns: u64 = 0, "ns";
        /// Whether the object is held.
        40 grasp_status: u32 = grasp_status::UNKNOWN, "", Show::Code(grasp_status::ALL);
        /// Fingers.
        44 finger_count: u32 = 0, "";
        /// Mass of the object.
        48 mass_kg: f64 = f64::NAN, "kg";
        /// Friction coefficient between finger and object.
        56 friction: f64 = f64::NAN, "";
        /// Safety factor on the weight.
        64 safety: f64 = f64::NAN, "";
        /// Force that each finger must bring: `s m g / (n mu)`.
        72 needed_force_n: f64 = f64::NAN, "N";
        /// Smallest force of a finger.
        80 least_force_n: f64 = f64::NAN, "N";
        /// `least_force_n / needed_force_n - 1`: at least 0 when held.
        88 margin: f64 = f64::NAN, "";
        /// Friction coefficient from which these forces would hold the object: `s m g / (n F)`.
        96 needed_friction: f64 = f64::NAN, "";
        /// Pressure at which the object is first held (all fingers at this pressure); NaN: not within the sampled states.
        104 stop_pressure_mpa: f64 = f64::NAN, "MPa";
        /// Half-width of that pressure.
        112 stop_pressure_halfwidth_mpa: f64 = f64::NAN, "MPa";
        /// Force of each finger; the rest 0.
        120 forces_n: [f64; FINGERS_MAX] = [0.0; FINGERS_MAX], "N", Show::Counted("finger_count");
        /// Pressure of each finger; the rest 0.
        184 pressures_mpa: [f64; FINGERS_MAX] = [0.0; FINGERS_MAX], "MPa", Show::Counted("finger_count");
        /// Half-width of the forces.
        248 force_halfwidth_n: f64 = f64::NAN, "N";
        /// Zero; for later values.
        256 reserved: [u64; 3] = [0; 3], "";
        /// Name of the scene, zero-padded.
        280 scene: [u8; 32] = [0; 32], "", Show::Name;
    }
    json [
        seq, t_sensor_ns, t_publish_ns, grasp_status, mass_kg, friction, safety, needed_force_n, least_force_n, margin,
        needed_friction, stop_pressure_mpa, stop_pressure_halfwidth_mpa, force_halfwidth_n, forces_n, pressures_mpa,
        flags, scene, boot_id,
    ]
}

impl Grasp {
    /// Force and pressure of each finger.
    pub fn fingers(&self) -> impl Iterator<Item = (f64, f64)> {
        self.forces_n.into_iter().zip(self.pressures_mpa).take(self.finger_count as usize)
    }
}
