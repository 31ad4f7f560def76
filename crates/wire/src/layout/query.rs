//! A question to a twin and its answer.

use super::input::inputs_of;
use super::payload::payload;
use super::{
    COEFFICIENTS_MAX, FIELD_SLOTS, GROUPS_MAX, INPUTS_MAX, InputValue, PARAMETERS_MAX, QueryStatus, VERSION,
    domain_status, field_id, flags, input_source, query_kind, regime, set_slot,
};

payload! {
    /// One question. What its kind does not need is NaN.
    Query "softtwin.Query" 320 {
        /// Layout version.
        0 layout_version: u32 = VERSION, "";
        /// What is asked for.
        4 kind: u32 = query_kind::WHATIF, "", Show::Code(query_kind::ALL);
        /// 1: the field is wanted too, 0: the state is enough.
        8 want_field: u32 = 0, "";
        /// Parameters given: model inputs beside pressure and gap. The others have the values that the twin uses itself.
        12 parameter_count: u32 = 0, "";
        /// Pressure.
        16 pressure_mpa: f64 = f64::NAN, "MPa";
        /// Gap.
        24 gap_mm: f64 = f64::NAN, "mm";
        /// Contact force: the target, or the measured one.
        32 force_n: f64 = f64::NAN, "N";
        /// Half-width of the measured force; NaN or 0: exact.
        40 force_halfwidth_n: f64 = f64::NAN, "N";
        /// Node set of the field that is wanted, zero-padded; empty or `all`: all nodes.
        48 node_set: [u8; 32] = [0; 32], "", Show::Name;
        /// Values of the parameters given.
        80 parameters: [f64; PARAMETERS_MAX] = [f64::NAN; PARAMETERS_MAX], "", Show::Counted("parameter_count");
        /// Their names, 32 bytes each, zero-padded; a longer name is cut from the left.
        128 parameter_names: [u8; 32 * PARAMETERS_MAX] = [0; 32 * PARAMETERS_MAX], "", Show::Names("parameter_count");
    }
    json [
        kind, pressure_mpa, gap_mm, force_n, force_halfwidth_n, want_field, node_set, parameter_names, parameters,
    ]
}

impl Query {
    /// Gives one more parameter a value; false: a question has no room for so many.
    pub fn set_parameter(&mut self, name: &str, value: f64) -> bool {
        let Some(to) = self.parameters.get_mut(self.parameter_count as usize) else { return false };
        *to = value;
        set_slot(&mut self.parameter_names, self.parameter_count as usize, name);
        self.parameter_count += 1;
        true
    }

    /// The parameters given: name as it is on the wire, and value.
    pub fn parameters(&self) -> impl Iterator<Item = (&[u8; 32], f64)> {
        let names = self.parameter_names.as_chunks::<32>().0;
        names.iter().zip(self.parameters).take(self.parameter_count as usize)
    }
}

