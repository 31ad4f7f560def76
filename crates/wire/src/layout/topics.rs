//! The payloads of a reading's way: the reading, the state, the header of a field, the estimate; then health and grasp.

use super::codes::inputs_of;
use super::payload::{Scalar, Value, payload};
use super::{
    INPUTS_MAX, InputValue, LAYOUT_VERSION, Outcome, PARAMETERS_MAX, estimate_alarm, estimate_status,
    field_id, flags, grasp_status, input_source, regime, set_slot, slot, value_bits,
};

/// Most markers of one actuator.
pub const MARKERS_MAX: usize = 8;
/// Number of ages: pressure, gap, force, each marker.
pub const AGES_MAX: usize = 3 + MARKERS_MAX;

/// Measured position of a marker in the camera's frame, mm; NaN if it was not seen.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C)]
#[allow(missing_docs)] // coordinates
pub struct Marker {
    pub x: f64,
    pub y: f64,
    pub z: f64,
}

impl Marker {
    /// A marker that was not seen.
    pub const ABSENT: Self = Self { x: f64::NAN, y: f64::NAN, z: f64::NAN };
}

/// Age of each value of a reading, ns; of an absent value that of the last one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[repr(C)]
#[allow(missing_docs)] // values of a reading
pub struct Ages {
    pub pressure: u64,
    pub gap: u64,
    pub force: u64,
    pub markers: [u64; MARKERS_MAX],
}

impl Value for [Marker; MARKERS_MAX] {
    const SCALAR: Scalar = Scalar::F64;
    const COUNT: usize = 3 * MARKERS_MAX;
}

impl Value for Ages {
    const SCALAR: Scalar = Scalar::U64;
    const COUNT: usize = AGES_MAX;
}

payload! {
    /// One reading of the sensors of one actuator, stamped by the bridge.
    SensorSample "softtwin.Sensor" {
        /// The run of the bridge that sent it.
        boot_id: u64 = 0, "", Show::Hex;
        /// Counts up by one per reading within a run, beginning at 1.
        seq: u64 = 0, "";
        /// When the reading was taken: of several sensors, the one that sets the pace.
        t_sensor_ns: u64 = 0, "ns";
        /// Gauge pressure in the chambers.
        pressure_mpa: f64 = f64::NAN, "MPa";
        /// Distance from the underside of the undeformed base to the plate.
        gap_mm: f64 = f64::NAN, "mm";
        /// Measured contact force; NaN without a load cell.
        measured_force_n: f64 = f64::NAN, "N";
        /// Time in the source's own trace (replays); NaN when there is none.
        t_trace_s: f64 = f64::NAN, "s";
        /// 0: good; up to 255 a fault code that the sensor itself gives; 256: the pressure is too old;
        /// 257: the pressure lies outside its calibration.
        status: u32 = 0, "";
        /// Coordinates below: three for each marker of the scene, 0 without markers.
        marker_values: u32 = 0, "";
        /// Measured x, y, z of the first marker, of the second, ..., in the camera's frame; NaN where one was not seen.
        markers_mm: [Marker; MARKERS_MAX] = [Marker::ABSENT; MARKERS_MAX], "mm", Show::Counted("marker_values");
        /// Ages below: 0, all values were taken at `t_sensor_ns`; 11 where they come from several sensors.
        age_count: u32 = 0, "";
        /// Values that are absent because they are older than the scene allows.
        stale_values: u32 = 0, "", Show::Flags(value_bits::ALL);
        /// Values that are absent because their sensor says that it is faulty, or because they lie outside its calibration.
        fault_values: u32 = 0, "", Show::Flags(value_bits::ALL);
        /// Named inputs below; 0: none.
        input_count: u32 = 0, "";
        /// Age at `t_sensor_ns` of pressure, gap, force, first marker, second, ...; of an absent value that of the last one.
        ages_ns: Ages = Ages { pressure: 0, gap: 0, force: 0, markers: [0; MARKERS_MAX] }, "ns", Show::Counted("age_count");
        /// Values that were left out because of their age since the start of the bridge.
        stale_total: u64 = 0, "";
        /// Measured values of further model inputs, in the unit at the end of their names; NaN where one is absent.
        inputs: [f64; PARAMETERS_MAX] = [f64::NAN; PARAMETERS_MAX], "", Show::Counted("input_count");
        /// Names of these inputs, 32 bytes each, zero-padded; a longer name is cut from the left. A twin takes those of its model by name.
        input_names: [u8; 32 * PARAMETERS_MAX] = [0; 32 * PARAMETERS_MAX], "", Show::Names("input_count");
        /// Age at `t_sensor_ns` of these inputs; of an absent value that of the last one.
        input_ages_ns: [u64; PARAMETERS_MAX] = [0; PARAMETERS_MAX], "ns", Show::Counted("input_count");
    }
    json [
        seq, t_sensor_ns, pressure_mpa, gap_mm, measured_force_n, markers_mm, t_trace_s, status, ages_ns, stale_values,
        fault_values, stale_total, input_names, inputs, input_ages_ns, boot_id,
    ]
}

