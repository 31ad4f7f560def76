//! A question to a twin and its answer.

use super::{COEFFICIENTS_MAX, FIELD_SLOTS, GROUPS_MAX};
use iceoryx2::prelude::ZeroCopySend;

/// Numbers of [`Query::kind`]: what is asked.
pub mod query_kind {
    /// What if: pressure and gap are given; state and force are asked.
    pub const WHATIF: u32 = 1;
    /// The inverse: gap and force are given; the lowest pressure that gives this force is asked.
    pub const PRESSURE: u32 = 2;
    /// The explanation: pressure and a (measured) force are given; the gap that goes with them is asked.
    pub const GAP: u32 = 3;

    /// All kinds with their names, as in `softtwin/<actuator>/<name>?...`.
    pub const NAMES: &[(u32, &str)] = &[(WHATIF, "whatif"), (PRESSURE, "pressure"), (GAP, "gap")];

    /// The name of a kind.
    pub fn as_str(kind: u32) -> &'static str {
        NAMES.iter().find(|(number, _)| *number == kind).map_or("unknown", |(_, name)| name)
    }
}

/// One question. What the kind does not need stays NaN.
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend)]
#[type_name("softtwin.Query.v2")]
#[repr(C)]
pub struct Query {
    /// [`super::VERSION`].
    pub layout_version: u32,
    /// Number of [`query_kind`].
    pub kind: u32,
    /// 1: the field is wanted too, 0: the state is enough.
    pub want_field: u32,
    /// Zero.
    pub reserved: u32,
    /// Pressure, MPa.
    pub pressure_mpa: f64,
    /// Gap, mm.
    pub gap_mm: f64,
    /// Contact force, N: the target, or the measured one.
    pub force_n: f64,
    /// Half width of the measured force's own error bar, N; NaN or 0: exact.
    pub force_halfwidth_n: f64,
    /// Node set of the field that is wanted, zero-padded; empty or `all`: all nodes.
    pub node_set: [u8; 32],
}

super::layout!(Query, 80, {
    layout_version: 0,
    kind: 4,
    want_field: 8,
    reserved: 12,
    pressure_mpa: 16,
    gap_mm: 24,
    force_n: 32,
    force_halfwidth_n: 40,
    node_set: 48,
});

/// A question with nothing given.
impl Default for Query {
    fn default() -> Self {
        Self {
            layout_version: super::VERSION,
            kind: query_kind::WHATIF,
            want_field: 0,
            reserved: 0,
            pressure_mpa: f64::NAN,
            gap_mm: f64::NAN,
            force_n: f64::NAN,
            force_halfwidth_n: f64::NAN,
            node_set: [0; 32],
        }
    }
}

