//! Version 2 of the model file's header: two inputs whose names the version implies. Points have two columns, the second 0
//! where a regime has one input.

use super::header::{FarOnset, ForceModel, GroupModel, HalfWidths, ModelHeader, OutputField, RegimeModel};
use crate::config::{KernelKind, Tail};
use crate::hull::Domain;
use crate::inputs::{GAP, InputAxis, InputMap, InputSpec, MAX_INPUTS, PRESSURE};
use crate::interpolant::{Interpolant, Metric};
use crate::regime::OnsetTable;
use crate::snapshots::{NodeSet, RegimeKind};
use serde::{Deserialize, Serialize};
use std::ops::Range;

#[derive(Serialize, Deserialize)]
pub(super) struct Header {
    actuator: String,
    fields: Vec<OutputField>,
    node_count: usize,
    regimes: Vec<Regime>,
    onset: Option<OnsetTable>,
    hysteresis_mpa: f64,
    node_sets: Vec<NodeSet>,
    database_hash: [u8; 32],
}

#[derive(Serialize, Deserialize)]
struct Regime {
    kind: RegimeKind,
    axes: Vec<Axis>,
    constant_gap_mm: Option<f64>,
    groups: Vec<Group>,
    force: Option<Force>,
    domain: Hull,
    halfwidths: HalfWidths,
    far_onset: Option<FarOnset>,
}

#[derive(Serialize, Deserialize)]
struct Axis {
    quantity: Quantity,
    min: f64,
    max: f64,
}

#[derive(Serialize, Deserialize)]
enum Quantity {
    PressureMpa,
    GapMm,
}

#[derive(Serialize, Deserialize)]
struct Group {
    name: String,
    fields: Vec<usize>,
    coefficients: Range<usize>,
    surrogate: Surrogate,
    singular_values: Vec<f64>,
}

#[derive(Serialize, Deserialize)]
struct Force {
    surrogate: Surrogate,
    times_excess_pressure: bool,
}

#[derive(Serialize, Deserialize)]
struct Surrogate {
    kernel: KernelKind,
    tail: Tail,
    dimensions: usize,
    scale: [f64; 2],
    shear: f64,
    centres: Vec<[f64; 2]>,
    weights: Vec<f64>,
    tail_weights: Vec<f64>,
    outputs: usize,
    smoothing: f64,
    condition: f64,
    residual: f64,
}

#[derive(Serialize, Deserialize)]
enum Hull {
    Interval([f64; 2]),
    Polygon(Vec<[f64; 2]>),
}

/// The header as version 2 has it; none when this version has no place for some of it.
pub(super) fn header(model: &ModelHeader) -> Option<Header> {
    let implied = InputSpec::pressure_and_gap();
    let same = |(a, b): (&InputSpec, &InputSpec)| a.name == b.name && a.unit == b.unit;
    let known = model.inputs.len() == implied.len() && model.inputs.iter().zip(&implied).all(same);
    Some(Header {
        actuator: model.actuator.clone(),
        fields: model.fields.clone(),
        node_count: model.node_count,
        regimes: model.regimes.iter().filter(|_| known).map(regime).collect::<Option<Vec<_>>>()?,
        onset: model.onset.clone(),
        hysteresis_mpa: model.hysteresis_mpa,
        node_sets: model.node_sets.clone(),
        database_hash: model.database_hash,
    })
    .filter(|_| known)
}

