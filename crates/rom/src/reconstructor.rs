//! Coefficients -> fields, for one selection of fields and nodes. Nothing is allocated after construction.

use crate::evaluation::{Evaluation, Refusal};
use crate::kernel::plan::Plan;
use crate::kernel::sweep::{self, RawPeaks, Rows};
use crate::kernel::{
    Affine, BasisError, Field, FieldSource, Isa, MAX_ROWS, Modes, NotFinite, Precision, Role, Shift, Spec,
};
use crate::model::{BlockKind, Model, ModelError, RegimeModel, Selection};
use crate::snapshots::{FieldKind, RegimeKind};
use std::mem::MaybeUninit;
use thiserror::Error;

/// Largest value of a field and its node.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Peak {
    /// The value, in the unit of its field.
    pub value: f32,
    /// Index of the node in the model, not in the node set; the lowest of equals.
    pub node: u32,
}

/// Largest values of a reconstruction.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Peaks {
    /// Largest displacement magnitude, mm, when the basis publishes one.
    pub displacement_mm: Option<Peak>,
    /// Largest von Mises stress, MPa, when the basis publishes it.
    pub stress_mpa: Option<Peak>,
}

/// Slices that do not fit the basis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
#[allow(missing_docs)] // the messages say what the values are
pub enum ReconstructError {
    /// Fewer coefficients than the modes refer to.
    #[error("found {found} coefficients; this basis needs at least {expected}")]
    Coefficients { found: usize, expected: usize },
    /// An output of another length.
    #[error("the output holds {found} values; this basis writes {expected}")]
    Output { found: usize, expected: usize },
    /// The model has no answer at the state.
    #[error(transparent)]
    Refused(#[from] Refusal),
}

/// Modes, means and rest shape of the published fields over a node set, ready for the kernel.
///
/// [`Basis::reconstruct`] neither allocates nor locks and can be called from any thread.
#[derive(Debug, Clone)]
pub struct Basis {
    plan: Plan,
    rows: Rows,
    isa: Isa,
    nodes: Option<Box<[u32]>>,
}

impl Basis {
    /// Prepares the basis for this processor. Over all nodes and in their own number format, which is that of `None`, modes are shared
    /// with the model, otherwise copied with 16 or 32 bits each: cost `O(nodes modes)`.
    ///
    /// # Errors
    /// [`BasisError`] when slices do not fit each other, a node is not in the model, or a value is not finite.
    pub fn build(spec: &Spec<'_>, precision: Option<Precision>) -> Result<Self, BasisError> {
        Self::build_for(spec, precision, Isa::detect())
    }

    /// The same for a chosen instruction set: for tests and comparisons.
    ///
    /// # Errors
    /// As [`Basis::build`], and [`BasisError::IsaMissing`].
    pub fn build_for(spec: &Spec<'_>, precision: Option<Precision>, isa: Isa) -> Result<Self, BasisError> {
        if !isa.is_available() {
            return Err(BasisError::IsaMissing { isa, detected: Isa::detect() });
        }
        let plan = Plan::new(spec)?;
        let mut modes = Vec::new();
        for op in &plan.ops {
            let FieldSource::Affine(affine) = &spec.fields[op.field].source else { continue };
            let wanted = precision.unwrap_or(affine.modes.precision());
            if spec.nodes.is_none() && (precision.is_none() || affine.modes.precision() == wanted) {
                modes.push(affine.modes.clone());
                continue;
            }
            let value = |mode, i| affine.modes.value(mode, spec.source_node(i));
            let copied = Modes::new(wanted, plan.nodes, op.modes, value);
            modes.push(copied.map_err(|NotFinite { node, value }| {
                let node = spec.source_node(node);
                BasisError::NotFinite { field: op.field, node, value }
            })?);
        }
        let constants = plan.constant_rows(spec)?;
        let rows = Rows::new(&plan, modes, &constants);
        Ok(Self { rows, plan, isa, nodes: spec.nodes.map(Into::into) })
    }

    /// Writes all published fields, field-major (all nodes of the first field, then of the second ...), and returns
    /// the peaks.
    ///
    /// `coefficients` are the model's modal coefficients; each is rounded to f32 once. NaN in a coefficient comes out
    /// as NaN in the fields and never wins a peak; when every value of a field is NaN its peak is minus infinity.
    ///
    /// # Errors
    /// [`ReconstructError`] when a slice has the wrong length; nothing is written then.
    pub fn reconstruct(&self, coefficients: &[f64], out: &mut [f32]) -> Result<Peaks, ReconstructError> {
        self.check(coefficients, out.len())?;
        Ok(self.peaks(sweep::run_into(self.isa, &self.plan, &self.rows, coefficients, out)))
    }