/// The answer; 768 bytes. The payload behind it is the field (`node_count x field_count` `f32`, field-major as on the field
/// topic), or empty when none was wanted.
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend)]
#[type_name("softtwin.Answer.v2")]
#[repr(C)]
pub struct Answer {
    /// [`super::VERSION`].
    pub layout_version: u32,
    /// Number of [`crate::QueryStatus`]: 0 answered, else the reason why there is no answer.
    pub verdict: u32,
    /// First 16 bytes of the model file's hash.
    pub model_hash: [u8; 16],
    /// The question's kind, number of [`query_kind`].
    pub kind: u32,
    /// Number of [`super::regime`].
    pub regime: u32,
    /// 0 inside, 1 near the edge, 2 outside the sampled states.
    pub domain_status: u32,
    /// Bits of [`super::flags`].
    pub flags: u32,
    /// What the answer took to compute, ns.
    pub compute_ns: u64,
    /// Pressure, MPa: given or found.
    pub pressure_mpa: f64,
    /// Gap, mm: given or found.
    pub gap_mm: f64,
    /// Contact force at that pressure and gap, N.
    pub contact_force_n: f64,
    /// Its gradient by the pressure, N/MPa.
    pub force_by_pressure_n_per_mpa: f64,
    /// Its gradient by the gap, N/mm.
    pub force_by_gap_n_per_mm: f64,
    /// Pressure of first contact at this gap, MPa; infinite when the plate is out of reach.
    pub onset_pressure_mpa: f64,
    /// Half width of the error bar of what was found (pressure in MPa, gap in mm); NaN for a what-if.
    pub uncertainty: f64,
    /// Lower end of what explains the question within the error bars, cut at the sampled states; NaN for a what-if.
    pub low: f64,
    /// Upper end.
    pub high: f64,
    /// The number that belongs to the verdict, see [`crate::QueryStatus`]; NaN when answered.
    pub limit: f64,
    /// Half width of the force's error bar, N.
    pub force_halfwidth_n: f32,
    /// Half width of the displacement's error bar, mm.
    pub displacement_halfwidth_mm: f32,
    /// Half width of the stress's error bar, MPa.
    pub von_mises_halfwidth_mpa: f32,
    /// Distance to the sampled states over inputs scaled to [0, 1]; 0 inside.
    pub domain_distance: f32,
    /// Coefficients in use.
    pub coefficient_count: u32,
    /// Nodes of the field; 0: none was wanted.
    pub node_count: u32,
    /// Fields of the field.
    pub field_count: u32,
    /// Node (number in the model) of the largest stress; `u32::MAX` without a field.
    pub max_von_mises_node: u32,
    /// Largest von Mises stress among the nodes of the field, MPa; NaN without a field.
    pub max_von_mises_mpa: f64,
    /// Which field is where: numbers of [`super::field_id`], the rest 0.
    pub field_ids: [u8; FIELD_SLOTS],
    /// Coefficients of each group, in the model's order; the rest 0.
    pub group_sizes: [u8; GROUPS_MAX],
    /// Modal coefficients, group by group; the rest 0.
    pub coefficients: [f32; COEFFICIENTS_MAX],
    /// Name of the node set of the field, zero-padded.
    pub node_set: [u8; 32],
    /// Name of the actuator, zero-padded.
    pub actuator: [u8; 32],
}

super::layout!(Answer, 768, {
    layout_version: 0,
    verdict: 4,
    model_hash: 8,
    kind: 24,
    regime: 28,
    domain_status: 32,
    flags: 36,
    compute_ns: 40,
    pressure_mpa: 48,
    gap_mm: 56,
    contact_force_n: 64,
    force_by_pressure_n_per_mpa: 72,
    force_by_gap_n_per_mm: 80,
    onset_pressure_mpa: 88,
    uncertainty: 96,
    low: 104,
    high: 112,
    limit: 120,
    force_halfwidth_n: 128,
    displacement_halfwidth_mm: 132,
    von_mises_halfwidth_mpa: 136,
    domain_distance: 140,
    coefficient_count: 144,
    node_count: 148,
    field_count: 152,
    max_von_mises_node: 156,
    max_von_mises_mpa: 160,
    field_ids: 168,
    group_sizes: 184,
    coefficients: 192,
    node_set: 704,
    actuator: 736,
});

impl Answer {
    /// Why there is no answer; `None`: there is one.
    pub fn refusal(&self) -> Option<String> {
        crate::QueryStatus::refusal(self)
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

/// An answer with nothing known.
impl Default for Answer {
    fn default() -> Self {
        Self {
            layout_version: super::VERSION,
            verdict: crate::QueryStatus::Answered.code(),
            model_hash: [0; 16],
            kind: query_kind::WHATIF,
            regime: super::regime::UNKNOWN,
            domain_status: 0,
            flags: 0,
            compute_ns: 0,
            pressure_mpa: f64::NAN,
            gap_mm: f64::NAN,
            contact_force_n: f64::NAN,
            force_by_pressure_n_per_mpa: f64::NAN,
            force_by_gap_n_per_mm: f64::NAN,
            onset_pressure_mpa: f64::NAN,
            uncertainty: f64::NAN,
            low: f64::NAN,
            high: f64::NAN,
            limit: f64::NAN,
            force_halfwidth_n: f32::NAN,
            displacement_halfwidth_mm: f32::NAN,
            von_mises_halfwidth_mpa: f32::NAN,
            domain_distance: f32::NAN,
            coefficient_count: 0,
            node_count: 0,
            field_count: 0,
            max_von_mises_node: u32::MAX,
            max_von_mises_mpa: f64::NAN,
            field_ids: [super::field_id::NONE; FIELD_SLOTS],
            group_sizes: [0; GROUPS_MAX],
            coefficients: [0.0; COEFFICIENTS_MAX],
            node_set: [0; 32],
            actuator: [0; 32],
        }
    }
}
