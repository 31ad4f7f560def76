//! Whether a gripper holds its object.

use super::payload::payload;
use super::{LAYOUT_VERSION, flags, grasp_status};

/// Most fingers of one grasp.
pub const FINGERS_MAX: usize = 8;

payload! {
    /// The grasp of one scene: `n` fingers hold an object by friction when `n mu min(F) >= s m g`.
    ///
    /// The smallest finger force counts for all of them: what one finger pushes more than the others moves the object
    /// instead of holding it.
    Grasp "softtwin.Grasp" {
        /// Layout version.
        layout_version: u32 = LAYOUT_VERSION, "";
        /// Set flags of all fingers.
        flags: u32 = flags::NO_DATA, "", Show::Flags(flags::ALL);
        /// The run of the twin.
        boot_id: u64 = 0, "", Show::Hex;
        /// Counts up by one per grasp within a run, beginning at 1.
        seq: u64 = 0, "";
        /// When the oldest of the readings behind it was taken.
        t_sensor_ns: u64 = 0, "ns";
        /// When the grasp was sent.
        t_publish_ns: u64 = 0, "ns";
        /// Whether the object is held.
        grasp_status: u32 = grasp_status::UNKNOWN, "", Show::Code(grasp_status::ALL);
        /// Fingers.
        finger_count: u32 = 0, "";
        /// Mass of the object.
        mass_kg: f64 = f64::NAN, "kg";
        /// Friction coefficient between finger and object.
        friction: f64 = f64::NAN, "";
        /// Safety factor on the weight.
        safety: f64 = f64::NAN, "";
        /// Force that each finger must bring: `s m g / (n mu)`.
        needed_force_n: f64 = f64::NAN, "N";
        /// Smallest force of a finger.
        least_force_n: f64 = f64::NAN, "N";
        /// `least_force_n / needed_force_n - 1`: at least 0 when held.
        margin: f64 = f64::NAN, "";
        /// Friction coefficient from which these forces would hold the object: `s m g / (n F)`.
        needed_friction: f64 = f64::NAN, "";
        /// Pressure at which the object is first held (all fingers at this pressure); NaN: not within the sampled states.
        stop_pressure_mpa: f64 = f64::NAN, "MPa";
        /// Half-width of that pressure.
        stop_pressure_halfwidth_mpa: f64 = f64::NAN, "MPa";
        /// Force of each finger; the rest 0.
        forces_n: [f64; FINGERS_MAX] = [0.0; FINGERS_MAX], "N", Show::Counted("finger_count");
        /// Pressure of each finger; the rest 0.
        pressures_mpa: [f64; FINGERS_MAX] = [0.0; FINGERS_MAX], "MPa", Show::Counted("finger_count");
        /// Half-width of the forces.
        force_halfwidth_n: f64 = f64::NAN, "N";
        /// Name of the scene, zero-padded.
        scene: [u8; 32] = [0; 32], "", Show::Name;
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
