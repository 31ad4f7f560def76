//! The small state a controller needs.

use iceoryx2::prelude::ZeroCopySend;

/// Most modal coefficients in one state.
pub const COEFFICIENTS_MAX: usize = 128;
/// Most groups of fields (each with its own POD basis) in one state.
pub const GROUPS_MAX: usize = 8;

/// Force, gradients, coefficients and verdicts of one evaluation; 752 bytes.
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend)]
#[type_name("softtwin.State.v2")]
#[repr(C)]
pub struct State {
    /// [`super::VERSION`].
    pub layout_version: u32,
    /// Bits of [`super::flags`].
    pub flags: u32,
    /// First 16 bytes of the model file's hash.
    pub model_hash: [u8; 16],
    /// The run of the twin, see [`crate::boot_id`].
    pub boot_id: u64,
    /// Counts up by one per state within a run, beginning at 1.
    pub seq: u64,
    /// The run of the bridge that sent the reading.
    pub sensor_boot_id: u64,
    /// Sequence number of the reading the values stand for (the last good one when held or stale).
    pub sensor_seq: u64,
    /// When that reading was taken, see [`crate::now_ns`].
    pub t_sensor_ns: u64,
    /// When the state was sent.
    pub t_publish_ns: u64,
    /// Age of that reading when the state was sent, ns.
    pub age_ns: u64,
    /// Pressure of that reading, MPa.
    pub pressure_mpa: f64,
    /// Gap of that reading, mm.
    pub gap_mm: f64,
    /// Predicted contact force, N; 0 in the free regime.
    pub contact_force_n: f64,
    /// Its gradient by the pressure, N/MPa; NaN when not asked for.
    pub force_by_pressure_n_per_mpa: f64,
    /// Its gradient by the gap, N/mm; NaN when not asked for.
    pub force_by_gap_n_per_mm: f64,
    /// Pressure of first contact at this gap, MPa; infinite when the plate is out of reach.
    pub onset_pressure_mpa: f64,
    /// Measured contact force, N; NaN when there is none.
    pub measured_force_n: f64,
    /// Half width of the force's error bar, N; NaN when not asked for.
    pub force_halfwidth_n: f32,
    /// Half width of the displacement's error bar, mm; NaN when not asked for.
    pub displacement_halfwidth_mm: f32,
    /// Half width of the stress's error bar, MPa; NaN when not asked for.
    pub von_mises_halfwidth_mpa: f32,
    /// Distance to the sampled states over inputs scaled to [0, 1]; 0 inside.
    pub domain_distance: f32,
    /// Number of [`super::regime`].
    pub regime: u32,
    /// Number of [`crate::Outcome`] of the newest reading.
    pub outcome: u32,
    /// 0 inside, 1 near the edge, 2 outside the sampled states.
    pub domain_status: u32,
    /// Coefficients in use.
    pub coefficient_count: u32,
    /// Coefficients of each group, in the model's order; the rest 0. More in all than fit below: flag `coefficients-cut`.
    pub group_sizes: [u8; GROUPS_MAX],
    /// Modal coefficients, group by group; the rest 0.
    pub coefficients: [f32; COEFFICIENTS_MAX],
    /// Name of the actuator, zero-padded.
    pub actuator: [u8; 32],
    /// Zero; room for later values.
    pub reserved: [u64; 4],
}

super::layout!(State, 752, {
    layout_version: 0,
    flags: 4,
    model_hash: 8,
    boot_id: 24,
    seq: 32,
    sensor_boot_id: 40,
    sensor_seq: 48,
    t_sensor_ns: 56,
    t_publish_ns: 64,
    age_ns: 72,
    pressure_mpa: 80,
    gap_mm: 88,
    contact_force_n: 96,
    force_by_pressure_n_per_mpa: 104,
    force_by_gap_n_per_mm: 112,
    onset_pressure_mpa: 120,
    measured_force_n: 128,
    force_halfwidth_n: 136,
    displacement_halfwidth_mm: 140,
    von_mises_halfwidth_mpa: 144,
    domain_distance: 148,
    regime: 152,
    outcome: 156,
    domain_status: 160,
    coefficient_count: 164,
    group_sizes: 168,
    coefficients: 176,
    actuator: 688,
    reserved: 720,
});

impl State {
    /// The coefficients in use.
    pub fn coefficients(&self) -> &[f32] {
        self.coefficients.get(..self.coefficient_count as usize).unwrap_or(&[])
    }
}

/// A state with nothing known: flag `no-data`, all quantities NaN.
impl Default for State {
    fn default() -> Self {
        Self {
            layout_version: super::VERSION,
            flags: super::flags::NO_DATA,
            model_hash: [0; 16],
            boot_id: 0,
            seq: 0,
            sensor_boot_id: 0,
            sensor_seq: 0,
            t_sensor_ns: 0,
            t_publish_ns: 0,
            age_ns: 0,
            pressure_mpa: f64::NAN,
            gap_mm: f64::NAN,
            contact_force_n: f64::NAN,
            force_by_pressure_n_per_mpa: f64::NAN,
            force_by_gap_n_per_mm: f64::NAN,
            onset_pressure_mpa: f64::NAN,
            measured_force_n: f64::NAN,
            force_halfwidth_n: f32::NAN,
            displacement_halfwidth_mm: f32::NAN,
            von_mises_halfwidth_mpa: f32::NAN,
            domain_distance: f32::NAN,
            regime: super::regime::UNKNOWN,
            outcome: crate::Outcome::Published.code(),
            domain_status: 0,
            coefficient_count: 0,
            group_sizes: [0; GROUPS_MAX],
            coefficients: [0.0; COEFFICIENTS_MAX],
            actuator: [0; 32],
            reserved: [0; 4],
        }
    }
}
