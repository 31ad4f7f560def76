//! Whether a gripper holds its object.

use iceoryx2::prelude::ZeroCopySend;

/// Most fingers of one grasp.
pub const FINGERS_MAX: usize = 8;

/// Numbers of [`Grasp::verdict`].
pub mod grasp_status {
    /// Not every finger has a fresh state.
    pub const UNKNOWN: u32 = 0;
    /// Friction does not carry the object.
    pub const NOT_HELD: u32 = 1;
    /// Friction carries the object, but would not at the lower end of the forces' error bars.
    pub const MARGINAL: u32 = 2;
    /// Friction carries the object at the lower end of the forces' error bars too.
    pub const HELD: u32 = 3;

    /// The text for people.
    pub fn as_str(verdict: u32) -> &'static str {
        match verdict {
            NOT_HELD => "not held",
            MARGINAL => "held, within the error bar",
            HELD => "held",
            _ => "unknown",
        }
    }
}

/// The grasp of one scene: `n` fingers hold an object by friction when `n mu min(F) >= s m g`; 312 bytes.
///
/// The smallest finger force counts for all of them: what one finger pushes more than the others moves the object instead
/// of holding it.
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend)]
#[type_name("softtwin.Grasp.v2")]
#[repr(C)]
pub struct Grasp {
    /// [`super::VERSION`].
    pub layout_version: u32,
    /// Bits of [`super::flags`], those of all fingers.
    pub flags: u32,
    /// The run of the twin, see [`crate::boot_id`].
    pub boot_id: u64,
    /// Counts up by one per grasp within a run, beginning at 1.
    pub seq: u64,
    /// When the oldest of the readings behind it was taken, see [`crate::now_ns`].
    pub t_sensor_ns: u64,
    /// When the grasp was sent.
    pub t_publish_ns: u64,
    /// Number of [`grasp_status`].
    pub verdict: u32,
    /// Fingers.
    pub finger_count: u32,
    /// Mass of the object, kg.
    pub mass_kg: f64,
    /// Friction coefficient between finger and object.
    pub friction: f64,
    /// Safety factor on the weight.
    pub safety: f64,
    /// Force that each finger must bring, N: `s m g / (n mu)`.
    pub needed_force_n: f64,
    /// Smallest force of a finger, N.
    pub least_force_n: f64,
    /// `least_force_n / needed_force_n - 1`: at least 0 when held.
    pub margin: f64,
    /// Friction coefficient from which these forces would hold the object: `s m g / (n F)`.
    pub needed_friction: f64,
    /// Pressure at which the object is first held (all fingers at this pressure), MPa; NaN: not within the sampled states.
    pub stop_pressure_mpa: f64,
    /// Half width of its error bar, MPa.
    pub stop_pressure_bar_mpa: f64,
    /// Force of each finger, N; the rest 0.
    pub forces_n: [f64; FINGERS_MAX],
    /// Pressure of each finger, MPa; the rest 0.
    pub pressures_mpa: [f64; FINGERS_MAX],
    /// Half width of the forces' error bar, N.
    pub force_halfwidth_n: f64,
    /// Zero; room for later values.
    pub reserved: [u64; 3],
    /// Name of the scene, zero-padded.
    pub scene: [u8; 32],
}

super::layout!(Grasp, 312, {
    layout_version: 0,
    flags: 4,
    boot_id: 8,
    seq: 16,
    t_sensor_ns: 24,
    t_publish_ns: 32,
    verdict: 40,
    finger_count: 44,
    mass_kg: 48,
    friction: 56,
    safety: 64,
    needed_force_n: 72,
    least_force_n: 80,
    margin: 88,
    needed_friction: 96,
    stop_pressure_mpa: 104,
    stop_pressure_bar_mpa: 112,
    forces_n: 120,
    pressures_mpa: 184,
    force_halfwidth_n: 248,
    reserved: 256,
    scene: 280,
});

impl Grasp {
    /// Force and pressure of each finger.
    pub fn fingers(&self) -> impl Iterator<Item = (f64, f64)> {
        self.forces_n.into_iter().zip(self.pressures_mpa).take(self.finger_count as usize)
    }
}

/// A grasp with nothing known.
impl Default for Grasp {
    fn default() -> Self {
        Self {
            layout_version: super::VERSION,
            flags: super::flags::NO_DATA,
            boot_id: 0,
            seq: 0,
            t_sensor_ns: 0,
            t_publish_ns: 0,
            verdict: grasp_status::UNKNOWN,
            finger_count: 0,
            mass_kg: f64::NAN,
            friction: f64::NAN,
            safety: f64::NAN,
            needed_force_n: f64::NAN,
            least_force_n: f64::NAN,
            margin: f64::NAN,
            needed_friction: f64::NAN,
            stop_pressure_mpa: f64::NAN,
            stop_pressure_bar_mpa: f64::NAN,
            forces_n: [0.0; FINGERS_MAX],
            pressures_mpa: [0.0; FINGERS_MAX],
            force_halfwidth_n: f64::NAN,
            reserved: [0; 3],
            scene: [0; 32],
        }
    }
}
