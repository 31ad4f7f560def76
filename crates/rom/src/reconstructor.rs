//! Coefficients -> fields, for one selection of fields and nodes. Nothing is allocated after construction.

use crate::accepted::{OwnErrors, added, least_share, typical_coefficients};
use crate::evaluation::Evaluation;
use crate::kernel::{
    Affine, Basis, BasisError, Budget, Field, MAX_ROWS, Peaks, Precision, ReconstructError, Role, Shift,
    Shortfall, Source, Spec, Values,
};
use crate::model::{BlockKind, Model, ModelError, RegimeModel, Selection};
use crate::parts::Parts;
use crate::snapshots::{FieldKind, RegimeKind};
use std::mem::MaybeUninit;

/// How the bases of a model are stored.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Storage {
    /// All rows alike.
    Uniform(Precision),
    /// In as few bytes as let the model's own error grow by no more than this share (0.01: 1 %): every group of nodes has modes of
    /// its own, each in 32, 16 or 8 bits. The own error of a field is its leave-one-out error, of all states the
    /// median, with what the modes leave out. Both, and what storage adds at the training states and between them, are root mean
    /// squares over the nodes.
    Within {
        /// The share.
        share: f64,
        /// A field of which f32 already adds more stays in f32; otherwise that is an error.
        or_f32: bool,
        /// Into how many parts the domain of a regime is divided at most, each with a basis of its own, of which a reconstruction reads
        /// one; fewer where there are few states, and one where the basis is small.
        parts: usize,
    },
}

impl Storage {
    /// Share by which the own error may grow where nothing else is accepted: on new states, where derivatives make the error
    /// several times smaller than by leave-one-out, it then grows by less than 2 % (a test).
    pub const AS_GOOD_SHARE: f64 = 0.004;
    /// As good as in full: the own error grows by at most [`Self::AS_GOOD_SHARE`], or a field stays in f32.
    pub const AS_GOOD: Self = Self::Within { share: Self::AS_GOOD_SHARE, or_f32: true, parts: Self::PARTS };
    /// Into how many parts domains are divided where nothing else is said.
    pub const PARTS: usize = 8;

    /// Exactly this share, or an error.
    pub fn within(share: f64) -> Self {
        Self::Within { share, or_f32: false, parts: Self::PARTS }
    }

    /// The same with domains in at most so many parts; other storage knows none.
    #[must_use]
    pub fn in_parts(self, parts: usize) -> Self {
        match self {
            Self::Within { share, or_f32, .. } => Self::Within { share, or_f32, parts },
            Self::Uniform(precision) => Self::Uniform(precision),
        }
    }
}

impl From<Precision> for Storage {
    fn from(precision: Precision) -> Self {
        Self::Uniform(precision)
    }
}

/// The bases of a model, laid out for one selection of fields and nodes.
#[derive(Clone, Debug)]
pub struct Reconstructor {
    regimes: Vec<RegimeBases>,
    rows: usize,
    field_count: usize,
    max_coefficients: usize,
    /// Inputs that move the undeformed mesh, with the value at which it is the model's: their differences follow the
    /// coefficients.
    moving: Vec<(usize, f64)>,
}

/// The bases of a regime, one for each part of its domain.
#[derive(Clone, Debug)]
struct RegimeBases {
    kind: RegimeKind,
    /// None where one basis is for the whole domain.
    parts: Option<Parts>,
    bases: Vec<Basis>,
}

impl Reconstructor {
    /// Lays out what the selection needs, in f32. Cost `O(nodes x modes)` once.
    ///
    /// # Errors
    /// [`ModelError`] when the selection does not fit the model, is empty, or a block is missing.
    pub fn new(model: &Model, selection: &Selection) -> Result<Self, ModelError> {
        Self::with_precision(model, selection, Precision::F32)
    }

