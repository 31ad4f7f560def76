//! Parts of a trained model.

use super::selection::ModelError;
use crate::body::ShapeLimits;
use crate::difference::FieldDifference;
use crate::halfwidths::{HalfWidths, LocalHalfWidths};
use crate::hull::TrainingRange;
use crate::inputs::{InputMap, InputSpec, Inputs};
use crate::interpolant::Interpolant;
use crate::kernel::Modes;
use crate::learned::LearnedMap;
use crate::regime::OnsetTable;
use crate::snapshots::{FieldKind, FieldSpec, Footprint, NodeSet, RegimeKind};
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::sync::Arc;

/// Everything small about a model: readable without touching the big blocks.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ModelHeader {
    /// Actuator (`pneunet`).
    pub actuator: String,
    /// Inputs in order: pressure, gap, then any others.
    pub inputs: Vec<InputSpec>,
    /// Output fields in order.
    pub fields: Vec<OutputField>,
    /// Nodes per field.
    pub node_count: usize,
    /// Regimes; at most one of each kind.
    pub regimes: Vec<RegimeModel>,
    /// Onset pressure over gap (with parameters: at their default values); `None` for a model of one regime.
    pub onset: Option<OnsetTable>,
    /// Pressure by which the onset must be undercut before the contact label is dropped, in MPa.
    pub hysteresis_mpa: f64,
    /// Named node sets.
    pub node_sets: Vec<NodeSet>,
    /// blake3 of the database it was trained on.
    pub database_hash: [u8; 32],
    /// Free model of the lowest nodes, from which an onset that depends on parameters is solved.
    pub clearance: Option<Clearance>,
    /// Limit of the pressure that `softtwin build` found; in the file a separate block ([`BlockKind::Limit`]).
    #[serde(skip)]
    pub limit: Option<PressureLimit>,
    /// Shapes that the body can have, from the mesh and the modes of the file ([`crate::model::ModelReader::body`]); `None` in a model that
    /// was not loaded from a file, or without a surface.
    #[serde(skip)]
    pub body: Option<Arc<ShapeLimits>>,
    /// Map of a model learned from measurements, which answers in place of the interpolants; in the file a separate block
    /// ([`BlockKind::Learned`]).
    #[serde(skip)]
    pub learned: Option<Arc<LearnedMap>>,
}

/// Where the search for the largest pressure ended when the actuator was built.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PressureLimit {
    /// Largest pressure, MPa.
    pub pressure_mpa: f64,
    /// Why there is no larger one.
    pub reason: String,
    /// Largest stretch that is possible: the end of the elastomers' laws, or the largest found if that is more.
    pub stretch: f64,
}

/// One output field and how it is computed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct OutputField {
    /// Name, unit, meaning.
    pub spec: FieldSpec,
    /// `Some(axes)`: derived as `|x - x0|` from the output fields at these positions.
    pub magnitude_of: Option<[usize; 3]>,
}

/// One regime of the model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RegimeModel {
    /// Free or in contact.
    pub kind: RegimeKind,
    /// Its inputs and their ranges.
    pub inputs: InputMap,
    /// POD groups; their coefficients follow one another in the regime's coefficient vector.
    pub groups: Vec<GroupModel>,
    /// Contact force; `None` in the free regime.
    pub force: Option<ForceModel>,
    /// Region of the inputs that the training states cover.
    pub domain: TrainingRange,
    /// Constant half-widths with the nominal coverage.
    pub halfwidths: HalfWidths,
    /// Half-widths that follow the error over the inputs; none in a model of an older version.
    pub local_halfwidths: Option<LocalHalfWidths>,
    /// Correction beyond the last onset state of the training; `None` without such gaps.
    pub far_onset: Option<FarOnset>,
    /// Measured difference; in the file a separate block ([`BlockKind::Difference`]).
    #[serde(skip)]
    pub difference: Option<FieldDifference>,
}

impl RegimeModel {
    /// The group that holds a field.
    pub fn group_of(&self, field: usize) -> Option<&GroupModel> {
        self.groups.iter().find(|group| group.fields.contains(&field))
    }
}

