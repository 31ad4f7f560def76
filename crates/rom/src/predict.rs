//! Answering queries: regime, coefficients, force, gradients, domain, bars; then fields. Nothing is allocated after
//! construction.

use crate::evaluation::{Evaluation, Flags, Input};
use crate::hull::{Domain, DomainStatus};
use crate::interpolant::{Interpolant, KernelScratch};
use crate::kernel::{
    Affine, Basis, BasisError, Field, Peaks, Precision, ReconstructError, Role, Source, Spec, Values,
};
use crate::model::{BlockKind, HalfWidths, Model, RegimeModel};
use crate::regime::{Onset, OnsetTable, RegimeSwitch};
use crate::snapshots::{FieldKind, RegimeKind};
use std::mem::MaybeUninit;
use thiserror::Error;

/// Which fields and nodes to reconstruct. The default is everything.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Selection {
    /// Fields by name, in the order wanted; none for all in the model's order.
    pub fields: Option<Vec<String>>,
    /// Nodes.
    pub nodes: Nodes,
}

/// Which nodes to reconstruct.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Nodes {
    /// All of them.
    #[default]
    All,
    /// A node set of the model, by name.
    Set(String),
    /// These, in this order.
    List(Vec<u32>),
}

/// Why a predictor could not be made from a model.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum PredictError {
    /// No such field.
    #[error("the model has no field {found:?}; it has {}", .known.join(", "))]
    UnknownField {
        /// Name asked for.
        found: String,
        /// Names there are.
        known: Vec<String>,
    },
    /// No such node set.
    #[error("the model has no node set {found:?}; it has {}", if .known.is_empty() { "none".into() } else { .known.join(", ") })]
    UnknownNodeSet {
        /// Name asked for.
        found: String,
        /// Names there are.
        known: Vec<String>,
    },
    /// A node index beyond the mesh.
    #[error("node {node} does not exist; the model has {node_count} nodes, numbered from 0")]
    NodeOutOfRange {
        /// Index asked for.
        node: u32,
        /// Nodes there are.
        node_count: usize,
    },
    /// A block the selection needs was not loaded, or has the wrong length.
    #[error("block {block}: expected {expected} values, found {found}; load the model with this selection")]
    MissingBlock {
        /// Which block.
        block: String,
        /// Length needed.
        expected: usize,
        /// Length found, 0 when absent.
        found: usize,
    },
    /// The kernel cannot lay the basis out.
    #[error("the basis cannot be laid out: {0}")]
    Basis(#[from] BasisError),
    /// The header contradicts itself.
    #[error("the model is inconsistent: {0}")]
    Inconsistent(String),
}

/// One regime, ready to run.
#[derive(Clone, Debug)]
struct RegimePart {
    model: RegimeModel,
    coefficient_count: usize,
    /// By group: the kernel values of the group before serve it too.
    shares_kernel: Vec<bool>,
    /// None when no field was selected: force and coefficients need no basis.
    basis: Option<Basis>,
}

impl RegimePart {
    fn new(model: RegimeModel, basis: Option<Basis>) -> Self {
        let before = |g: usize| g.checked_sub(1).map(|b| &model.groups[b].surrogate);
        let shares = |g| before(g).is_some_and(|b| model.groups[g].surrogate.shares_kernel_with(b));
        let shares_kernel = (0..model.groups.len()).map(shares).collect();
        Self { coefficient_count: model.coefficient_count(), shares_kernel, basis, model }
    }
}

/// A model made ready to answer, for one selection of fields and nodes.
#[derive(Clone, Debug)]
pub struct Predictor {
    parts: Vec<RegimePart>,
    onset: Option<OnsetTable>,
    hysteresis_mpa: f64,
    scratch: KernelScratch,
    rows: usize,
    field_count: usize,
}

