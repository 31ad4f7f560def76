//! Description of a basis from plain slices, and the order of work inside a tile that follows from it.

use std::ops::Range;

use thiserror::Error;

use super::modes::Modes;
use super::{MAX_ROWS, TILE_NODES};

/// `mean + modes · coefficients[range]`: one field of one POD group.
#[derive(Debug, Clone)]
pub struct Affine<'a> {
    /// Mean of the snapshots, one value per node; `None` for an uncentred basis.
    pub mean: Option<&'a [f32]>,
    /// Modes of the field, at least as many as `coefficients` is long: the first ones are used.
    pub modes: &'a Modes,
    /// Part of the coefficient vector. Fields of a joint POD name the same range.
    pub coefficients: Range<usize>,
}

/// Change of the undeformed coordinates with one more coefficient.
#[derive(Debug, Clone)]
pub struct Shift<'a> {
    /// Index in the coefficient vector.
    pub coefficient: usize,
    /// Change of x, y, z per unit of the coefficient, one value per node; `None` for no change.
    pub axes: [Option<&'a [f32]>; 3],
}

/// Origin of a field.
#[derive(Debug, Clone)]
pub enum FieldSource<'a> {
    /// A linear combination of modes.
    Affine(Affine<'a>),
    /// `|x - x0 - sum_i shift_i coefficient_i|` of three affine fields.
    Magnitude {
        /// Indices of x, y, z in [`Spec::fields`].
        coordinates: [usize; 3],
        /// Undeformed x, y, z, one value per node.
        rest: [&'a [f32]; 3],
        /// Changes of the undeformed coordinates.
        shifts: Vec<Shift<'a>>,
    },
}

/// Meaning of a field, as far as the kernel must know.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// Written as computed: coordinates, displacement components, strains.
    Plain,
    /// Displacement magnitude, mm: at least 0, its maximum is reported.
    Displacement,
    /// Von Mises stress, MPa: at least 0, its maximum is reported.
    Stress,
}

/// One field of a basis.
#[derive(Debug, Clone)]
pub struct Field<'a> {
    /// From which modes the field is summed, or from which fields it is derived.
    pub source: FieldSource<'a>,
    /// What its values are, and so which of them are reported.
    pub role: Role,
    /// True if the field is published. A coordinate that is not published is still computed when a published magnitude needs
    /// it, and costs nothing otherwise.
    pub published: bool,
}

/// Description of a basis: its fields in the order of output, and its nodes.
#[derive(Debug, Clone)]
pub struct Spec<'a> {
    /// Nodes of the model: the length of each mean and of each mode.
    pub node_count: usize,
    /// Nodes to compute, in the order of output; `None` for all. Indices may repeat.
    pub nodes: Option<&'a [u32]>,
    /// Fields in the order of output.
    pub fields: Vec<Field<'a>>,
}

/// Undeformed coordinate along an axis, and its changes with entries of the coefficient vector.
type Rest<'a> = (&'a [f32], Vec<(usize, &'a [f32])>);

impl<'a> Spec<'a> {
    /// The undeformed coordinate that a magnitude measures an affine field from.
    fn rest_of(&self, field: usize) -> Option<Rest<'a>> {
        self.fields.iter().find_map(|other| {
            let FieldSource::Magnitude { coordinates, rest, shifts } = &other.source else { return None };
            let axis = coordinates.iter().position(|&c| c == field)?;
            let along = |shift: &Shift<'a>| Some((shift.coefficient, shift.axes[axis]?));
            Some((rest[axis], shifts.iter().filter_map(along).collect()))
        })
    }

    /// Nodes that will be computed.
    pub fn output_nodes(&self) -> usize {
        self.nodes.map_or(self.node_count, <[u32]>::len)
    }

    /// Index in the model of output node `i`.
    pub fn source_node(&self, i: usize) -> usize {
        self.nodes.map_or(i, |nodes| nodes[i] as usize)
    }
}

/// Why a basis cannot be built.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
#[allow(missing_docs)] // the messages say what the values are
pub enum BasisError {
    /// No node, or more than the kernel can number.
    #[error("the node set has {found} nodes; expected 1 to {}", i32::MAX)]
    NodeCount { found: usize },
    /// A node index beyond the model.
    #[error("node {node} is not in the model, which has nodes 0 to {last}; correct the node set", last = .node_count - 1)]
    NodeIndex { node: u32, node_count: usize },
    /// Nothing to publish.
    #[error("no field is published; ask for at least one")]
    NothingPublished,
    /// A slice of the wrong length.
    #[error("field {field}: {what} has {found} values; expected {expected}")]
    Length { field: usize, what: &'static str, found: usize, expected: usize },
    /// A magnitude that refers to something other than an affine field, or a second magnitude.
    #[error(
        "field {field}: a magnitude needs three different affine fields, and a basis takes one magnitude"
    )]
    Magnitude { field: usize },
    /// Two fields whose maximum would be reported under one name.
    #[error("field {field} is the second of role {role:?}; expected one")]
    DuplicateRole { field: usize, role: Role },
    /// Too many rows for the stack.
    #[error("the fields need {found} modes and shifts; expected at most {}", super::MAX_ROWS)]
    Rows { found: usize },
    /// NaN or infinity, or a value beyond f32.
    #[error("field {field}, node {node}: {value} cannot be stored as f32; the model is damaged")]
    NotFinite { field: usize, node: usize, value: f64 },
    /// An instruction set this processor does not have.
    #[error("this processor has no {isa}; let the kernel choose (it would take {detected})")]
    IsaMissing { isa: super::Isa, detected: super::Isa },
}