/// Keeps fields continuous across the onset where contact was not trained: a correction of the coefficients by gap,
/// `a(P, gap) = surrogate(P, gap) + d(gap)`. At every tabulated gap `d` is the free state at the onset, in contact modes,
/// minus the surrogate there; straight between. It begins with 0 at the last onset state that was trained on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FarOnset {
    /// Gaps in mm, strictly increasing, at least two.
    pub gap_mm: Vec<f64>,
    /// `gaps x coefficients`, all coefficients of a gap together.
    pub corrections: Vec<f64>,
}

impl FarOnset {
    /// Adds the correction of a gap to coefficients, and its slope to their derivatives with respect to the gap if present.
    /// `O(coefficients)`.
    pub fn correct(&self, gap_mm: f64, coefficients: &mut [f64], by_gap: &mut [f64]) {
        let last = self.gap_mm.len() - 1;
        if gap_mm.is_nan() || gap_mm <= self.gap_mm[0] {
            return;
        }
        let i = self.gap_mm.partition_point(|g| *g <= gap_mm).clamp(1, last) - 1;
        let width = self.gap_mm[i + 1] - self.gap_mm[i];
        let share = ((gap_mm - self.gap_mm[i]) / width).min(1.0); // beyond the reach nothing touches
        let (count, held) = (coefficients.len(), gap_mm > self.gap_mm[last]);
        let row = |i: usize| &self.corrections[i * count..(i + 1) * count];
        for ((a, low), high) in coefficients.iter_mut().zip(row(i)).zip(row(i + 1)) {
            *a += low + share * (high - low);
        }
        for ((d, low), high) in by_gap.iter_mut().zip(row(i)).zip(row(i + 1)) {
            *d += if held { 0.0 } else { (high - low) / width };
        }
    }
}

/// Data of the onset solver of a model with parameters (`clearance.rs`): heights of the nodes that can be the lowest, in
/// the free model's modes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Clearance {
    /// Largest training pressure in MPa: up to here the free model is asked.
    pub max_pressure_mpa: f64,
    /// Continuation of the onset below the sag, see [`OnsetTable::bend_per_mm`].
    pub bend_per_mm: f64,
    /// Group of the free regime that holds the height.
    pub group: usize,
    /// Mean height by node, mm.
    pub mean_mm: Vec<f64>,
    /// `nodes x modes`: the modes of the height, all of a node together.
    pub modes: Vec<f64>,
}

/// Contact force of a regime. Near the onset it grows in proportion to `P - P_c(gap)`; what is interpolated there is the
/// smooth factor `h`, so that `F = (P - P_c(gap)) h(P, gap)` vanishes on the onset exactly.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ForceModel {
    /// Interpolant of `h` in N/MPa, or of the force itself in N.
    pub surrogate: Interpolant,
    /// True if the interpolant is the factor of `P - P_c(gap)`.
    pub times_excess_pressure: bool,
}

/// One POD group of a regime.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GroupModel {
    /// Name (`x`, `von_mises`, `joint`).
    pub name: String,
    /// Output fields it covers.
    pub fields: Vec<usize>,
    /// Range of its coefficients in the regime's coefficient vector.
    pub coefficients: Range<usize>,
    /// Inputs to coefficients.
    pub surrogate: Interpolant,
    /// All singular values of the (centred) snapshot matrix in the order of the modes; of a basis that goes on from that of the free
    /// regime the root mean squares of the coefficients times the root of their number.
    pub singular_values: Vec<f64>,
}

impl GroupModel {
    /// Share of the snapshots' energy beyond the first `modes` (Eq. 4).
    pub fn truncation_error(&self, modes: usize) -> f64 {
        truncation_error(&self.singular_values, modes)
    }
}

/// Truncation error of Eq. (4), summed from the small end so that 1e-16 is still seen: the paper's `1 - sum/sum`
/// cannot show less than rounding.
pub fn truncation_error(singular_values: &[f64], modes: usize) -> f64 {
    let tail: f64 = singular_values.iter().skip(modes).rev().map(|s| s * s).sum();
    let head: f64 = singular_values.iter().take(modes).rev().map(|s| s * s).sum();
    if tail + head > 0.0 { tail / (tail + head) } else { 0.0 }
}

