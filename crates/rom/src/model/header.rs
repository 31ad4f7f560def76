//! What a trained model consists of.

use crate::halfwidths::{HalfWidths, LocalHalfWidths};
use crate::hull::Domain;
use crate::inputs::{InputMap, InputSpec, Inputs};
use crate::interpolant::Interpolant;
use crate::regime::OnsetTable;
use crate::snapshots::{FieldSpec, NodeSet, RegimeKind};
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Everything small about a model: readable without touching the big blocks.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ModelHeader {
    /// Actuator (`pneunet`).
    pub actuator: String,
    /// Inputs in order: pressure, gap, then any others.
    pub inputs: Vec<InputSpec>,
    /// Output fields in order.
    pub fields: Vec<OutputField>,
    /// Nodes a field.
    pub node_count: usize,
    /// Regimes; at most one of each kind.
    pub regimes: Vec<RegimeModel>,
    /// Onset pressure over gap (with parameters: at their values in use); none for a model of one regime.
    pub onset: Option<OnsetTable>,
    /// Pressure by which the onset must be undercut before the contact label is dropped, in MPa.
    pub hysteresis_mpa: f64,
    /// Named node sets.
    pub node_sets: Vec<NodeSet>,
    /// blake3 of the database it was trained on.
    pub database_hash: [u8; 32],
    /// What the onset is solved from where it depends on parameters. The file keeps it apart (`further.rs`).
    #[serde(skip)]
    pub clearance: Option<Clearance>,
}

/// One output field and how its values come about.
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
    /// Which.
    pub kind: RegimeKind,
    /// Its inputs and their ranges.
    pub inputs: InputMap,
    /// POD groups; their coefficients follow one another in the regime's coefficient vector.
    pub groups: Vec<GroupModel>,
    /// Contact force; none where nothing is touched.
    pub force: Option<ForceModel>,
    /// Where it was trained.
    pub domain: Domain,
    /// Half-widths that cover the stated share of states, the same everywhere.
    pub halfwidths: HalfWidths,
    /// Half-widths that follow the error over the inputs; none in a model of an older version.
    pub local_halfwidths: Option<LocalHalfWidths>,
    /// Contact beyond the last onset state that was trained on; none where there is no such gap.
    pub far_onset: Option<FarOnset>,
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
    /// Adds the correction of a gap to coefficients, and its slope to their derivatives by gap where there are any.
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

/// What the onset of a model with parameters is solved from (`clearance.rs`): heights of the nodes that can be the lowest, in
/// the free model's modes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Clearance {
    /// Largest training pressure in MPa: up to here the free model is asked.
    pub max_pressure_mpa: f64,
    /// How the onset goes on below the sag, see [`OnsetTable::bend_per_mm`].
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
    /// Whether the interpolant is the factor of `P - P_c(gap)`.
    pub times_excess_pressure: bool,
}

/// One POD group of a regime.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GroupModel {
    /// Name (`x`, `von_mises`, `joint`).
    pub name: String,
    /// Output fields it covers.
    pub fields: Vec<usize>,
    /// Where its coefficients lie in the regime's coefficient vector.
    pub coefficients: Range<usize>,
    /// Inputs to coefficients.
    pub surrogate: Interpolant,
    /// All singular values of the (centred) snapshot matrix, largest first.
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

/// What a block of numbers is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum BlockKind {
    /// Mean of an output field in a regime: `node_count` f32.
    Mean {
        /// Regime.
        regime: RegimeKind,
        /// Output field.
        field: u32,
    },
    /// Modes of an output field in a regime: `modes x node_count` f32, one mode after the other.
    Modes {
        /// Regime.
        regime: RegimeKind,
        /// Output field.
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
        /// Axis.
        axis: u8,
        /// Bits (f64) of the input's value at which the mesh is the undeformed one.
        from_bits: u64,
    },
}

/// A block's numbers.
#[derive(Clone, Debug, PartialEq)]
pub enum BlockData {
    /// 32-bit floats.
    F32(Vec<f32>),
    /// Node indices.
    U32(Vec<u32>),
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

    /// A block of floats, if it was loaded.
    pub fn f32_block(&self, kind: BlockKind) -> Option<&[f32]> {
        self.blocks.iter().find_map(|(k, data)| match data {
            BlockData::F32(values) if *k == kind => Some(values.as_slice()),
            _ => None,
        })
    }

    /// How far these inputs move the undeformed nodes from the model's own mesh, by axis (mm). None where no input does.
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