/// One affine field inside a tile: the rows it reads, in this order, and the use of the result.
#[derive(Debug, Clone)]
pub(crate) struct Op {
    /// Index in the spec.
    pub field: usize,
    /// First entry in the coefficient vector.
    pub first_coefficient: usize,
    /// Modes in use.
    pub modes: usize,
    /// A constant row with the mean comes first, minus the undeformed shape for a component of the displacement.
    pub has_mean: bool,
    /// Behind it a constant row for each shift of the undeformed coordinate: its entry in the coefficient vector.
    pub shifts: Vec<usize>,
    /// A constant row with the undeformed coordinate comes last.
    pub has_rest: bool,
    /// The result before the rest row is added is a component of the displacement.
    pub in_magnitude: bool,
    /// Index of the published field to which it is written.
    pub slot: Option<usize>,
    /// Clamp and peak.
    pub role: Role,
}

impl Op {
    /// Least length of the coefficient vector that it needs.
    fn coefficients(&self) -> usize {
        let shifted = self.shifts.iter().max().map_or(0, |last| last + 1);
        shifted.max(self.first_coefficient + self.modes)
    }

    /// Rows with a factor.
    fn factors(&self) -> usize {
        self.modes + self.shifts.len()
    }

    /// Rows of f32 besides its modes.
    fn constants(&self) -> usize {
        usize::from(self.has_mean) + self.shifts.len() + usize::from(self.has_rest)
    }
}

/// The order of work inside a tile, the same for all tiles of a basis.
#[derive(Debug, Clone)]
pub(crate) struct Plan {
    /// Affine fields in the order of their rows.
    pub ops: Vec<Op>,
    /// Index of the published displacement magnitude.
    pub magnitude_slot: Option<usize>,
    /// Constant rows per tile: means, shifts and rest coordinates, in the order of the ops.
    pub constants: usize,
    /// Modes and shifts: factors of a reconstruction.
    pub factors: usize,
    /// Published fields.
    pub published: usize,
    /// Output nodes.
    pub nodes: usize,
    /// Least length of the coefficient vector.
    pub coefficients: usize,
}

impl Plan {
    /// Checks the spec and lays out the work.
    pub(crate) fn new(spec: &Spec<'_>) -> Result<Self, BasisError> {
        check_nodes(spec)?;
        check_lengths(spec)?;
        check_roles(spec)?;
        let magnitude = published_magnitude(spec)?;
        let coordinates = magnitude.map_or([usize::MAX; 3], |(_, coordinates)| coordinates);

        let mut slots = 0;
        let mut ops = Vec::new();
        let mut magnitude_slot = None;
        for (index, field) in spec.fields.iter().enumerate() {
            let slot = field.published.then_some(slots);
            slots += usize::from(field.published);
            match &field.source {
                FieldSource::Magnitude { .. } => magnitude_slot = magnitude_slot.or(slot),
                FieldSource::Affine(affine) => {
                    let in_magnitude = coordinates.contains(&index);
                    if slot.is_some() || in_magnitude {
                        ops.push(op(spec, index, affine, slot, in_magnitude));
                    }
                }
            }
        }
        let plan = Self {
            constants: ops.iter().map(Op::constants).sum(),
            factors: ops.iter().map(Op::factors).sum(),
            coefficients: ops.iter().map(Op::coefficients).max().unwrap_or(0),
            published: slots,
            nodes: spec.output_nodes(),
            magnitude_slot,
            ops,
        };
        match (slots, plan.factors) {
            (0, _) => Err(BasisError::NothingPublished),
            (_, found) if found > MAX_ROWS => Err(BasisError::Rows { found }),
            _ => Ok(plan),
        }
    }

    /// Tiles, the last one padded.
    pub(crate) fn tiles(&self) -> usize {
        self.nodes.div_ceil(TILE_NODES)
    }

    /// Length of the output.
    pub(crate) fn entries(&self) -> usize {
        self.published * self.nodes
    }