impl SensorSample {
    /// The named inputs with their values.
    pub fn inputs(&self) -> impl Iterator<Item = (String, f64)> {
        let values = self.inputs.iter().take(self.input_count as usize);
        values.enumerate().map(|(index, value)| (slot(&self.input_names, index), *value))
    }

    /// Position and value of the input with this packed name.
    pub fn input(&self, name: &[u8; 32]) -> Option<(usize, f64)> {
        let names = self.input_names.as_chunks::<32>().0.iter().take(self.input_count as usize);
        let mut found = names.zip(&self.inputs).enumerate();
        found.find(|(_, (known, _))| *known == name).map(|(index, (_, value))| (index, *value))
    }

    /// Adds a named input; false when there are as many as fit already. Of a name of more than 31 bytes the end is kept.
    pub fn add_input(&mut self, name: &str, value: f64) -> bool {
        let next = self.input_count as usize;
        let Some(to) = self.inputs.get_mut(next) else { return false };
        *to = value;
        set_slot(&mut self.input_names, next, name);
        self.input_count += 1;
        true
    }
}

/// Most modal coefficients in one state.
pub const COEFFICIENTS_MAX: usize = 256;
/// Most groups of fields (each with its own POD basis) in one state.
pub const GROUPS_MAX: usize = 8;