impl Predictor {
    /// Gathers what the selection needs. Cost `O(nodes x modes)` once.
    ///
    /// # Errors
    /// [`PredictError`] when the selection does not fit the model or a block is missing.
    pub fn new(model: &Model, selection: &Selection) -> Result<Self, PredictError> {
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
    ) -> Result<Self, PredictError> {
        let header = &model.header;
        header.check().map_err(PredictError::Inconsistent)?;
        let nodes = header.resolve_nodes(&selection.nodes)?;
        let fields = header.resolve_fields(selection.fields.as_deref())?;
        let mut parts = Vec::new();
        for regime in &header.regimes {
            let wanted = !fields.is_empty();
            let basis =
                wanted.then(|| build(model, regime, &fields, nodes.as_deref(), precision)).transpose()?;
            parts.push(RegimePart::new(regime.clone(), basis));
        }
        let interpolants = header.regimes.iter().flat_map(RegimeModel::interpolants);
        let centres = interpolants.map(|i| i.centres.len()).max().unwrap_or(0);
        Ok(Self {
            parts,
            onset: header.onset.clone(),
            hysteresis_mpa: header.hysteresis_mpa,
            scratch: KernelScratch::new(centres),
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

    /// Onset pressure over gap; none for a model of one regime.
    pub fn onset(&self) -> Option<&OnsetTable> {
        self.onset.as_ref()
    }

    /// Most coefficients of any regime.
    pub fn max_coefficients(&self) -> usize {
        self.parts.iter().map(|p| p.coefficient_count).max().unwrap_or(0)
    }

    /// The laid-out basis of a regime.
    pub fn basis(&self, kind: RegimeKind) -> Option<&Basis> {
        self.parts.iter().find(|p| p.model.kind == kind)?.basis.as_ref()
    }

    /// An evaluation with room for any answer.
    pub fn evaluation(&self) -> Evaluation {
        let room = || Vec::with_capacity(self.max_coefficients());
        Evaluation {
            input: Input { pressure_mpa: f64::NAN, gap_mm: f64::NAN },
            regime: RegimeKind::Free,
            basis: RegimeKind::Free,
            coefficients: room(),
            dcoefficients_dpressure: room(),
            dcoefficients_dgap: room(),
            contact_force_n: 0.0,
            dforce_dpressure: 0.0,
            dforce_dgap: 0.0,
            onset_pressure_mpa: None,
            domain: DomainStatus::Inside,
            domain_distance: 0.0,
            bars: HalfWidths::default(),
            flags: Flags::default(),
        }
    }

    /// Answers a query; `switch` remembers the label. Any input is answered without panic; one that is no number, or lies
    /// outside the samples, is flagged as extrapolated (a twin checks its readings before it asks).
    ///
    /// Across the onset the value is continuous at every gap up to the reach (fields to truncation and smoothing, force
    /// exactly); slopes are not: the tip stops and the force starts, so gradients are those of the side the query is on.
    pub fn evaluate(&mut self, input: Input, switch: &mut RegimeSwitch, out: &mut Evaluation) {
        let onset = match (&self.onset, self.parts.first()) {
            (Some(table), _) => table.onset(input.gap_mm),
            (None, Some(part)) if part.model.kind == RegimeKind::Contact => Onset::Always,
            (None, _) => Onset::Never,
        };
        out.input = input;
        out.basis = onset.regime(input.pressure_mpa);
        out.regime = switch.label(onset, input.pressure_mpa, self.hysteresis_mpa);
        out.onset_pressure_mpa = onset.pressure_mpa();
        out.flags = Flags { held_by_hysteresis: out.regime != out.basis, ..Flags::default() };
        let Some(part) = self.parts.iter().find(|p| p.model.kind == out.basis) else { return };
        let x = part.model.inputs.scale(input.pressure_mpa, input.gap_mm);
        out.domain_distance = match input.pressure_mpa.is_nan() || input.gap_mm.is_nan() {
            true => f64::INFINITY, // `max` would drop a NaN, and a reading that is no number is nowhere
            false => part.model.domain.distance(x).max(part.model.inputs.off_constant(input.gap_mm)),
        };
        out.domain = Domain::status(out.domain_distance);
        out.flags.extrapolated = out.domain != DomainStatus::Inside;
        out.bars = part.model.bars;
        coefficients(part, x, &mut self.scratch, out);
        force(part, self.onset.as_ref(), x, &mut self.scratch, out);
    }

    /// Writes the fields of an evaluation into `out`, field-major (all of the first field, then the next), and returns
    /// the largest displacement and stress with their nodes.
    ///
    /// # Errors
    /// [`ReconstructError`] when `out` is not [`Self::entries`] long; nothing is written then.
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
        let expected = self.max_coefficients();
        self.basis(evaluation.basis).ok_or(ReconstructError::Coefficients { found: 0, expected })
    }
}

fn coefficients(part: &RegimePart, x: [f64; 2], scratch: &mut KernelScratch, out: &mut Evaluation) {
    let count = part.coefficient_count;
    for values in [&mut out.coefficients, &mut out.dcoefficients_dpressure, &mut out.dcoefficients_dgap] {
        values.resize(count, 0.0); // within the capacity `evaluation` reserved
    }
    for (g, group) in part.model.groups.iter().enumerate() {
        if !part.shares_kernel[g] {
            group.surrogate.kernel_values(x, scratch);
        }
        let range = group.coefficients.clone();
        let (value, dx0, dx1) = (
            &mut out.coefficients[range.clone()],
            &mut out.dcoefficients_dpressure[range.clone()],
            &mut out.dcoefficients_dgap[range],
        );
        group.surrogate.combine(x, scratch, value, dx0, dx1);
        for (d0, d1) in dx0.iter_mut().zip(dx1.iter_mut()) {
            (*d0, *d1) = part.model.inputs.unscale_gradient([*d0, *d1]);
        }
    }
    if let Some(far) = &part.model.far_onset {
        far.correct(out.input.gap_mm, &mut out.coefficients, &mut out.dcoefficients_dgap);
    }
}

/// `F = (P - P_c(gap)) h` or `F = h`, lifted to 0 where negative, with its gradient.
fn force(
    part: &RegimePart,
    onset: Option<&OnsetTable>,
    x: [f64; 2],
    scratch: &mut KernelScratch,
    out: &mut Evaluation,
) {
    (out.contact_force_n, out.dforce_dpressure, out.dforce_dgap) = (0.0, 0.0, 0.0);
    let Some(model) = &part.model.force else { return };
    let (h, dh_dpressure, dh_dgap) = scalar(&model.surrogate, part, x, scratch);
    let (force, dpressure, dgap) = match onset.filter(|_| model.times_excess_pressure) {
        Some(table) => {
            let (onset, slope) = table.pressure_and_slope(out.input.gap_mm);
            let excess = out.input.pressure_mpa - onset;
            (excess * h, h + excess * dh_dpressure, excess * dh_dgap - slope * h)
        }
        None => (h, dh_dpressure, dh_dgap),
    };
    if force < 0.0 {
        out.flags.force_clamped = true;
        return;
    }
    (out.contact_force_n, out.dforce_dpressure, out.dforce_dgap) = (force, dpressure, dgap);
}

fn scalar(fit: &Interpolant, part: &RegimePart, x: [f64; 2], scratch: &mut KernelScratch) -> (f64, f64, f64) {
    let (mut value, mut dx0, mut dx1) = ([0.0], [0.0], [0.0]);
    fit.evaluate(x, scratch, &mut value, &mut dx0, &mut dx1);
    let (dpressure, dgap) = part.model.inputs.unscale_gradient([dx0[0], dx1[0]]);
    (value[0], dpressure, dgap)
}

/// Describes the selected fields of a regime to the kernel and lets it lay them out. Coordinates a derived magnitude
/// needs are computed though not published.
fn build(
    model: &Model,
    regime: &RegimeModel,
    fields: &[usize],
    nodes: Option<&[u32]>,
    precision: Precision,
) -> Result<Basis, PredictError> {
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
) -> Result<Source<'a>, PredictError> {
    let node_count = model.header.node_count;
    let block = |kind: BlockKind, expected: usize| {
        let values = model.f32_block(kind).unwrap_or(&[]);
        if values.len() == expected {
            return Ok(Values::F32(values));
        }
        Err(PredictError::MissingBlock { block: format!("{kind:?}"), expected, found: values.len() })
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