fn regime(model: &RegimeModel) -> Option<Regime> {
    let axis = |a: &InputAxis| Axis {
        quantity: if a.input == PRESSURE { Quantity::PressureMpa } else { Quantity::GapMm },
        min: a.min,
        max: a.max,
    };
    let group = |g: &GroupModel| Group {
        name: g.name.clone(),
        fields: g.fields.clone(),
        coefficients: g.coefficients.clone(),
        surrogate: surrogate(&g.surrogate),
        singular_values: g.singular_values.clone(),
    };
    let force = |f: &ForceModel| Force {
        surrogate: surrogate(&f.surrogate),
        times_excess_pressure: f.times_excess_pressure,
    };
    Some(Regime {
        kind: model.kind,
        axes: model.inputs.axes.iter().map(axis).collect(),
        constant_gap_mm: model.inputs.constants.iter().find(|c| c.0 == GAP).map(|c| c.1),
        groups: model.groups.iter().map(group).collect(),
        force: model.force.as_ref().map(force),
        domain: match &model.domain {
            Domain::Interval(ends) => Hull::Interval(*ends),
            Domain::Hull(vertices) => Hull::Polygon(vertices.clone()),
            Domain::Vertices { .. } => return None,
        },
        halfwidths: model.halfwidths,
        far_onset: model.far_onset.clone(),
    })
}

fn surrogate(fit: &Interpolant) -> Surrogate {
    let centre = |c: &[f64]| [c[0], c.get(1).copied().unwrap_or(0.0)];
    Surrogate {
        kernel: fit.kernel,
        tail: fit.tail,
        dimensions: fit.dimensions,
        scale: [fit.metric.scale[0], fit.metric.scale[1]],
        shear: fit.metric.shear,
        centres: fit.centres.chunks_exact(fit.dimensions).map(centre).collect(),
        weights: fit.weights.clone(),
        tail_weights: fit.tail_weights.clone(),
        outputs: fit.outputs,
        smoothing: fit.smoothing,
        condition: fit.condition,
        residual: fit.residual,
    }
}

impl From<Header> for ModelHeader {
    fn from(header: Header) -> Self {
        let regimes: Vec<RegimeModel> = header.regimes.into_iter().map(RegimeModel::from).collect();
        Self {
            actuator: header.actuator,
            inputs: InputSpec::ranged(InputSpec::pressure_and_gap(), regimes.iter().map(|r| &r.inputs)),
            fields: header.fields,
            node_count: header.node_count,
            regimes,
            onset: header.onset,
            hysteresis_mpa: header.hysteresis_mpa,
            node_sets: header.node_sets,
            database_hash: header.database_hash,
        }
    }
}

impl From<Regime> for RegimeModel {
    fn from(regime: Regime) -> Self {
        let axis = |a: &Axis| InputAxis {
            input: if matches!(a.quantity, Quantity::PressureMpa) { PRESSURE } else { GAP },
            min: a.min,
            max: a.max,
        };
        let group = |g: Group| GroupModel {
            name: g.name,
            fields: g.fields,
            coefficients: g.coefficients,
            surrogate: g.surrogate.into(),
            singular_values: g.singular_values,
        };
        let force = |f: Force| ForceModel {
            surrogate: f.surrogate.into(),
            times_excess_pressure: f.times_excess_pressure,
        };
        Self {
            kind: regime.kind,
            inputs: InputMap {
                axes: regime.axes.iter().map(axis).collect(),
                constants: regime.constant_gap_mm.map(|gap| (GAP, gap)).into_iter().collect(),
            },
            groups: regime.groups.into_iter().map(group).collect(),
            force: regime.force.map(force),
            domain: match regime.domain {
                Hull::Interval(ends) => Domain::Interval(ends),
                Hull::Polygon(vertices) => Domain::Hull(vertices),
            },
            halfwidths: regime.halfwidths,
            far_onset: regime.far_onset,
        }
    }
}

impl From<Surrogate> for Interpolant {
    fn from(fit: Surrogate) -> Self {
        let mut scale = [1.0; MAX_INPUTS];
        scale[..2].copy_from_slice(&fit.scale);
        Self {
            kernel: fit.kernel,
            tail: fit.tail,
            dimensions: fit.dimensions,
            metric: Metric { scale, shear: fit.shear },
            centres: fit.centres.iter().flat_map(|c| &c[..fit.dimensions.min(2)]).copied().collect(),
            weights: fit.weights,
            tail_weights: fit.tail_weights,
            outputs: fit.outputs,
            smoothing: fit.smoothing,
            condition: fit.condition,
            residual: fit.residual,
        }
    }
}