/// Content of a block of numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum BlockKind {
    /// Mean of an output field in a regime: `node_count` f32.
    Mean {
        /// Regime whose field this is.
        regime: RegimeKind,
        /// Position in [`ModelHeader::fields`].
        field: u32,
    },
    /// Modes of an output field in a regime ([`Modes`]).
    Modes {
        /// Regime whose field this is.
        regime: RegimeKind,
        /// Position in [`ModelHeader::fields`].
        field: u32,
    },
    /// Undeformed coordinate along an axis: `node_count` f32 in mm.
    Undeformed(u8),
    /// Surface triangles: `3 x triangles` u32.
    Surface,
    /// Change of the undeformed coordinate along an axis per unit of an input: `node_count` f32 in mm per unit.
    UndeformedBy {
        /// Position of the input.
        input: u32,
        /// 0 to 2: x, y or z.
        axis: u8,
        /// Bits (f64) of the input's value at which the mesh is the undeformed one.
        from_bits: u64,
    },
    /// Quantities of the deformed shape ([`crate::observable`]): a record.
    Observables,
    /// Half-width of a field of a model learned from measurements: `node_count` f32 in its unit.
    HalfWidth {
        /// Position in [`ModelHeader::fields`].
        field: u32,
    },
    /// Record of the reduced inertia of a model that moves.
    Inertia,
    /// Memory of the inputs ([`crate::memory::MemorySpec`]); absent in a static model.
    Memory,
    /// Measured differences of the fields ([`FieldDifference`]), with their regimes; absent in a model of finite elements alone.
    Difference,
    /// Limit of the pressure ([`PressureLimit`]); absent in a model that was not built.
    Limit,
    /// Map of a model learned from measurements ([`LearnedMap`]); absent in other models.
    Learned,
}

impl BlockKind {
    /// True for values of any structure instead of numbers.
    pub const fn is_record(self) -> bool {
        matches!(
            self,
            Self::Observables | Self::Inertia | Self::Memory | Self::Difference | Self::Limit | Self::Learned
        )
    }
}

/// A block's numbers.
#[derive(Clone, Debug, PartialEq)]
pub enum BlockData {
    /// 32-bit floats.
    F32(Vec<f32>),
    /// Node indices.
    U32(Vec<u32>),
    /// Modes in kernel order.
    Modes(Modes),
    /// An encoded value: what few models have, so that the header of the others does not change ([`Model::record`]).
    Record(Vec<u8>),
}

/// A trained model in memory.
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    /// Everything small.
    pub header: ModelHeader,
    /// The big blocks that were loaded.
    pub blocks: Vec<(BlockKind, BlockData)>,
}

impl Model {
    /// The regime's part, if the model has it.
    pub fn regime(&self, kind: RegimeKind) -> Option<&RegimeModel> {
        self.header.regimes.iter().find(|r| r.kind == kind)
    }

    /// True if the model was learned from measurements alone.
    pub fn is_measured(&self) -> bool {
        self.blocks.iter().any(|(kind, _)| matches!(kind, BlockKind::HalfWidth { .. }))
    }

    /// A block of floats, if it was loaded.
    pub fn f32_block(&self, kind: BlockKind) -> Option<&[f32]> {
        self.blocks.iter().find_map(|(k, data)| match data {
            BlockData::F32(values) if *k == kind => Some(values.as_slice()),
            _ => None,
        })
    }

    /// Coordinates x, y and z of the undeformed nodes (mm); `None` if they were not loaded or the model has none.
    pub fn undeformed_mm(&self) -> Option<[&[f32]; 3]> {
        let axis = |axis| self.f32_block(BlockKind::Undeformed(axis));
        Some([axis(0)?, axis(1)?, axis(2)?])
    }

    /// The undeformed nodes (mm), as [`Self::undeformed_mm`].
    pub fn undeformed_nodes_mm(&self) -> Option<Vec<[f32; 3]>> {
        let [x, y, z] = self.undeformed_mm()?;
        Some(x.iter().zip(y).zip(z).map(|((x, y), z)| [*x, *y, *z]).collect())
    }

    /// Extent of a plate below the undeformed nodes, for pictures; the paper's where the model has no mesh.
    pub fn plate(&self) -> Footprint {
        self.undeformed_nodes_mm()
            .and_then(|nodes| Footprint::plate_below(&nodes))
            .unwrap_or(Footprint::PLATE)
    }

