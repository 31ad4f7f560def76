//! What is asked of a twin and of a valve: queries with their answers, pressure commands, setpoints, targets, and what a valve did.

use super::codes::inputs_of;
use super::payload::payload;
use super::topics::evaluated_payload;
use super::{
    FIELD_SLOTS, INPUTS_MAX, InputValue, LAYOUT_VERSION, PARAMETERS_MAX, QueryStatus, field_id, flags,
    input_source, query_kind, set_slot, slot, target_kind, valve_interlock, valve_limit, valve_reason,
};

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
        let description = |(input, by): (InputValue, &f64)| {
            let side = if *by > 0.0 { "above the largest" } else { "below the smallest" };
            format!("{} is {} {side} trained value", input.name, by.abs())
        };
        let is_outside = |(_, by): &(InputValue, &f64)| by.abs() > 0.0;
        let found: Vec<String> =
            self.inputs().zip(&self.outside_by).filter(is_outside).map(description).collect();
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
#[path = "../../tests/unit/layout_requests.rs"]
mod tests;
