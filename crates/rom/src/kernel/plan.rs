//! From a [`Spec`] to the order of work inside a tile.

use std::ops::Range;

use super::spec::{Affine, BasisError, Field, Role, Source, Spec};
use super::{MAX_ROWS, TILE_NODES};

/// One affine field inside a tile: the rows it reads, in this order, and what becomes of the result.
#[derive(Debug, Clone)]
pub(super) struct Op {
    /// Index in the spec.
    pub field: usize,
    /// First entry in the coefficient vector.
    pub first_coefficient: usize,
    /// Rows of modes.
    pub modes: usize,
    /// A row with the mean comes first; less the rest shape for a component of the displacement.
    pub has_mean: bool,
    /// Behind the modes a row for each shift of the undeformed coordinate: its entry in the coefficient vector.
    pub shifts: Vec<usize>,
    /// A row with the undeformed coordinate comes last.
    pub has_rest: bool,
    /// The result before the rest row is added is a component of the displacement.
    pub in_magnitude: bool,
    /// Which of the published fields it is written to.
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

    /// Which coefficient each of its rows is multiplied by; none for means and the rest shape.
    pub(super) fn coefficients_of_rows(&self) -> impl Iterator<Item = Option<usize>> {
        let modes = (0..self.modes).map(|j| Some(self.first_coefficient + j));
        let mean = std::iter::repeat_n(None, usize::from(self.has_mean));
        let rest = std::iter::repeat_n(None, usize::from(self.has_rest));
        mean.chain(modes).chain(self.shifts.iter().map(|&at| Some(at))).chain(rest)
    }

    /// Its rows in the lists that a sweep adds up one after the other: mean and modes, shifts, rest row.
    pub(super) fn lists(&self) -> impl Iterator<Item = Range<usize>> {
        let sum = usize::from(self.has_mean) + self.modes;
        let moved = sum + self.shifts.len();
        let shifts = self.in_magnitude.then_some(sum..moved);
        std::iter::once(0..sum).chain(shifts).chain(self.has_rest.then_some(moved..moved + 1))
    }

    /// Rows it reads.
    fn rows(&self) -> usize {
        usize::from(self.has_mean) + self.modes + self.shifts.len() + usize::from(self.has_rest)
    }
}

/// The order of work inside a tile, the same for all tiles of a basis.
#[derive(Debug, Clone)]
pub(super) struct Plan {
    /// Affine fields in the order of their rows.
    pub ops: Vec<Op>,
    /// Which published field takes the displacement magnitude.
    pub magnitude_slot: Option<usize>,
    /// Rows a tile: means, modes and rest coordinates.
    pub rows: usize,
    /// Published fields.
    pub published: usize,
    /// Output nodes.
    pub nodes: usize,
    /// Least length of the coefficient vector.
    pub coefficients: usize,
}

impl Plan {
    /// Checks the spec and lays out the work.
    pub(super) fn new(spec: &Spec<'_>) -> Result<Self, BasisError> {
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
                Source::Magnitude { .. } => magnitude_slot = magnitude_slot.or(slot),
                Source::Affine(affine) => {
                    let in_magnitude = coordinates.contains(&index);
                    if slot.is_some() || in_magnitude {
                        ops.push(op(spec, index, affine, slot, in_magnitude));
                    }
                }
            }
        }
        let plan = Self {
            rows: ops.iter().map(Op::rows).sum(),
            coefficients: ops.iter().map(Op::coefficients).max().unwrap_or(0),
            published: slots,
            nodes: spec.output_nodes(),
            magnitude_slot,
            ops,
        };
        match (slots, plan.rows) {
            (0, _) => Err(BasisError::NothingPublished),
            (_, found) if found > MAX_ROWS => Err(BasisError::Rows { found }),
            _ => Ok(plan),
        }
    }

    /// Tiles, the last one padded.
    pub(super) fn tiles(&self) -> usize {
        self.nodes.div_ceil(TILE_NODES)
    }

    /// Length of the output.
    pub(super) fn entries(&self) -> usize {
        self.published * self.nodes
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
            Source::Affine(affine) => {
                if let Some(mean) = &affine.mean {
                    expect(index, "the mean", mean.len(), n, mean.len() == n)?;
                }
                expect(index, "the stride between modes", affine.stride, n, affine.stride >= n)?;
                let modes = affine.coefficients.len();
                let needed = modes
                    .checked_sub(1)
                    .map_or(0, |last| last.saturating_mul(affine.stride).saturating_add(n));
                expect(index, "the mode matrix", affine.modes.len(), needed, affine.modes.len() >= needed)?;
            }
            Source::Magnitude { rest, shifts, .. } => {
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
        Source::Magnitude { .. } => Role::Displacement,
        Source::Affine(_) => field.role,
    }
}

/// The published magnitude, if there is one: its index and its coordinates.
fn published_magnitude(spec: &Spec<'_>) -> Result<Option<(usize, [usize; 3])>, BasisError> {
    let mut found = None;
    for (index, field) in spec.fields.iter().enumerate() {
        let Source::Magnitude { coordinates: [x, y, z], .. } = &field.source else { continue };
        let affine = |i: &usize| matches!(spec.fields.get(*i).map(|f| &f.source), Some(Source::Affine(_)));
        let distinct = x != y && y != z && x != z;
        if found.is_some() || !distinct || ![x, y, z].into_iter().all(affine) {
            return Err(BasisError::Magnitude { field: index });
        }
        found = Some((index, [*x, *y, *z], field.published));
    }
    Ok(found.filter(|&(_, _, published)| published).map(|(index, coordinates, _)| (index, coordinates)))
}
