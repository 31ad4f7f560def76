//! Version 2 of the model file's header: two inputs whose names the version implies. Points have two columns, the second 0
//! where a regime has one input. It is read, never written.

use super::header::{FarOnset, ForceModel, GroupModel, ModelHeader, OutputField, RegimeModel};
use crate::halfwidths::HalfWidths;
use crate::hull::Domain;
use crate::inputs::{GAP, InputAxis, InputMap, InputSpec, MAX_INPUTS, PRESSURE};
use crate::interpolant::{Interpolant, Metric};
use crate::radial::{KernelKind, Tail};
use crate::regime::OnsetTable;
use crate::snapshots::{NodeSet, RegimeKind};
use serde::Deserialize;
use std::ops::Range;

#[derive(Deserialize)]
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

#[derive(Deserialize)]
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

#[derive(Deserialize)]
struct Axis {
    quantity: Quantity,
    min: f64,
    max: f64,
}

#[derive(Deserialize)]
enum Quantity {
    PressureMpa,
    GapMm,
}

#[derive(Deserialize)]
struct Group {
    name: String,
    fields: Vec<usize>,
    coefficients: Range<usize>,
    surrogate: Surrogate,
    singular_values: Vec<f64>,
}

#[derive(Deserialize)]
struct Force {
    surrogate: Surrogate,
    times_excess_pressure: bool,
}

#[derive(Deserialize)]
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

#[derive(Deserialize)]
enum Hull {
    Interval([f64; 2]),
    Polygon(Vec<[f64; 2]>),
}

impl From<Header> for ModelHeader {
    fn from(header: Header) -> Self {
        let regimes: Vec<RegimeModel> = header.regimes.into_iter().map(RegimeModel::from).collect();
        Self {
            actuator: header.actuator,
            inputs: InputSpec::ranged(InputSpec::without_range(&[]), regimes.iter().map(|r| &r.inputs)),
            fields: header.fields,
            node_count: header.node_count,
            regimes,
            onset: header.onset,
            hysteresis_mpa: header.hysteresis_mpa,
            node_sets: header.node_sets,
            database_hash: header.database_hash,
            clearance: None,
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
            local_halfwidths: None,
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
            slopes: Vec::new(),
        }
    }
}