    /// The same into memory that was never written, such as a slice loaned from shared memory. On `Ok` every element
    /// of `out` is initialised; unsafe code may rely on it.
    ///
    /// # Errors
    /// [`ReconstructError`] when a slice has the wrong length; nothing is written then.
    pub fn reconstruct_uninit(
        &self,
        coefficients: &[f64],
        out: &mut [MaybeUninit<f32>],
    ) -> Result<Peaks, ReconstructError> {
        self.check(coefficients, out.len())?;
        Ok(self.peaks(sweep::run(self.isa, &self.plan, &self.rows, coefficients, out)))
    }

    fn check(&self, coefficients: &[f64], output: usize) -> Result<(), ReconstructError> {
        let (found, expected) = (coefficients.len(), self.plan.coefficients);
        if found < expected {
            return Err(ReconstructError::Coefficients { found, expected });
        }
        if output != self.plan.entries() {
            return Err(ReconstructError::Output { found: output, expected: self.plan.entries() });
        }
        Ok(())
    }

    fn peaks(&self, raw: RawPeaks) -> Peaks {
        let peak = |(value, node): (f32, usize)| Peak {
            value,
            node: self.nodes.as_ref().map_or(node as u32, |nodes| nodes[node]),
        };
        let has = |role| self.plan.ops.iter().any(|op| op.role == role);
        let displacement = self.plan.magnitude_slot.is_some() || has(Role::Displacement);
        Peaks {
            displacement_mm: displacement.then(|| peak(raw.displacement)),
            stress_mpa: has(Role::Stress).then(|| peak(raw.stress)),
        }
    }

    /// Values written by a reconstruction: published fields times nodes.
    pub fn output_len(&self) -> usize {
        self.plan.entries()
    }

    /// Published fields.
    pub fn fields(&self) -> usize {
        self.plan.published
    }

    /// Nodes of the node set.
    pub fn nodes(&self) -> usize {
        self.plan.nodes
    }

    /// Modes read by a reconstruction, summed over the fields.
    pub fn modes(&self) -> usize {
        self.plan.ops.iter().map(|op| op.modes).sum()
    }

    /// Bytes read by a reconstruction.
    pub fn bytes(&self) -> usize {
        let ops = self.plan.ops.iter().zip(&self.rows.modes);
        let modes = ops.map(|(op, modes)| Modes::bytes_of(self.nodes(), &modes.bits()[..op.modes]));
        modes.sum::<usize>() + self.rows.constant_bytes()
    }

    /// Bytes in memory, modes shared with the model and with other regimes included.
    pub fn memory_bytes(&self) -> usize {
        self.rows.modes.iter().map(|modes| modes.bytes().len()).sum::<usize>() + self.rows.constant_bytes()
    }

    /// The instruction set in use.
    pub fn isa(&self) -> Isa {
        self.isa
    }
}

/// The modes of one field as a basis sums them: `sum_k modes_k c_(first + k)` over the first `count` of them.
#[derive(Clone, Copy, Debug)]
pub struct FieldModes<'a> {
    /// Position in [`crate::model::ModelHeader::fields`].
    pub field: usize,
    /// First of its coefficients.
    pub first: usize,
    /// Modes in use.
    pub count: usize,
    /// The modes over the nodes of the selection; [`Modes::value`] is what the sweep reads.
    pub modes: &'a Modes,
}

/// The bases of a model for one selection of fields and nodes.
#[derive(Clone, Debug)]
pub struct Reconstructor {
    regimes: Vec<(RegimeKind, Basis)>,
    rows: usize,
    /// Fields of the output, and behind them coordinates that a published magnitude needs.
    fields: Vec<usize>,
    field_count: usize,
    max_coefficients: usize,
    /// Inputs that move the undeformed mesh, with the value at which it is the model's: their differences follow the
    /// coefficients.
    moving: Vec<(usize, f64)>,
}

impl Reconstructor {
    /// Prepares what the selection needs in the number format of the model.
    ///
    /// # Errors
    /// [`ModelError`] when the selection does not fit the model, is empty, or a block is missing.
    pub fn new(model: &Model, selection: &Selection) -> Result<Self, ModelError> {
        Self::with_precision(model, selection, None)
    }

