//! Coefficients -> fields, for one selection of fields and nodes. Nothing is allocated after construction.

use crate::evaluation::Evaluation;
use crate::kernel::{Affine, Basis, Field, Peaks, Precision, ReconstructError, Role, Source, Spec, Values};
use crate::model::{BlockKind, Model, ModelError, RegimeModel, Selection};
use crate::snapshots::{FieldKind, RegimeKind};
use std::mem::MaybeUninit;

/// The bases of a model, laid out for one selection of fields and nodes.
#[derive(Clone, Debug)]
pub struct Reconstructor {
    bases: Vec<(RegimeKind, Basis)>,
    rows: usize,
    field_count: usize,
    max_coefficients: usize,
}

impl Reconstructor {
    /// Lays out what the selection needs, in f32. Cost `O(nodes x modes)` once.
    ///
    /// # Errors
    /// [`ModelError`] when the selection does not fit the model, is empty, or a block is missing.
    pub fn new(model: &Model, selection: &Selection) -> Result<Self, ModelError> {
        Self::with_precision(model, selection, Precision::F32)
    }

    /// As [`Self::new`], with the basis stored in the given precision.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn with_precision(
        model: &Model,
        selection: &Selection,
        precision: Precision,
    ) -> Result<Self, ModelError> {
        let header = &model.header;
        header.check().map_err(ModelError::Inconsistent)?;
        let nodes = header.resolve_nodes(&selection.nodes)?;
        let fields = header.resolve_fields(selection.fields.as_deref())?;
        let basis = |regime: &RegimeModel| {
            Ok((regime.kind, build(model, regime, &fields, nodes.as_deref(), precision)?))
        };
        Ok(Self {
            bases: header.regimes.iter().map(basis).collect::<Result<_, ModelError>>()?,
            max_coefficients: header.regimes.iter().map(RegimeModel::coefficient_count).max().unwrap_or(0),
            rows: nodes.map_or(header.node_count, |n| n.len()),
            field_count: fields.len(),
        })
    }

    /// Nodes a field of the output.
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

    /// The laid-out basis of a regime; none when the model was not trained in it.
    pub fn basis(&self, kind: RegimeKind) -> Option<&Basis> {
        self.bases.iter().find(|(of, _)| *of == kind).map(|(_, basis)| basis)
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
        self.basis_of(evaluation)?.reconstruct(&evaluation.coefficients, out)
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
        self.basis_of(evaluation)?.reconstruct_uninit(&evaluation.coefficients, out)
    }

    /// An evaluation of another model has no basis here: as if it had no coefficients.
    fn basis_of(&self, evaluation: &Evaluation) -> Result<&Basis, ReconstructError> {
        let expected = self.max_coefficients;
        self.basis(evaluation.regime).ok_or(ReconstructError::Coefficients { found: 0, expected })
    }
}

/// Describes the selected fields of a regime to the kernel and lets it lay them out. Coordinates a derived magnitude
/// needs are computed though not published.
fn build(
    model: &Model,
    regime: &RegimeModel,
    fields: &[usize],
    nodes: Option<&[u32]>,
    precision: Precision,
) -> Result<Basis, ModelError> {
    let derived = fields.iter().filter_map(|f| model.header.fields[*f].magnitude_of).flatten();
    let hidden: Vec<usize> = derived.filter(|axis| !fields.contains(axis)).collect();
    let order: Vec<usize> = fields.iter().chain(&hidden).copied().collect();
    let mut roles = Vec::new();
    let mut described = Vec::new();
    for (at, &field) in order.iter().enumerate() {
        let role = match model.header.fields[field].spec.kind {
            FieldKind::Stress => Role::Stress,
            FieldKind::Magnitude => Role::Displacement,
            FieldKind::Coordinate(_) | FieldKind::Other => Role::Plain,
        };
        let first = role == Role::Plain || !roles.contains(&role); // a maximum is reported for one field of a role
        roles.push(role);
        let source = source(model, regime, &order, field)?;
        described.push(Field {
            source,
            role: if first { role } else { Role::Plain },
            published: at < fields.len(),
        });
    }
    let spec = Spec { node_count: model.header.node_count, nodes, fields: described };
    Ok(Basis::build(&spec, precision)?)
}

fn source<'a>(
    model: &'a Model,
    regime: &RegimeModel,
    order: &[usize],
    field: usize,
) -> Result<Source<'a>, ModelError> {
    let node_count = model.header.node_count;
    let block = |kind: BlockKind, expected: usize| {
        let values = model.f32_block(kind).unwrap_or(&[]);
        if values.len() == expected {
            return Ok(Values::F32(values));
        }
        Err(ModelError::MissingBlock { block: format!("{kind:?}"), expected, found: values.len() })
    };
    if let Some(axes) = model.header.fields[field].magnitude_of {
        let at = |axis: usize| order.iter().position(|f| *f == axis).unwrap_or(usize::MAX);
        let rest = |axis| block(BlockKind::Undeformed(axis), node_count);
        return Ok(Source::Magnitude { coordinates: axes.map(at), rest: [rest(0)?, rest(1)?, rest(2)?] });
    }
    let group = regime.groups.iter().find(|g| g.fields.contains(&field));
    let coefficients = group.map(|g| g.coefficients.clone()).unwrap_or(0..0);
    let (regime, field) = (regime.kind, field as u32);
    Ok(Source::Affine(Affine {
        mean: Some(block(BlockKind::Mean { regime, field }, node_count)?),
        modes: block(BlockKind::Modes { regime, field }, node_count * coefficients.len())?,
        stride: node_count,
        coefficients,
    }))
}
