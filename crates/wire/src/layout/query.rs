//! A question to a twin and its answer.

use super::numbers::inputs_of;
use super::payload::payload;
use super::topics::evaluated_payload;
use super::{
    FIELD_SLOTS, INPUTS_MAX, InputValue, LAYOUT_VERSION, PARAMETERS_MAX, QueryStatus, field_id, flags,
    input_source, query_kind, set_slot, slot,
};

payload! {
    /// One question. What its kind does not need is NaN.
    Query "softtwin.Query" {
        /// Layout version.
        layout_version: u32 = LAYOUT_VERSION, "";
        /// Kind of the query.
        kind: u32 = query_kind::WHATIF, "", Show::Code(query_kind::ALL);
        /// 1: the field is wanted too, 0: the state is enough.
        want_field: u32 = 0, "";
        /// Number of parameters: model inputs other than pressure and gap. Missing ones have the values that the twin uses.
        parameter_count: u32 = 0, "";
        /// Pressure.
        pressure_mpa: f64 = f64::NAN, "MPa";
        /// Gap.
        gap_mm: f64 = f64::NAN, "mm";
        /// Contact force: the target, or the measured one.
        force_n: f64 = f64::NAN, "N";
        /// Half-width of the measured force; NaN or 0: exact.
        force_halfwidth_n: f64 = f64::NAN, "N";
        /// Node set of the field that is wanted, zero-padded; empty or `all`: all nodes.
        node_set: [u8; 32] = [0; 32], "", Show::Name;
        /// Values of the parameters given.
        parameters: [f64; PARAMETERS_MAX] = [f64::NAN; PARAMETERS_MAX], "", Show::Counted("parameter_count");
        /// Their names, 32 bytes each, zero-padded; a longer name is cut from the left.
        parameter_names: [u8; 32 * PARAMETERS_MAX] = [0; 32 * PARAMETERS_MAX], "", Show::Names("parameter_count");
    }
    json [
        kind, pressure_mpa, gap_mm, force_n, force_halfwidth_n, want_field, node_set, parameter_names, parameters,
    ]
}

impl Query {
    /// Adds a parameter; false if the query has no space for it.
    pub fn set_parameter(&mut self, name: &str, value: f64) -> bool {
        let Some(to) = self.parameters.get_mut(self.parameter_count as usize) else { return false };
        *to = value;
        set_slot(&mut self.parameter_names, self.parameter_count as usize, name);
        self.parameter_count += 1;
        true
    }

    /// Parameters with their names on the wire and values.
    pub fn parameters(&self) -> impl Iterator<Item = (&[u8; 32], f64)> {
        let names = self.parameter_names.as_chunks::<32>().0;
        names.iter().zip(self.parameters).take(self.parameter_count as usize)
    }
}

evaluated_payload! {
    /// The answer. The payload behind it is the field (`node_count x field_count` `f32`, field-major as on the field
    /// topic), or empty when none was wanted.
    Answer "softtwin.Answer" {
        /// Layout version.
        layout_version: u32 = LAYOUT_VERSION, "";
        /// 0: answered, else the reason why there is no answer.
        status: u32 = QueryStatus::Answered as u32, "";
        /// First 16 bytes of the model file's hash.
        model_hash: [u8; 16] = [0; 16], "", Show::Hex;
        /// Kind of the question.
        kind: u32 = query_kind::WHATIF, "", Show::Code(query_kind::ALL);
        /// Set flags.
        flags: u32 = 0, "", Show::Flags(flags::ALL);
        /// Time that the answer took to compute.
        compute_ns: u64 = 0, "ns";
        /// Half-width of what was found (pressure in MPa, gap in mm); NaN for a what-if.
        uncertainty: f64 = f64::NAN, "";
        /// Lower end of what explains the question within the half-widths, cut at the sampled states; NaN for a what-if.
        low: f64 = f64::NAN, "";
        /// Upper end of it; NaN for a what-if.
        high: f64 = f64::NAN, "";
        /// The number that belongs to `status`; NaN when answered.
        limit: f64 = f64::NAN, "";
        /// Nodes of the field; 0: none was wanted.
        node_count: u32 = 0, "";
        /// Fields of the field sample.
        field_count: u32 = 0, "";
        /// Largest von Mises stress among the nodes of the field; NaN without a field.
        max_von_mises_mpa: f64 = f64::NAN, "MPa";
        /// Which field is where; unused slots are 0.
        field_ids: [u8; FIELD_SLOTS] = [field_id::NONE; FIELD_SLOTS], "", Show::FieldNames;
        /// Name of the node set of the field, zero-padded.
        node_set: [u8; 32] = [0; 32], "", Show::Name;
        /// Name of the actuator, zero-padded.
        actuator: [u8; 32] = [0; 32], "", Show::Name;
        /// Node (number in the model) of the largest stress; 4294967295 without a field.
        max_von_mises_node: u32 = u32::MAX, "";
    }
    json [kind, limit,] [uncertainty, low, high, flags, compute_ns, actuator, model_hash,]
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
        let text = text.replace("{inputs}", &names.join(", "));
        Some(
            self.outside()
                .filter(|_| status == QueryStatus::TooFar)
                .map_or(text.clone(), |which| format!("{text} ({which})")),
        )
    }

    /// The inputs that are outside the values of the training, and by how much, for people; `None` if none is by itself.
    pub fn outside(&self) -> Option<String> {
        let one = |(input, by): (InputValue, &f64)| {
            let side = if *by > 0.0 { "above the largest" } else { "below the smallest" };
            format!("{} is {} {side} trained value", input.name, by.abs())
        };
        let is_outside = |(_, by): &(InputValue, &f64)| by.abs() > 0.0;
        let found: Vec<String> = self.inputs().zip(&self.outside_by).filter(is_outside).map(one).collect();
        (!found.is_empty()).then(|| found.join(", "))
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
}

#[cfg(test)]
#[path = "../../tests/unit/layout_query.rs"]
mod tests;