    /// Values of every constant row over the output nodes, in the order of the ops.
    ///
    /// # Errors
    /// [`BasisError::NotFinite`].
    pub(crate) fn constant_rows(&self, spec: &Spec<'_>) -> Result<Vec<Vec<f32>>, BasisError> {
        let mut rows = Vec::new();
        for op in &self.ops {
            let FieldSource::Affine(affine) = &spec.fields[op.field].source else { continue };
            let (rest, shifts) = spec.rest_of(op.field).filter(|_| op.in_magnitude).unzip();
            let value_at = |values: Option<&[f32]>, node: usize| values.map_or(0.0, |v| f64::from(v[node]));
            let mut push = |value: &dyn Fn(usize) -> f64| {
                let finite = |i| {
                    let node = spec.source_node(i);
                    let value = value(node);
                    let is_finite = (value as f32).is_finite();
                    if is_finite {
                        Ok(value as f32)
                    } else {
                        Err(BasisError::NotFinite { field: op.field, node, value })
                    }
                };
                rows.push((0..spec.output_nodes()).map(finite).collect::<Result<Vec<f32>, _>>()?);
                Ok(())
            };
            if op.has_mean {
                push(&|node| value_at(affine.mean, node) - value_at(rest, node))?;
            }
            for (_, by) in shifts.iter().flatten() {
                push(&|node| f64::from(by[node]))?;
            }
            if op.has_rest {
                push(&|node| value_at(rest, node))?;
            }
        }
        Ok(rows)
    }
}

/// A component of the displacement is summed relative to the rest shape, so that small displacements keep their digits;
/// the rest row is added where the coordinate itself is published.
fn op(spec: &Spec<'_>, index: usize, affine: &Affine<'_>, slot: Option<usize>, in_magnitude: bool) -> Op {
    let moves = spec.rest_of(index).filter(|_| in_magnitude).map(|(_, shifts)| shifts);
    Op {
        field: index,
        first_coefficient: affine.coefficients.start,
        modes: affine.coefficients.len(),
        has_mean: affine.mean.is_some() || in_magnitude,
        shifts: moves.into_iter().flatten().map(|(coefficient, _)| coefficient).collect(),
        has_rest: in_magnitude && slot.is_some(),
        in_magnitude,
        slot,
        role: spec.fields[index].role,
    }
}

fn check_nodes(spec: &Spec<'_>) -> Result<(), BasisError> {
    let found = spec.output_nodes();
    // Tile numbers travel through float registers as bit patterns, node numbers through u32.
    if found == 0 || found > i32::MAX as usize || spec.node_count > i32::MAX as usize {
        return Err(BasisError::NodeCount { found });
    }
    let node_count = spec.node_count;
    match spec.nodes.and_then(|nodes| nodes.iter().find(|&&node| node as usize >= node_count)) {
        Some(&node) => Err(BasisError::NodeIndex { node, node_count }),
        None => Ok(()),
    }
}

fn check_lengths(spec: &Spec<'_>) -> Result<(), BasisError> {
    let n = spec.node_count;
    let expect = |field, what, found: usize, expected: usize, fits: bool| {
        if fits { Ok(()) } else { Err(BasisError::Length { field, what, found, expected }) }
    };
    for (index, field) in spec.fields.iter().enumerate() {
        match &field.source {
            FieldSource::Affine(Affine { mean, modes, coefficients }) => {
                if let Some(mean) = mean {
                    expect(index, "the mean", mean.len(), n, mean.len() == n)?;
                }
                expect(index, "a mode", modes.nodes(), n, modes.nodes() == n)?;
                let (found, needed) = (modes.count(), coefficients.len());
                expect(index, "the list of modes", found, needed, found >= needed)?;
            }
            FieldSource::Magnitude { rest, shifts, .. } => {
                let moves = shifts.iter().flat_map(|shift| shift.axes.iter().flatten());
                for axis in rest.iter().chain(moves) {
                    expect(index, "the undeformed coordinate", axis.len(), n, axis.len() == n)?;
                }
            }
        }
    }
    Ok(())
}

fn check_roles(spec: &Spec<'_>) -> Result<(), BasisError> {
    for role in [Role::Displacement, Role::Stress] {
        let mut of_role = spec.fields.iter().enumerate().filter(|(_, field)| effective_role(field) == role);
        if let Some((field, _)) = of_role.nth(1) {
            return Err(BasisError::DuplicateRole { field, role });
        }
    }
    Ok(())
}

/// A magnitude is a displacement whatever the spec calls it.
fn effective_role(field: &Field<'_>) -> Role {
    match field.source {
        FieldSource::Magnitude { .. } => Role::Displacement,
        FieldSource::Affine(_) => field.role,
    }
}

/// The published magnitude, if there is one: its index and its coordinates.
fn published_magnitude(spec: &Spec<'_>) -> Result<Option<(usize, [usize; 3])>, BasisError> {
    let mut found = None;
    for (index, field) in spec.fields.iter().enumerate() {
        let FieldSource::Magnitude { coordinates: [x, y, z], .. } = &field.source else { continue };
        let affine =
            |i: &usize| matches!(spec.fields.get(*i).map(|f| &f.source), Some(FieldSource::Affine(_)));
        let distinct = x != y && y != z && x != z;
        if found.is_some() || !distinct || ![x, y, z].into_iter().all(affine) {
            return Err(BasisError::Magnitude { field: index });
        }
        found = Some((index, [*x, *y, *z], field.published));
    }
    Ok(found.filter(|&(_, _, published)| published).map(|(index, coordinates, _)| (index, coordinates)))
}
