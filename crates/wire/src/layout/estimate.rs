//! Estimated quantities of a twin.

use super::payload::payload;
use super::{INPUTS_MAX, LAYOUT_VERSION, estimate_alarm, estimate_status, set_slot, slot};

/// Most quantities that one twin estimates.
pub const UNKNOWNS_MAX: usize = 8;

payload! {
    /// Estimated quantities after one reading, with its consistency with model and sensors.
    Estimate "softtwin.Estimate" {
        /// Layout version.
        layout_version: u32 = LAYOUT_VERSION, "";
        /// Status of the reading.
        status: u32 = estimate_status::NONE, "", Show::Code(estimate_status::ALL);
        /// First 16 bytes of the model file's hash.
        model_hash: [u8; 16] = [0; 16], "", Show::Hex;
        /// The run of the twin.
        boot_id: u64 = 0, "", Show::Hex;
        /// Counts up by one per estimate within a run, beginning at 1.
        seq: u64 = 0, "";
        /// The run of the bridge that sent the reading.
        sensor_boot_id: u64 = 0, "", Show::Hex;
        /// Sequence number of the reading.
        sensor_seq: u64 = 0, "";
        /// When the reading was taken.
        t_sensor_ns: u64 = 0, "ns";
        /// When the estimate was sent.
        t_publish_ns: u64 = 0, "ns";
        /// Normalised innovation squared of the values used; NaN when none was used.
        nis: f64 = f64::NAN, "";
        /// Below this in 2.5 % of all readings where model and sensors are as good as stated.
        nis_low: f64 = f64::NAN, "";
        /// Above this in 2.5 % of all readings where model and sensors are as good as stated.
        nis_high: f64 = f64::NAN, "";
        /// Measured values of the reading that were used.
        used_values: u32 = 0, "";
        /// Measurements rejected as contradictory: bit 0 the force, bit 1 the first marker, bit 2 the second, ...
        rejected: u32 = 0, "";
        /// Measurements rejected since the start.
        rejected_total: u64 = 0, "";
        /// Quantities that are estimated.
        unknown_count: u32 = 0, "";
        /// Bit 0: the readings identify the first quantity, and so on; 0: the value rests on the prior.
        identifiable: u32 = 0, "";
        /// Estimated values, in the units of their names.
        values: [f64; UNKNOWNS_MAX] = [f64::NAN; UNKNOWNS_MAX], "", Show::Counted("unknown_count");
        /// Standard deviations of the estimated values.
        sigmas: [f64; UNKNOWNS_MAX] = [f64::NAN; UNKNOWNS_MAX], "", Show::Counted("unknown_count");
        /// Model inputs that explain the reading best: pressure, gap, then the others in the model's order; NaN: the model does not
        /// have it. State and fields are those of these inputs.
        inputs: [f64; INPUTS_MAX] = [f64::NAN; INPUTS_MAX], "", Show::Counted("input_count");
        /// Inputs of the model.
        input_count: u32 = 0, "";
        /// Persistent contradiction of about the last second.
        alarm: u32 = estimate_alarm::NONE, "", Show::Code(estimate_alarm::ALL);
        /// Standard deviation of the force that follows from those of the estimated values.
        force_sigma_n: f64 = f64::NAN, "N";
        /// Name of the actuator, zero-padded.
        actuator: [u8; 32] = [0; 32], "", Show::Name;
        /// Names of the quantities, 32 bytes each, zero-padded; a longer name is cut from the left.
        names: [u8; 32 * UNKNOWNS_MAX] = [0; 32 * UNKNOWNS_MAX], "", Show::Names("unknown_count");
        /// Inputs or quantities of the alarm: bit 0 is the first input (the pressure) or quantity; for measurements the bits of `rejected`.
        suspects: u32 = 0, "";
        /// Zero.
        reserved: u32 = 0, "";
    }
    json [
        seq, sensor_seq, t_sensor_ns, t_publish_ns, status, names, values, sigmas, identifiable, inputs, force_sigma_n, nis,
        nis_low, nis_high, used_values, rejected, rejected_total, alarm, suspects, actuator, model_hash, boot_id, sensor_boot_id,
    ]
}

impl Estimate {
    /// The name of the quantity at a position.
    pub fn name(&self, at: usize) -> String {
        slot(&self.names, at)
    }

    /// Sets the name of the quantity at a position. Of a name of more than 31 bytes the end is kept, which says more.
    pub fn set_name(&mut self, at: usize, name: &str) {
        set_slot(&mut self.names, at, name);
    }
}