    /// As [`Self::new`], with the modes in this number format.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn with_precision(
        model: &Model,
        selection: &Selection,
        precision: Option<Precision>,
    ) -> Result<Self, ModelError> {
        let header = &model.header;
        header.check().map_err(ModelError::Inconsistent)?;
        let nodes = header.resolve_nodes(&selection.nodes)?;
        let fields = header.resolve_fields(selection.fields.as_deref())?;
        let max_coefficients = header.regimes.iter().map(RegimeModel::coefficient_count).max().unwrap_or(0);
        let moving = moving(model);
        if !moving.is_empty() && max_coefficients + moving.len() > MAX_ROWS {
            return Err(BasisError::Rows { found: max_coefficients + moving.len() }.into());
        }
        let shifts = shifts(model, &moving, max_coefficients);
        let basis = |regime: &RegimeModel| {
            let basis = basis(model, regime, &fields, nodes.as_deref(), precision, &shifts)?;
            Ok((regime.kind, basis))
        };
        Ok(Self {
            regimes: header.regimes.iter().map(basis).collect::<Result<_, ModelError>>()?,
            max_coefficients,
            moving,
            rows: nodes.map_or(header.node_count, |n| n.len()),
            field_count: fields.len(),
            fields: with_hidden(model, &fields),
        })
    }

    /// Nodes per field of the output.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Fields of the output.
    pub fn field_count(&self) -> usize {
        self.field_count
    }

    /// Entries of the output: fields x nodes.
    pub fn entries(&self) -> usize {
        self.rows * self.field_count
    }

    /// The basis of a regime; `None` when the model was not trained in it.
    pub fn basis(&self, kind: RegimeKind) -> Option<&Basis> {
        self.regimes.iter().find(|(regime, _)| *regime == kind).map(|(_, basis)| basis)
    }

    /// The modes that the basis of a regime sums, field by field: for those who write the sum elsewhere. Coordinates that are not published
    /// are among them where a published magnitude needs them.
    pub fn field_modes(&self, kind: RegimeKind) -> impl Iterator<Item = FieldModes<'_>> {
        self.basis(kind).into_iter().flat_map(|basis| {
            basis.plan.ops.iter().zip(&basis.rows.modes).map(|(op, modes)| FieldModes {
                field: self.fields[op.field],
                first: op.first_coefficient,
                count: op.modes,
                modes,
            })
        })
    }

    /// All bases.
    pub fn bases(&self) -> impl Iterator<Item = &Basis> {
        self.regimes.iter().map(|(_, basis)| basis)
    }

    /// Writes the fields of an evaluation into `out`, field-major (all of the first field, then the next), and returns
    /// the largest displacement and stress with their nodes.
    ///
    /// # Errors
    /// [`ReconstructError`] when `out` is not [`Self::entries`] long or the evaluation is of another model; nothing is
    /// written then.
    pub fn reconstruct_into(
        &self,
        evaluation: &Evaluation,
        out: &mut [f32],
    ) -> Result<Peaks, ReconstructError> {
        self.with_coefficients(evaluation, |basis, coefficients| basis.reconstruct(coefficients, out))
    }

    /// The same into memory never written before, such as a loaned shared-memory sample. On `Ok` all of it is written.
    ///
    /// # Errors
    /// As [`Self::reconstruct_into`].
    pub fn reconstruct_uninit(
        &self,
        evaluation: &Evaluation,
        out: &mut [MaybeUninit<f32>],
    ) -> Result<Peaks, ReconstructError> {
        self.with_coefficients(evaluation, |basis, coefficients| basis.reconstruct_uninit(coefficients, out))
    }

    /// Coefficients that [`Basis::reconstruct`] takes for this evaluation: its own, behind them the distance of each input
    /// that moves the undeformed mesh from the model's value.
    ///
    /// # Errors
    /// An evaluation of another model.
    pub fn coefficients(&self, evaluation: &Evaluation) -> Result<Vec<f64>, ReconstructError> {
        self.with_coefficients(evaluation, |_, coefficients| Ok(coefficients.to_vec()))
    }

    fn with_coefficients<R>(
        &self,
        evaluation: &Evaluation,
        run: impl FnOnce(&Basis, &[f64]) -> Result<R, ReconstructError>,
    ) -> Result<R, ReconstructError> {
        if let Some(refusal) = evaluation.flags.refusal {
            return Err(refusal.into());
        }
        let (own, expected) = (&evaluation.coefficients, self.max_coefficients);
        // An evaluation of another model has no basis here: as if it had no coefficients.
        let none = ReconstructError::Coefficients { found: 0, expected };
        let basis = self.basis(evaluation.regime).ok_or(none)?;
        if self.moving.is_empty() {
            return run(basis, own);
        }
        if own.len() > expected {
            return Err(ReconstructError::Coefficients { found: own.len(), expected });
        }
        let mut all = [0.0; MAX_ROWS];
        all[..own.len()].copy_from_slice(own);
        let values = evaluation.inputs.values();
        for (to, (input, from)) in all[expected..].iter_mut().zip(&self.moving) {
            *to = values[*input] - from;
        }
        run(basis, &all[..expected + self.moving.len()])
    }
}