    /// As [`Self::new`], with the basis stored in the given precision, or within an error. The latter takes longer: it asks
    /// for the model's own error, `O(samples^3)`.
    ///
    /// # Errors
    /// As [`Self::new`], and [`ModelError::AcceptedError`].
    pub fn with_precision(
        model: &Model,
        selection: &Selection,
        storage: impl Into<Storage>,
    ) -> Result<Self, ModelError> {
        let (header, storage) = (&model.header, storage.into());
        header.check().map_err(ModelError::Inconsistent)?;
        let nodes = header.resolve_nodes(&selection.nodes)?;
        let fields = header.resolve_fields(selection.fields.as_deref())?;
        let max_coefficients = header.regimes.iter().map(RegimeModel::coefficient_count).max().unwrap_or(0);
        let moving = moving(model);
        if !moving.is_empty() && max_coefficients + moving.len() > MAX_ROWS {
            return Err(BasisError::Rows { found: max_coefficients + moving.len() }.into());
        }
        let shifts = shifts(model, &moving, max_coefficients);
        let of = |regime: &RegimeModel| build(model, regime, &fields, nodes.as_deref(), storage, &shifts);
        Ok(Self {
            regimes: header.regimes.iter().map(of).collect::<Result<_, ModelError>>()?,
            max_coefficients,
            moving,
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

    /// The laid-out bases of a regime, one for each part of its domain; none when the model was not trained in it.
    pub fn bases(&self, kind: RegimeKind) -> &[Basis] {
        self.regimes.iter().find(|of| of.kind == kind).map_or(&[], |of| &of.bases)
    }

    /// The one of them that is the most to read; none when the model was not trained in it.
    pub fn largest_basis(&self, kind: RegimeKind) -> Option<&Basis> {
        self.bases(kind).iter().max_by_key(|basis| basis.bytes())
    }

    /// The basis from which the fields of an evaluation are reconstructed: of its regime, and of the part of the domain in which its
    /// inputs lie. None when the model was not trained in this regime.
    pub fn basis_of(&self, evaluation: &Evaluation) -> Option<&Basis> {
        let of = self.regimes.iter().find(|of| of.kind == evaluation.regime)?;
        of.bases.get(of.parts.as_ref().map_or(0, |parts| parts.of(evaluation.inputs.values())))
    }

    /// Bytes of all bases.
    pub fn bytes(&self) -> usize {
        self.regimes.iter().flat_map(|of| &of.bases).map(Basis::bytes).sum()
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

    /// What [`Basis::reconstruct`] takes for this evaluation: its coefficients, behind them how far each input that moves the
    /// undeformed mesh is from the model's own.
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
        let (own, expected) = (&evaluation.coefficients, self.max_coefficients);
        // An evaluation of another model has no basis here: as if it had no coefficients.
        let none = ReconstructError::Coefficients { found: 0, expected };
        let basis = self.basis_of(evaluation).ok_or(none)?;
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

/// What these inputs move; their coefficients come behind those of the modes.
fn shifts<'a>(model: &'a Model, moving: &[(usize, f64)], first: usize) -> Vec<Shift<'a>> {
    let one = |(at, (input, from)): (usize, &(usize, f64))| {
        let along = |axis| {
            let kind = BlockKind::UndeformedBy { input: *input as u32, axis, from_bits: from.to_bits() };
            model.f32_block(kind).map(Values::F32)
        };
        Shift { coefficient: first + at, axes: [0, 1, 2].map(along) }
    };
    moving.iter().enumerate().map(one).collect()
}

/// Describes the selected fields of a regime to the kernel and lets it lay them out. Coordinates a derived magnitude
/// needs are computed though not published.
fn build<'a>(
    model: &'a Model,
    regime: &RegimeModel,
    fields: &[usize],
    nodes: Option<&[u32]>,
    storage: Storage,
    shifts: &[Shift<'a>],
) -> Result<RegimeBases, ModelError> {
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
        let source = source(model, regime, &order, field, shifts)?;
        described.push(Field {
            source,
            role: if first { role } else { Role::Plain },
            published: at < fields.len(),
        });
    }
    let spec = Spec { node_count: model.header.node_count, nodes, fields: described };
    match storage {
        Storage::Uniform(precision) => {
            Ok(RegimeBases { kind: regime.kind, parts: None, bases: vec![Basis::build(&spec, precision)?] })
        }
        Storage::Within { share, or_f32, parts } => {
            build_within(model, regime, &order, &spec, (share, or_f32, parts))
        }
    }
}

/// The same in as few bytes as an accepted error allows, for each part of the domain; `order` says which field of the model each of the spec is.
fn build_within(
    model: &Model,
    regime: &RegimeModel,
    order: &[usize],
    spec: &Spec<'_>,
    (share, or_f32, parts): (f64, bool, usize),
) -> Result<RegimeBases, ModelError> {
    let nodes: Vec<usize> = (0..spec.output_nodes()).map(|i| spec.source_node(i)).collect();
    let errors = OwnErrors::new(regime);
    let own = |field: &usize| {
        let modes = model.f32_block(BlockKind::Modes { regime: regime.kind, field: *field as u32 });
        modes.map_or(0.0, |modes| errors.of(*field, modes, model.header.node_count, &nodes))
    };
    let own: Vec<f64> = order.iter().map(own).collect();
    let accepted: Vec<f64> = own.iter().map(|own| added(*own, share)).collect();
    let typical = typical_coefficients(regime);
    let parts = if parts > 1 && bytes_in_full(spec) > ONE_PART_BYTES {
        Parts::new(&regime.inputs, &typical, &least_coefficients(regime, spec, &accepted), parts)
    } else {
        Parts::one(&regime.inputs)
    };
    let (mut bases, mut short) = (Vec::new(), Vec::<Shortfall>::new());
    let of_part = |part| with_moving(model, regime, parts.near(part, &typical).cloned().collect());
    let typical: Vec<_> = (0..parts.count()).map(of_part).collect();
    let budgets: Vec<_> =
        typical.iter().map(|typical| Budget { typical, accepted: &accepted, or_f32 }).collect();
    for basis in Basis::build_within_each(spec, &budgets)? {
        match basis {
            Ok(basis) => bases.push(basis),
            Err(BasisError::Budget(of_part)) => {
                of_part.into_iter().for_each(|found| worst(&mut short, found))
            }
            Err(other) => return Err(other.into()),
        }
    }
    if short.is_empty() {
        return Ok(RegimeBases { kind: regime.kind, parts: Some(parts), bases });
    }
    Err(ModelError::AcceptedError {
        regime: regime.kind.name(),
        accepted: share,
        least: short.iter().map(|s| least_share(s, own[s.field])).fold(0.0, f64::max),
        fields: short.iter().map(|s| shortfall(model, order[s.field], s)).collect(),
    })
}

/// A basis that takes no more in f32 stays in a core's own caches as it is.
const ONE_PART_BYTES: usize = 2 << 20;

/// Bytes of the modes in f32.
fn bytes_in_full(spec: &Spec<'_>) -> usize {
    let modes = |field: &Field<'_>| match &field.source {
        Source::Affine(affine) => affine.coefficients.len(),
        Source::Magnitude { .. } => 0,
    };
    spec.fields.iter().map(modes).sum::<usize>() * spec.output_nodes() * size_of::<f32>()
}

/// By coefficient: the least that counts, because it makes as large a root mean square as a field may be off by.
fn least_coefficients(regime: &RegimeModel, spec: &Spec<'_>, accepted: &[f64]) -> Vec<f64> {
    let mut least = vec![f64::INFINITY; regime.coefficient_count()];
    for (field, accepted) in spec.fields.iter().zip(accepted) {
        let Source::Affine(Affine { modes, stride, coefficients, .. }) = &field.source else { continue };
        for (mode, at) in coefficients.clone().enumerate() {
            let values = (0..spec.output_nodes()).map(|i| modes.get(mode * stride + spec.source_node(i)));
            let square = values.map(|value| value * value).sum::<f64>() / spec.output_nodes() as f64;
            least[at] = least[at].min(accepted / square.sqrt());
        }
    }
    least
}

/// Behind the coefficients of all regimes come the inputs that move the mesh, as far as they go.
fn with_moving(model: &Model, regime: &RegimeModel, mut typical: Vec<Vec<f64>>) -> Vec<Vec<f64>> {
    let regimes = &model.header.regimes;
    let coefficients = regimes.iter().map(RegimeModel::coefficient_count).max().unwrap_or(0);
    let farthest = moving(model).into_iter().map(|(input, from)| {
        let range = regime.inputs.range(input).unwrap_or([from; 2]);
        range.iter().fold(0.0_f64, |most, end| most.max((end - from).abs()))
    });
    let farthest: Vec<f64> = farthest.collect();
    for vector in &mut typical {
        vector.resize(coefficients, 0.0);
        vector.extend(&farthest);
    }
    typical
}

/// Keeps what is short in the worst part of each field.
fn worst(all: &mut Vec<Shortfall>, found: Shortfall) {
    match all.iter_mut().find(|known| known.field == found.field) {
        Some(known) if known.least >= found.least => {}
        Some(known) => *known = found,
        None => all.push(found),
    }
}

fn shortfall(model: &Model, field: usize, short: &Shortfall) -> String {
    let field = &model.header.fields[field].spec;
    let Shortfall { accepted, least, .. } = short;
    format!(
        "{} may have {accepted:.1e} {unit} added, f32 adds {least:.1e} {unit}",
        field.name,
        unit = field.unit
    )
}

/// Where a field of a regime comes from; `order` says which field of the model each of the spec is.
pub(crate) fn source<'a>(
    model: &'a Model,
    regime: &RegimeModel,
    order: &[usize],
    field: usize,
    shifts: &[Shift<'a>],
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
        let rest = [rest(0)?, rest(1)?, rest(2)?];
        return Ok(Source::Magnitude { coordinates: axes.map(at), rest, shifts: shifts.to_vec() });
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
