//! The small state a controller needs.

use super::input::inputs_of;
use super::payload::payload;
use super::{INPUTS_MAX, InputValue, Outcome, VERSION, domain_status, flags, input_source, regime};

/// Most modal coefficients in one state.
pub const COEFFICIENTS_MAX: usize = 128;
/// Most groups of fields (each with its own POD basis) in one state.
pub const GROUPS_MAX: usize = 8;

payload! {
    /// Force, gradients, coefficients and domain status of one evaluation.
    State "softtwin.State" 1120 {
        /// Layout version.
        0 layout_version: u32 = VERSION, "";
        /// Set flags.
        4 flags: u32 = flags::NO_DATA, "", Show::Flags(flags::ALL);
        /// First 16 bytes of the model file's hash.
        8 model_hash: [u8; 16] = [0; 16], "", Show::Hex;
        /// The run of the twin.
        24 boot_id: u64 = 0, "", Show::Hex;
        /// Counts up by one per state within a run, beginning at 1.
        32 seq: u64 = 0, "";
        /// The run of the bridge that sent the reading.
        40 sensor_boot_id: u64 = 0, "", Show::Hex;
        /// Sequence number of the reading the values stand for (the last good one when held or stale).
        48 sensor_seq: u64 = 0, "";
        /// When that reading was taken.
        56 t_sensor_ns: u64 = 0, "ns";
        /// When the state was sent.
        64 t_publish_ns: u64 = 0, "ns";
        /// Age of that reading when the state was sent.
        72 age_ns: u64 = 0, "ns";
        /// Pressure of that reading; where the twin estimates the gauge's bias, the estimated one.
        80 pressure_mpa: f64 = f64::NAN, "MPa";
        /// Gap of that reading; where the twin estimates the gap, the estimated one.
        88 gap_mm: f64 = f64::NAN, "mm";
        /// Predicted contact force; 0 in the free regime.
        96 contact_force_n: f64 = f64::NAN, "N";
        /// Gradient of the force by the pressure; NaN when not configured.
        104 force_by_pressure_n_per_mpa: f64 = f64::NAN, "N/MPa";
        /// Gradient of the force by the gap; NaN when not configured.
        112 force_by_gap_n_per_mm: f64 = f64::NAN, "N/mm";
        /// Pressure of first contact at this gap; infinite when the plate is out of reach.
        120 onset_pressure_mpa: f64 = f64::NAN, "MPa";
        /// Measured contact force; NaN when there is none.
        128 measured_force_n: f64 = f64::NAN, "N";
        /// Half-width of the force; NaN when not configured.
        136 force_halfwidth_n: f32 = f32::NAN, "N";
        /// Half-width of the displacement; NaN when not configured.
        140 displacement_halfwidth_mm: f32 = f32::NAN, "mm";
        /// Half-width of the stress; NaN when not configured.
        144 von_mises_halfwidth_mpa: f32 = f32::NAN, "MPa";
        /// Distance to the sampled states, over inputs scaled to [0, 1]: 0 inside, never negative.
        148 domain_distance: f32 = f32::NAN, "";
        /// Regime.
        152 regime: u32 = regime::UNKNOWN, "", Show::Code(regime::ALL);
        /// Outcome of the newest reading.
        156 outcome: u32 = Outcome::Published as u32, "", Show::Code(Outcome::CODES);
        /// Where the inputs lie among the sampled states: 0 inside, 1 near the edge, 2 outside.
        160 domain_status: u32 = domain_status::INSIDE, "";
        /// Coefficients in use.
        164 coefficient_count: u32 = 0, "";
        /// Coefficients of each group, in the model's order; the rest 0. More in all than fit below: flag `coefficients-cut`.
        168 group_sizes: [u8; GROUPS_MAX] = [0; GROUPS_MAX], "", Show::UntilZero;
        /// Modal coefficients, group by group; the rest 0.
        176 coefficients: [f32; COEFFICIENTS_MAX] = [0.0; COEFFICIENTS_MAX], "", Show::Counted("coefficient_count");
        /// Name of the actuator, zero-padded.
        688 actuator: [u8; 32] = [0; 32], "", Show::Name;
        /// Inputs of the model.
        720 input_count: u32 = 0, "";
        /// Zero.
        724 reserved: u32 = 0, "";
        /// The model's inputs that the values stand for, in its order and units.
        728 inputs: [f64; INPUTS_MAX] = [f64::NAN; INPUTS_MAX], "", Show::Counted("input_count");
        /// Gradient of the force by each input, N per unit of the input; NaN when not configured.
        792 force_by_input: [f64; INPUTS_MAX] = [f64::NAN; INPUTS_MAX], "", Show::Counted("input_count");
        /// Names of the inputs, 32 bytes each, zero-padded; a longer name is cut from the left.
        856 input_names: [u8; 32 * INPUTS_MAX] = [0; 32 * INPUTS_MAX], "", Show::Names("input_count");
        /// Where the value of each input comes from.
        1112 input_sources: [u8; INPUTS_MAX] = [input_source::UNKNOWN; INPUTS_MAX], "", Show::Codes(input_source::ALL, "input_count");
    }
    json [
        seq, sensor_seq, t_sensor_ns, t_publish_ns, age_ns, pressure_mpa, gap_mm, regime, contact_force_n,
        force_halfwidth_n, force_by_pressure_n_per_mpa, force_by_gap_n_per_mm, onset_pressure_mpa, measured_force_n,
        displacement_halfwidth_mm, von_mises_halfwidth_mpa, domain_distance, domain_status, outcome, flags,
        flag_bits: flags as Show::Number, input_names, inputs, input_sources, force_by_input, group_sizes, coefficients, actuator,
        model_hash, boot_id, sensor_boot_id,
    ]
}

impl State {
    /// The model's inputs.
    pub fn inputs(&self) -> impl Iterator<Item = InputValue> {
        inputs_of(
            self.input_count,
            &self.input_names,
            &self.inputs,
            &self.force_by_input,
            &self.input_sources,
        )
    }

    /// The coefficients in use.
    pub fn coefficients(&self) -> &[f32] {
        self.coefficients.get(..self.coefficient_count as usize).unwrap_or(&[])
    }
}
