//! What stands before every field.

use iceoryx2::prelude::ZeroCopySend;

/// Most fields in one sample.
pub const FIELD_SLOTS: usize = 16;

/// Header of one field sample. The payload behind it is `node_count x field_count` `f32`, field-major: all nodes of the
/// first field in [`Self::field_ids`], then all of the second, and so on.
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend)]
#[type_name("softtwin.FieldHeader.v2")]
#[repr(C)]
pub struct FieldHeader {
    /// [`super::VERSION`].
    pub layout_version: u32,
    /// Bits of [`super::flags`].
    pub flags: u32,
    /// First 16 bytes of the model file's hash.
    pub model_hash: [u8; 16],
    /// The run of the twin, see [`crate::boot_id`].
    pub boot_id: u64,
    /// Counts up by one per sample of this topic within a run, beginning at 1: a jump is a lost sample.
    pub seq: u64,
    /// The run of the bridge that sent the reading.
    pub sensor_boot_id: u64,
    /// Sequence number of the reading.
    pub sensor_seq: u64,
    /// When the reading was taken, see [`crate::now_ns`].
    pub t_sensor_ns: u64,
    /// When the field was sent.
    pub t_publish_ns: u64,
    /// The reading's pressure, MPa.
    pub pressure_mpa: f64,
    /// The reading's gap, mm.
    pub gap_mm: f64,
    /// Predicted contact force, N.
    pub contact_force_n: f64,
    /// Largest von Mises stress among the nodes of this sample, MPa; NaN when stress is not in it.
    pub max_von_mises_mpa: f64,
    /// Node (number in the model) of that stress; `u32::MAX` when stress is not in it.
    pub max_von_mises_node: u32,
    /// Number of [`super::regime`].
    pub regime: u32,
    /// Nodes in this sample.
    pub node_count: u32,
    /// Fields in this sample.
    pub field_count: u32,
    /// Which field is where: numbers of [`super::field_id`], the rest 0.
    pub field_ids: [u8; FIELD_SLOTS],
    /// Name of the node set, zero-padded.
    pub node_set: [u8; 32],
}

super::layout!(FieldHeader, 168, {
    layout_version: 0,
    flags: 4,
    model_hash: 8,
    boot_id: 24,
    seq: 32,
    sensor_boot_id: 40,
    sensor_seq: 48,
    t_sensor_ns: 56,
    t_publish_ns: 64,
    pressure_mpa: 72,
    gap_mm: 80,
    contact_force_n: 88,
    max_von_mises_mpa: 96,
    max_von_mises_node: 104,
    regime: 108,
    node_count: 112,
    field_count: 116,
    field_ids: 120,
    node_set: 136,
});

impl FieldHeader {
    /// Entries of the payload: nodes x fields.
    pub fn entries(&self) -> u64 {
        u64::from(self.node_count) * u64::from(self.field_count)
    }

    /// The fields in their order, as numbers of [`super::field_id`].
    pub fn fields(&self) -> impl Iterator<Item = u8> {
        self.field_ids.into_iter().take(self.field_count as usize)
    }
}

/// A header with nothing known.
impl Default for FieldHeader {
    fn default() -> Self {
        Self {
            layout_version: super::VERSION,
            flags: 0,
            model_hash: [0; 16],
            boot_id: 0,
            seq: 0,
            sensor_boot_id: 0,
            sensor_seq: 0,
            t_sensor_ns: 0,
            t_publish_ns: 0,
            pressure_mpa: f64::NAN,
            gap_mm: f64::NAN,
            contact_force_n: f64::NAN,
            max_von_mises_mpa: f64::NAN,
            max_von_mises_node: u32::MAX,
            regime: super::regime::UNKNOWN,
            node_count: 0,
            field_count: 0,
            field_ids: [super::field_id::NONE; FIELD_SLOTS],
            node_set: [0; 32],
        }
    }
}