/// A payload with the values of one evaluation: [`State`] and [`super::Answer`]. The shared JSON keys are between the two lists.
macro_rules! evaluated_payload {
    (
        $(#[doc = $about:literal])+
        $name:ident $schema:literal { $($own:tt)* }
        json [$($first:tt)*] [$($last:tt)*]
    ) => {
        $crate::layout::payload::payload! {
            $(#[doc = $about])+
            $name $schema {
                $($own)*
                /// Observables of the model.
                observable_count: u32 = 0, "";
                /// Pressure: of the reading, given or found; the estimated one if the twin estimates the gauge's bias. NaN: the model has none.
                pressure_mpa: f64 = f64::NAN, "MPa";
                /// Gap: of the reading, given, found or estimated. NaN: the model has none.
                gap_mm: f64 = f64::NAN, "mm";
                /// Predicted contact force; 0 in the free regime. NaN: the model has no forces.
                contact_force_n: f64 = f64::NAN, "N";
                /// Derivative of the force with respect to the pressure; NaN when not configured, or if the model has no force or no pressure.
                force_by_pressure_n_per_mpa: f64 = f64::NAN, "N/MPa";
                /// Derivative of the force with respect to the gap; NaN when not configured, or if the model has no force or no gap.
                force_by_gap_n_per_mm: f64 = f64::NAN, "N/mm";
                /// Pressure of first contact at this gap; infinite when the plate is out of reach. NaN: the model has no onset.
                onset_pressure_mpa: f64 = f64::NAN, "MPa";
                /// Half-width of the force; NaN when not configured and outside the training range.
                force_halfwidth_n: f32 = f32::NAN, "N";
                /// Half-width of the displacement; NaN when not configured and outside the training range.
                displacement_halfwidth_mm: f32 = f32::NAN, "mm";
                /// Half-width of the stress; NaN when not configured and outside the training range.
                von_mises_halfwidth_mpa: f32 = f32::NAN, "MPa";
                /// Distance to the sampled states, over inputs scaled to [0, 1]: 0 inside, never negative.
                domain_distance: f32 = f32::NAN, "";
                /// Regime.
                regime: u32 = $crate::layout::regime::UNKNOWN, "", Show::Code($crate::layout::regime::ALL);
                /// Position of the inputs relative to the sampled states: 0 inside, 1 near the edge, 2 outside.
                domain_status: u32 = $crate::layout::domain_status::INSIDE, "";
                /// Coefficients in use.
                coefficient_count: u32 = 0, "";
                /// Inputs of the model.
                input_count: u32 = 0, "";
                /// Coefficients of each group, in the model's order; the rest 0. With more in all than fit below the flag
                /// `coefficients-cut` is set.
                group_sizes: [u8; $crate::layout::GROUPS_MAX] = [0; $crate::layout::GROUPS_MAX], "", Show::UntilZero;
                /// Modal coefficients, group by group; the rest 0.
                coefficients: [f32; $crate::layout::COEFFICIENTS_MAX] = [0.0; $crate::layout::COEFFICIENTS_MAX], "", Show::Counted("coefficient_count");
                /// The model's inputs, in its order and units; NaN without an answer.
                inputs: [f64; $crate::layout::INPUTS_MAX] = [f64::NAN; $crate::layout::INPUTS_MAX], "", Show::Counted("input_count");
                /// How far each input is outside the values of the training, in its unit: above 0 over the largest, below 0 under the smallest.
                outside_by: [f64; $crate::layout::INPUTS_MAX] = [f64::NAN; $crate::layout::INPUTS_MAX], "", Show::Counted("input_count");
                /// Derivative of the force with respect to each input, N per unit of the input; NaN when not configured.
                force_by_input: [f64; $crate::layout::INPUTS_MAX] = [f64::NAN; $crate::layout::INPUTS_MAX], "", Show::Counted("input_count");
                /// Names of the inputs, 32 bytes each, zero-padded; a longer name is cut from the left.
                input_names: [u8; 32 * $crate::layout::INPUTS_MAX] = [0; 32 * $crate::layout::INPUTS_MAX], "", Show::Names("input_count");
                /// Observables, such as a bending angle, in the unit at the end of their names; of a model learned from measurements its first
                /// eight outputs that are no marker's coordinates. NaN without an answer.
                observables: [f64; $crate::layout::OBSERVABLES_MAX] = [f64::NAN; $crate::layout::OBSERVABLES_MAX], "", Show::Counted("observable_count");
                /// Half-widths of the observables; NaN when not configured and outside the training range.
                observable_halfwidths: [f64; $crate::layout::OBSERVABLES_MAX] = [f64::NAN; $crate::layout::OBSERVABLES_MAX], "", Show::Counted("observable_count");
                /// Part of each observable that is a measured difference from the finite elements, or the offset that follows measured values
                /// (`follow`); 0 without one.
                observable_offsets: [f64; $crate::layout::OBSERVABLES_MAX] = [f64::NAN; $crate::layout::OBSERVABLES_MAX], "", Show::Counted("observable_count");
                /// Names of the observables, 32 bytes each, zero-padded; a longer name is cut from the left.
                observable_names: [u8; 32 * $crate::layout::OBSERVABLES_MAX] = [0; 32 * $crate::layout::OBSERVABLES_MAX], "", Show::Names("observable_count");
            }
            json [
                $($first)* pressure_mpa, gap_mm, regime, contact_force_n, force_halfwidth_n, force_by_pressure_n_per_mpa,
                force_by_gap_n_per_mm, onset_pressure_mpa, displacement_halfwidth_mm, von_mises_halfwidth_mpa,
                domain_distance, domain_status, input_names, inputs, outside_by, force_by_input, observable_names, observables, observable_halfwidths, observable_offsets,
                group_sizes, coefficients, $($last)*
            ]
        }

        impl $name {
            /// The observables: name, value and half-width.
            pub fn observables(&self) -> impl Iterator<Item = (String, f64, f64)> {
                let values = self.observables.iter().zip(self.observable_halfwidths);
                let named = values.enumerate().map(|(index, (value, halfwidth))| (slot(&self.observable_names, index), *value, halfwidth));
                named.take(self.observable_count as usize)
            }

            /// The coefficients in use.
            pub fn coefficients(&self) -> &[f32] {
                self.coefficients.get(..self.coefficient_count as usize).unwrap_or(&[])
            }
        }
    };
}
pub(super) use evaluated_payload;

evaluated_payload! {
    /// Force, gradients, coefficients and domain status of one evaluation.
    State "softtwin.State" {
        /// Layout version.
        layout_version: u32 = LAYOUT_VERSION, "";
        /// Set flags.
        flags: u32 = flags::NO_DATA, "", Show::Flags(flags::ALL);
        /// First 16 bytes of the model file's hash.
        model_hash: [u8; 16] = [0; 16], "", Show::Hex;
        /// The run of the twin.
        boot_id: u64 = 0, "", Show::Hex;
        /// Counts up by one per state within a run, beginning at 1.
        seq: u64 = 0, "";
        /// The run of the bridge that sent the reading.
        sensor_boot_id: u64 = 0, "", Show::Hex;
        /// Sequence number of the reading the values stand for (the last good one when held or stale).
        sensor_seq: u64 = 0, "";
        /// When that reading was taken.
        t_sensor_ns: u64 = 0, "ns";
        /// When the state was sent.
        t_publish_ns: u64 = 0, "ns";
        /// Age of that reading when the state was sent.
        age_ns: u64 = 0, "ns";
        /// Measured contact force; NaN when there is none.
        measured_force_n: f64 = f64::NAN, "N";
        /// Source of the value of each input.
        input_sources: [u8; INPUTS_MAX] = [input_source::UNKNOWN; INPUTS_MAX], "", Show::Codes(input_source::ALL, "input_count");
        /// Name of the actuator, zero-padded.
        actuator: [u8; 32] = [0; 32], "", Show::Name;
        /// Outcome of the newest reading.
        outcome: u32 = Outcome::Published as u32, "", Show::Code(Outcome::CODES);
    }
    json [seq, sensor_seq, t_sensor_ns, t_publish_ns, age_ns,] [
        measured_force_n, outcome, flags, flag_bits: flags as Show::Number, input_sources, actuator, model_hash, boot_id,
        sensor_boot_id,
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
}

/// Most fields in one sample.
pub const FIELD_SLOTS: usize = 16;

payload! {
    /// Header of one field sample. The payload behind it is `node_count x field_count` `f32`, field-major: all nodes of the
    /// first field in `field_ids`, then all of the second, and so on.
    FieldHeader "softtwin.Field" {
        /// Layout version.
        layout_version: u32 = LAYOUT_VERSION, "";
        /// Set flags.
        flags: u32 = 0, "", Show::Flags(flags::ALL);
        /// First 16 bytes of the model file's hash.
        model_hash: [u8; 16] = [0; 16], "", Show::Hex;
        /// The run of the twin.
        boot_id: u64 = 0, "", Show::Hex;
        /// Counts up by one per sample of this topic within a run, beginning at 1: a jump is a lost sample.
        seq: u64 = 0, "";
        /// The run of the bridge that sent the reading.
        sensor_boot_id: u64 = 0, "", Show::Hex;
        /// Sequence number of the reading.
        sensor_seq: u64 = 0, "";
        /// When the reading was taken.
        t_sensor_ns: u64 = 0, "ns";
        /// When the field was sent.
        t_publish_ns: u64 = 0, "ns";
        /// Pressure of the reading; NaN: the model has none.
        pressure_mpa: f64 = f64::NAN, "MPa";
        /// Gap of the reading; NaN: the model has none.
        gap_mm: f64 = f64::NAN, "mm";
        /// Predicted contact force; NaN: the model has no forces.
        contact_force_n: f64 = f64::NAN, "N";
        /// Largest von Mises stress among the nodes of this sample; NaN when stress is not in it.
        max_von_mises_mpa: f64 = f64::NAN, "MPa";
        /// Node (number in the model) of that stress; 4294967295 when stress is not in it.
        max_von_mises_node: u32 = u32::MAX, "";
        /// Regime.
        regime: u32 = regime::UNKNOWN, "", Show::Code(regime::ALL);
        /// Nodes in this sample.
        node_count: u32 = 0, "";
        /// Fields in this sample.
        field_count: u32 = 0, "";
        /// Which field is where; unused slots are 0.
        field_ids: [u8; FIELD_SLOTS] = [field_id::NONE; FIELD_SLOTS], "", Show::FieldNames;
        /// Name of the node set, zero-padded.
        node_set: [u8; 32] = [0; 32], "", Show::Name;
        /// Inputs of the model.
        input_count: u32 = 0, "";
        /// Zero.
        reserved: u32 = 0, "";
        /// The model's inputs that the field was made for, in its order and units.
        inputs: [f64; INPUTS_MAX] = [f64::NAN; INPUTS_MAX], "", Show::Counted("input_count");
        /// Names of the inputs, 32 bytes each, zero-padded; a longer name is cut from the left.
        input_names: [u8; 32 * INPUTS_MAX] = [0; 32 * INPUTS_MAX], "", Show::Names("input_count");
        /// Where the value of each input comes from.
        input_sources: [u8; INPUTS_MAX] = [input_source::UNKNOWN; INPUTS_MAX], "", Show::Codes(input_source::ALL, "input_count");
    }
    json [
        seq, sensor_seq, t_sensor_ns, t_publish_ns, pressure_mpa, gap_mm, regime, contact_force_n, max_von_mises_mpa,
        max_von_mises_node, flags, node_set, node_count, fields: field_ids, input_names, inputs, input_sources, model_hash,
        boot_id,
    ]
}

impl FieldHeader {
    /// Entries of the payload: nodes x fields.
    pub fn entries(&self) -> u64 {
        u64::from(self.node_count) * u64::from(self.field_count)
    }

    /// The model's inputs that the field was made for; a field has no gradients of the force.
    pub fn inputs(&self) -> impl Iterator<Item = InputValue> {
        let (count, unknown) = (self.input_count, &[f64::NAN; INPUTS_MAX]);
        inputs_of(count, &self.input_names, &self.inputs, unknown, &self.input_sources)
    }

    /// The fields in their order, as numbers of [`super::field_id`].
    pub fn fields(&self) -> impl Iterator<Item = u8> {
        self.field_ids.into_iter().take(self.field_count as usize)
    }

    /// The fields with their values, one a node; those that `values` does not reach are left out.
    pub fn columns<'a>(&self, values: &'a [f32]) -> impl Iterator<Item = (u8, &'a [f32])> {
        self.fields().zip(values.chunks_exact((self.node_count as usize).max(1)))
    }

    /// The values of one field; none when it is not in this sample.
    pub fn column<'a>(&self, values: &'a [f32], id: u8) -> Option<&'a [f32]> {
        self.columns(values).find(|(found, _)| *found == id).map(|(_, column)| column)
    }

    /// The values of x, y and z; none when one of them is not in this sample.
    pub fn coordinates<'a>(&self, values: &'a [f32]) -> Option<[&'a [f32]; 3]> {
        let [x, y, z] = [field_id::X, field_id::Y, field_id::Z].map(|id| self.column(values, id));
        Some([x?, y?, z?])
    }
}

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
        /// Persistent contradiction; it stands until there has been no evidence of one for the scene's `alarm_hold_s`.
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
    pub fn name(&self, index: usize) -> String {
        slot(&self.names, index)
    }

    /// Sets the name of the quantity at a position. Of a name of more than 31 bytes the end is kept, which says more.
    pub fn set_name(&mut self, index: usize, name: &str) {
        set_slot(&mut self.names, index, name);
    }
}

