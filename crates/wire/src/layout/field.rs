//! The header of a field sample.

use super::input::inputs_of;
use super::payload::payload;
use super::{INPUTS_MAX, InputValue, VERSION, field_id, flags, input_source, regime};

/// Most fields in one sample.
pub const FIELD_SLOTS: usize = 16;

payload! {
    /// Header of one field sample. The payload behind it is `node_count x field_count` `f32`, field-major: all nodes of the
    /// first field in `field_ids`, then all of the second, and so on.
    FieldHeader "softtwin.Field" 504 {
        /// Layout version.
        0 layout_version: u32 = VERSION, "";
        /// Set flags.
        4 flags: u32 = 0, "", Show::Flags(flags::ALL);
        /// First 16 bytes of the model file's hash.
        8 model_hash: [u8; 16] = [0; 16], "", Show::Hex;
        /// The run of the twin.
        24 boot_id: u64 = 0, "", Show::Hex;
        /// Counts up by one per sample of this topic within a run, beginning at 1: a jump is a lost sample.
        32 seq: u64 = 0, "";
        /// The run of the bridge that sent the reading.
        40 sensor_boot_id: u64 = 0, "", Show::Hex;
        /// Sequence number of the reading.
        48 sensor_seq: u64 = 0, "";
        /// When the reading was taken.
        56 t_sensor_ns: u64 = 0, "ns";
        /// When the field was sent.
        64 t_publish_ns: u64 = 0, "ns";
        /// Pressure of the reading.
        72 pressure_mpa: f64 = f64::NAN, "MPa";
        /// Gap of the reading.
        80 gap_mm: f64 = f64::NAN, "mm";
        /// Predicted contact force.
        88 contact_force_n: f64 = f64::NAN, "N";
        /// Largest von Mises stress among the nodes of this sample; NaN when stress is not in it.
        96 max_von_mises_mpa: f64 = f64::NAN, "MPa";
        /// Node (number in the model) of that stress; 4294967295 when stress is not in it.
        104 max_von_mises_node: u32 = u32::MAX, "";
        /// Regime.
        108 regime: u32 = regime::UNKNOWN, "", Show::Code(regime::ALL);
        /// Nodes in this sample.
        112 node_count: u32 = 0, "";
        /// Fields in this sample.
        116 field_count: u32 = 0, "";
        /// Which field is where; unused slots are 0.
        120 field_ids: [u8; FIELD_SLOTS] = [field_id::NONE; FIELD_SLOTS], "", Show::FieldNames;
        /// Name of the node set, zero-padded.
        136 node_set: [u8; 32] = [0; 32], "", Show::Name;
        /// Inputs of the model.
        168 input_count: u32 = 0, "";
        /// Zero.
        172 reserved: u32 = 0, "";
        /// The model's inputs that the field was made for, in its order and units.
        176 inputs: [f64; INPUTS_MAX] = [f64::NAN; INPUTS_MAX], "", Show::Counted("input_count");
        /// Names of the inputs, 32 bytes each, zero-padded; a longer name is cut from the left.
        240 input_names: [u8; 32 * INPUTS_MAX] = [0; 32 * INPUTS_MAX], "", Show::Names("input_count");
        /// Where the value of each input comes from.
        496 input_sources: [u8; INPUTS_MAX] = [input_source::UNKNOWN; INPUTS_MAX], "", Show::Codes(input_source::ALL, "input_count");
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