payload! {
    /// The answer. The payload behind it is the field (`node_count x field_count` `f32`, field-major as on the field
    /// topic), or empty when none was wanted.
    Answer "softtwin.Answer" 1160 {
        /// Layout version.
        0 layout_version: u32 = VERSION, "";
        /// 0: answered, else the reason why there is no answer.
        4 status: u32 = QueryStatus::Answered as u32, "";
        /// First 16 bytes of the model file's hash.
        8 model_hash: [u8; 16] = [0; 16], "", Show::Hex;
        /// What was asked for.
        24 kind: u32 = query_kind::WHATIF, "", Show::Code(query_kind::ALL);
        /// Regime.
        28 regime: u32 = regime::UNKNOWN, "", Show::Code(regime::ALL);
        /// Where the inputs lie among the sampled states: 0 inside, 1 near the edge, 2 outside.
        32 domain_status: u32 = domain_status::INSIDE, "";
        /// Set flags.
        36 flags: u32 = 0, "", Show::Flags(flags::ALL);
        /// Time that the answer took to compute.
        40 compute_ns: u64 = 0, "ns";
        /// Pressure: given or found.
        48 pressure_mpa: f64 = f64::NAN, "MPa";
        /// Gap: given or found.
        56 gap_mm: f64 = f64::NAN, "mm";
        /// Contact force at that pressure and gap.
        64 contact_force_n: f64 = f64::NAN, "N";
        /// Gradient of the force by the pressure.
        72 force_by_pressure_n_per_mpa: f64 = f64::NAN, "N/MPa";
        /// Gradient of the force by the gap.
        80 force_by_gap_n_per_mm: f64 = f64::NAN, "N/mm";
        /// Pressure of first contact at this gap; infinite when the plate is out of reach.
        88 onset_pressure_mpa: f64 = f64::NAN, "MPa";
        /// Half-width of what was found (pressure in MPa, gap in mm); NaN for a what-if.
        96 uncertainty: f64 = f64::NAN, "";
        /// Lower end of what explains the question within the half-widths, cut at the sampled states; NaN for a what-if.
        104 low: f64 = f64::NAN, "";
        /// Upper end of it; NaN for a what-if.
        112 high: f64 = f64::NAN, "";
        /// The number that belongs to `status`; NaN when answered.
        120 limit: f64 = f64::NAN, "";
        /// Half-width of the force.
        128 force_halfwidth_n: f32 = f32::NAN, "N";
        /// Half-width of the displacement.
        132 displacement_halfwidth_mm: f32 = f32::NAN, "mm";
        /// Half-width of the stress.
        136 von_mises_halfwidth_mpa: f32 = f32::NAN, "MPa";
        /// Distance to the sampled states, over inputs scaled to [0, 1]: 0 inside, never negative.
        140 domain_distance: f32 = f32::NAN, "";
        /// Coefficients in use.
        144 coefficient_count: u32 = 0, "";
        /// Nodes of the field; 0: none was wanted.
        148 node_count: u32 = 0, "";
        /// Fields of the field sample.
        152 field_count: u32 = 0, "";
        /// Node (number in the model) of the largest stress; 4294967295 without a field.
        156 max_von_mises_node: u32 = u32::MAX, "";
        /// Largest von Mises stress among the nodes of the field; NaN without a field.
        160 max_von_mises_mpa: f64 = f64::NAN, "MPa";
        /// Which field is where; unused slots are 0.
        168 field_ids: [u8; FIELD_SLOTS] = [field_id::NONE; FIELD_SLOTS], "", Show::FieldNames;
        /// Coefficients of each group, in the model's order; the rest 0.
        184 group_sizes: [u8; GROUPS_MAX] = [0; GROUPS_MAX], "", Show::UntilZero;
        /// Modal coefficients, group by group; the rest 0.
        192 coefficients: [f32; COEFFICIENTS_MAX] = [0.0; COEFFICIENTS_MAX], "", Show::Counted("coefficient_count");
        /// Name of the node set of the field, zero-padded.
        704 node_set: [u8; 32] = [0; 32], "", Show::Name;
        /// Name of the actuator, zero-padded.
        736 actuator: [u8; 32] = [0; 32], "", Show::Name;
        /// Inputs of the model.
        768 input_count: u32 = 0, "";
        /// Zero.
        772 reserved: u32 = 0, "";
        /// The model's inputs that the answer stands for, in its order and units; NaN where there is no answer.
        776 inputs: [f64; INPUTS_MAX] = [f64::NAN; INPUTS_MAX], "", Show::Counted("input_count");
        /// Gradient of the force by each input, N per unit of the input.
        840 force_by_input: [f64; INPUTS_MAX] = [f64::NAN; INPUTS_MAX], "", Show::Counted("input_count");
        /// Names of the inputs, 32 bytes each, zero-padded; a longer name is cut from the left.
        904 input_names: [u8; 32 * INPUTS_MAX] = [0; 32 * INPUTS_MAX], "", Show::Names("input_count");
    }
    json [
        kind, limit, pressure_mpa, gap_mm, regime, contact_force_n, force_halfwidth_n, force_by_pressure_n_per_mpa,
        force_by_gap_n_per_mm, onset_pressure_mpa, uncertainty, low, high, displacement_halfwidth_mm,
        von_mises_halfwidth_mpa, domain_distance, domain_status, flags, input_names, inputs, force_by_input, coefficients,
        compute_ns, actuator, model_hash,
    ]
}

impl Answer {
    /// Why there is no answer, for people; `None`: there is one.
    pub fn refusal(&self) -> Option<String> {
        let Some(status) = QueryStatus::from_code(self.status) else {
            return Some(format!("the twin refused for a reason of another version ({})", self.status));
        };
        let unit = match (status, self.kind) {
            (QueryStatus::Answered, _) => return None,
            (QueryStatus::OutsideDomain, query_kind::GAP) => " MPa",
            (QueryStatus::OutsideDomain, _) => " mm",
            _ => "",
        };
        let names: Vec<String> = self.inputs().map(|input| input.name).collect();
        let text = status.as_str().replace("{limit}", &format!("{:.6}{unit}", self.limit));
        Some(text.replace("{inputs}", &names.join(", ")))
    }

    /// The model's inputs.
    pub fn inputs(&self) -> impl Iterator<Item = InputValue> {
        let (count, sources) = (self.input_count, &[input_source::UNKNOWN; INPUTS_MAX]);
        inputs_of(count, &self.input_names, &self.inputs, &self.force_by_input, sources)
    }

    /// Entries of the field: nodes x fields.
    pub fn entries(&self) -> u64 {
        u64::from(self.node_count) * u64::from(self.field_count)
    }

    /// The fields in their order, as numbers of [`super::field_id`].
    pub fn fields(&self) -> impl Iterator<Item = u8> {
        self.field_ids.into_iter().take(self.field_count as usize)
    }

    /// The coefficients in use.
    pub fn coefficients(&self) -> &[f32] {
        self.coefficients.get(..self.coefficient_count as usize).unwrap_or(&[])
    }
}

#[cfg(test)]
#[path = "../../tests/unit/layout_query.rs"]
mod tests;