/// The inputs that move the undeformed mesh, each with the value at which it is the model's.
fn moving(model: &Model) -> Vec<(usize, f64)> {
    let mut found: Vec<(usize, f64)> = Vec::new();
    for (kind, _) in &model.blocks {
        if let BlockKind::UndeformedBy { input, from_bits, .. } = kind
            && found.iter().all(|(known, _)| *known != *input as usize)
        {
            found.push((*input as usize, f64::from_bits(*from_bits)));
        }
    }
    found
}

/// Changes of the undeformed mesh with these inputs; their coefficients come behind those of the modes.
fn shifts<'a>(model: &'a Model, moving: &[(usize, f64)], first: usize) -> Vec<Shift<'a>> {
    let shift = |(index, (input, from)): (usize, &(usize, f64))| {
        let along = |axis| {
            let kind = BlockKind::UndeformedBy { input: *input as u32, axis, from_bits: from.to_bits() };
            model.f32_block(kind)
        };
        Shift { coefficient: first + index, axes: [0, 1, 2].map(along) }
    };
    moving.iter().enumerate().map(shift).collect()
}

/// Fields, and behind them the coordinates that a magnitude among them needs and that are not published.
fn with_hidden(model: &Model, fields: &[usize]) -> Vec<usize> {
    let derived = fields.iter().filter_map(|f| model.header.fields[*f].magnitude_of).flatten();
    fields.iter().copied().chain(derived.filter(|axis| !fields.contains(axis))).collect()
}

/// Describes the selected fields of a regime to the kernel and lets it lay them out. Coordinates a derived magnitude
/// needs are computed though not published.
fn basis(
    model: &Model,
    regime: &RegimeModel,
    fields: &[usize],
    nodes: Option<&[u32]>,
    precision: Option<Precision>,
    shifts: &[Shift<'_>],
) -> Result<Basis, ModelError> {
    let order = with_hidden(model, fields);
    let mut roles = Vec::new();
    let mut described = Vec::new();
    for (index, &field) in order.iter().enumerate() {
        let role = match model.header.fields[field].spec.kind {
            FieldKind::Stress => Role::Stress,
            FieldKind::Magnitude => Role::Displacement,
            FieldKind::Coordinate(_) | FieldKind::Other => Role::Plain,
        };
        let first = role == Role::Plain || !roles.contains(&role); // a maximum is reported for one field of a role
        roles.push(role);
        described.push(Field {
            source: source(model, regime, &order, field, shifts)?,
            role: if first { role } else { Role::Plain },
            published: index < fields.len(),
        });
    }
    let spec = Spec { node_count: model.header.node_count, nodes, fields: described };
    Ok(Basis::build(&spec, precision)?)
}

/// Origin of a field of a regime; `order` says which field of the model each of the spec is.
fn source<'a>(
    model: &'a Model,
    regime: &RegimeModel,
    order: &[usize],
    field: usize,
    shifts: &[Shift<'a>],
) -> Result<FieldSource<'a>, ModelError> {
    let expected = model.header.node_count;
    let whole = |kind: BlockKind, values: Option<&'a [f32]>| {
        let values = values.unwrap_or(&[]);
        let missing =
            || ModelError::MissingBlock { block: format!("{kind:?}"), expected, found: values.len() };
        if values.len() == expected { Ok(values) } else { Err(missing()) }
    };
    if let Some(axes) = model.header.fields[field].magnitude_of {
        let position = |axis: usize| order.iter().position(|f| *f == axis).unwrap_or(usize::MAX);
        let rest = |axis| whole(BlockKind::Undeformed(axis), model.f32_block(BlockKind::Undeformed(axis)));
        let rest = [rest(0)?, rest(1)?, rest(2)?];
        return Ok(FieldSource::Magnitude { coordinates: axes.map(position), rest, shifts: shifts.to_vec() });
    }
    let group = regime.group_of(field);
    let (kind, field) = (regime.kind, field as u32);
    Ok(FieldSource::Affine(Affine {
        mean: Some(whole(BlockKind::Mean { regime: kind, field }, model.mean(kind, field))?),
        modes: model.modes(kind, field)?,
        coefficients: group.map_or(0..0, |group| group.coefficients.clone()),
    }))
}