/// Slots for counters, one per [`Outcome`] and some for later ones.
pub const OUTCOME_SLOTS: usize = 24;

payload! {
    /// Counters since the start of the twin and latencies of the last interval. `received` is the sum of all outcomes.
    Health "softtwin.Health" {
        /// Layout version.
        layout_version: u32 = LAYOUT_VERSION, "";
        /// Set flags as in the newest state.
        flags: u32 = flags::NO_DATA, "", Show::Flags(flags::ALL);
        /// First 16 bytes of the model file's hash.
        model_hash: [u8; 16] = [0; 16], "", Show::Hex;
        /// The run of the twin.
        boot_id: u64 = 0, "", Show::Hex;
        /// Counts up by one per health sample, beginning at 1.
        seq: u64 = 0, "";
        /// When it was sent.
        t_publish_ns: u64 = 0, "ns";
        /// Time since the twin started.
        uptime_ns: u64 = 0, "ns";
        /// The run of the bridge that sent the newest reading; 0: none yet.
        sensor_boot_id: u64 = 0, "", Show::Hex;
        /// Readings taken from the sensor topic; the sum of all outcomes.
        received: u64 = 0, "";
        /// Readings that never arrived, by gaps in the sequence numbers.
        missed: u64 = 0, "";
        /// Restarts of the bridge seen.
        sensor_restarts: u64 = 0, "";
        /// Times that the deadline passed without a usable reading.
        deadline_misses: u64 = 0, "";
        /// Fields sent over all node sets.
        fields_sent: u64 = 0, "";
        /// States sent.
        states_sent: u64 = 0, "";
        /// Readings whose field was sent later than the configured limit after their stamp.
        late: u64 = 0, "";
        /// Events and lines that are missing in the log: the reporter was behind, or a line could not be written.
        log_lost: u64 = 0, "";
        /// Age of the newest good reading.
        age_ns: u64 = 0, "ns";
        /// Readings per second over the last interval.
        rate_hz: f64 = 0.0, "Hz";
        /// From sensor stamp to sent, over the last interval: median.
        latency_p50_ns: u64 = 0, "ns";
        /// From sensor stamp to sent, over the last interval: 99th percentile.
        latency_p99_ns: u64 = 0, "ns";
        /// From sensor stamp to sent, over the last interval: slowest.
        latency_max_ns: u64 = 0, "ns";
        /// From taking the reading to sent, over the last interval: median.
        compute_p50_ns: u64 = 0, "ns";
        /// From taking the reading to sent, over the last interval: 99th percentile.
        compute_p99_ns: u64 = 0, "ns";
        /// From taking the reading to sent, over the last interval: slowest.
        compute_max_ns: u64 = 0, "ns";
        /// Readings by outcome, indexed by the outcome's number.
        outcomes: [u64; OUTCOME_SLOTS] = [0; OUTCOME_SLOTS], "", Show::PerCode(Outcome::CODES);
        /// Name of the actuator, zero-padded.
        actuator: [u8; 32] = [0; 32], "", Show::Name;
    }
    json [
        seq, t_publish_ns, uptime_ns, received, missed, sensor_restarts, deadline_misses, fields_sent, states_sent, late,
        log_lost, age_ns, rate_hz, latency_p50_ns, latency_p99_ns, latency_max_ns, compute_p50_ns, compute_p99_ns,
        compute_max_ns, outcomes, flags, actuator, model_hash, boot_id,
    ]
}

const _: () = assert!(Outcome::ALL.len() <= OUTCOME_SLOTS);

impl Health {
    /// The counter of one outcome.
    pub fn count(&self, outcome: Outcome) -> u64 {
        self.outcomes.get(outcome.code() as usize).copied().unwrap_or(0)
    }
}

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