    /// Facets of the surface, cavities included; empty when unknown.
    pub fn facets(&self) -> &[[u32; 3]] {
        self.u32_block(BlockKind::Surface).unwrap_or(&[]).as_chunks().0
    }

    /// The mean of an output field in a regime: its own, or the other regime's, with which it shares the basis.
    pub fn mean(&self, regime: RegimeKind, field: u32) -> Option<&[f32]> {
        regime.with_other().into_iter().find_map(|regime| self.f32_block(BlockKind::Mean { regime, field }))
    }

    /// The modes of an output field in a regime, at least as many as its group has. A regime without its own shares those of the other:
    /// the free regime needs the first of contact's modes.
    ///
    /// # Errors
    /// [`ModelError::MissingBlock`] when they were not loaded or do not fit the header.
    pub fn modes(&self, regime: RegimeKind, field: u32) -> Result<&Modes, ModelError> {
        let kind = BlockKind::Modes { regime, field };
        let of_regime = |regime| {
            let kind = BlockKind::Modes { regime, field };
            self.blocks.iter().find_map(|(k, data)| match data {
                BlockData::Modes(modes) if *k == kind => Some(modes),
                _ => None,
            })
        };
        let found = regime.with_other().into_iter().find_map(of_regime);
        let group = self.regime(regime).and_then(|regime| regime.group_of(field as usize));
        let expected = group.map_or(0, |group| group.coefficients.len());
        let nodes = self.header.node_count;
        found.filter(|modes| modes.count() >= expected && modes.nodes() == nodes).ok_or_else(|| {
            ModelError::MissingBlock {
                block: format!("{kind:?}"),
                expected: expected * nodes,
                found: found.map_or(0, |modes| modes.count() * modes.nodes()),
            }
        })
    }

    /// Which output of a model learned from measurements a field has at a node, if the model has that node; its modes must be loaded.
    pub fn learned_output(&self, field: usize, node: usize) -> Option<usize> {
        self.header.learned.as_ref()?;
        let modes = self.modes(RegimeKind::Free, field as u32).ok().filter(|modes| node < modes.nodes())?;
        (0..modes.count()).find(|mode| modes.value(*mode, node) != 0.0)
    }

    /// Name and number of the outputs of a model learned from measurements that are no marker's coordinates, such as an angle or a force;
    /// their modes must be loaded. Empty for other models.
    pub fn learned_scalars(&self) -> Vec<(String, usize)> {
        let fields = self.header.fields.iter().enumerate();
        let scalars = fields.filter(|(_, field)| !matches!(field.spec.kind, FieldKind::Coordinate(_)));
        let output =
            |(at, field): (usize, &OutputField)| Some((field.spec.name.clone(), self.learned_output(at, 0)?));
        scalars.filter_map(output).collect()
    }

    /// Displacement of the undeformed nodes from the model's mesh by these inputs, per axis (mm). `None` if no input moves them.
    /// `O(nodes x inputs that move them)`.
    pub fn moved_mm(&self, inputs: &Inputs) -> Option<[Vec<f32>; 3]> {
        let mut moved: Option<[Vec<f32>; 3]> = None;
        for (kind, data) in &self.blocks {
            let (BlockKind::UndeformedBy { input, axis, from_bits }, BlockData::F32(by)) = (kind, data)
            else {
                continue;
            };
            let all = moved.get_or_insert_with(|| [0, 1, 2].map(|_| vec![0.0; self.header.node_count]));
            // A file may name what no model has.
            let found = inputs.values().get(*input as usize).zip(all.get_mut(usize::from(*axis)));
            let Some((value, along)) = found else { continue };
            let step = (value - f64::from_bits(*from_bits)) as f32;
            along.iter_mut().zip(by).for_each(|(to, by)| *to += step * by);
        }
        moved
    }

    /// A block of indices, if it was loaded.
    pub fn u32_block(&self, kind: BlockKind) -> Option<&[u32]> {
        self.blocks.iter().find_map(|(k, data)| match data {
            BlockData::U32(values) if *k == kind => Some(values.as_slice()),
            _ => None,
        })
    }
}
