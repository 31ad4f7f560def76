//! Positions of single points of the mesh, such as camera markers, with their derivatives with respect to all inputs, in f64.
//!
//! A point is a weighted mean of nodes, `x(p) = sum_i w_i x_i`, whose weights are those of the undeformed mesh. Each node's
//! coordinate is affine in the modal coefficients, `x_i = m_i + sum_k c_k phi_ik` (the paper's Eq. 6), so that
//! `dx/dp = sum_i w_i sum_k phi_ik dc_k/dp`. Modes and interpolation are multiplied once (`contract.rs`).

use crate::affine::Affine;
use crate::contract::{self, Output};
use crate::dense::Dense;
use crate::evaluation::Evaluation;
use crate::evaluator::{Evaluator, Query, Until};
use crate::inertia::data::InertiaModel;
use crate::inertia::manifold::Amplitudes;
use crate::inputs::{Inputs, MAX_INPUTS};
use crate::model::{BlockKind, Model, ModelError, RegimeModel};
use crate::snapshots::RegimeKind;
use thiserror::Error;

/// Nodes that a point's weights are spread over.
const NEIGHBOURS: usize = 12;
/// A point farther from every node than this is not on the mesh (mm).
const MAX_DISTANCE_MM: f64 = 4.0;
/// A point so near a node is that node (mm).
const SAME_NODE_MM: f64 = 1e-3;

/// Distance from the largest x within which a node belongs to the end face (mm).
const END_MM: f64 = 0.01;

/// The tip of an actuator along x: the node nearest to the middle of its end face. None without nodes.
pub fn tip_node(nodes_mm: &[[f64; 3]]) -> Option<usize> {
    let end_mm = nodes_mm.iter().map(|p| p[0]).fold(f64::NEG_INFINITY, f64::max) - END_MM;
    let end: Vec<usize> = (0..nodes_mm.len()).filter(|n| nodes_mm[*n][0] >= end_mm).collect();
    let middle = [0, 1, 2].map(|k| end.iter().map(|n| nodes_mm[*n][k]).sum::<f64>() / end.len() as f64);
    let square = |n: usize| -> f64 { nodes_mm[n].iter().zip(middle).map(|(a, b)| (a - b) * (a - b)).sum() };
    end.into_iter().min_by(|a, b| square(*a).total_cmp(&square(*b)))
}

/// [`tip_node`] of a model's undeformed mesh. None without one.
pub fn model_tip(model: &Model) -> Option<usize> {
    let nodes_mm: Vec<[f64; 3]> =
        model.undeformed_nodes_mm()?.iter().map(|node| node.map(f64::from)).collect();
    tip_node(&nodes_mm)
}

/// A point of the mesh: nodes and their weights, which add up to 1.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshPoint {
    /// Node and weight.
    pub weights: Vec<(u32, f64)>,
}

/// Why a point has no position.
#[derive(Clone, Debug, Error, PartialEq)]
#[allow(missing_docs)] // the messages say what the values are
pub enum PointError {
    /// The node does not exist.
    #[error("node {found}: the mesh has {count} nodes, numbered from 0")]
    NoNode { found: u32, count: usize },
    /// The point is not on the mesh.
    #[error(
        "[{:.2}, {:.2}, {:.2}] mm is {distance_mm:.2} mm from the nearest node, at [{:.2}, {:.2}, {:.2}] mm; expected a point of \
         the undeformed mesh",
        at_mm[0], at_mm[1], at_mm[2], nearest_mm[0], nearest_mm[1], nearest_mm[2]
    )]
    OffMesh { at_mm: [f64; 3], nearest_mm: [f64; 3], distance_mm: f64 },
    /// The nodes around the point do not span it.
    #[error("the nodes around [{:.2}, {:.2}, {:.2}] mm give {found_mm:.4} mm away from it; name a node instead", at_mm[0], at_mm[1], at_mm[2])]
    NotSpanned { at_mm: [f64; 3], found_mm: f64 },
    /// The node set does not exist.
    #[error("the model has no node set {found:?}; it has {}", .known.join(", "))]
    NoSet { found: String, known: Vec<String> },
    /// The model file has no undeformed mesh.
    #[error("the model has no undeformed coordinates; name a node instead of a point")]
    NoMesh,
}

impl MeshPoint {
    /// A node.
    ///
    /// # Errors
    /// [`PointError::NoNode`].
    pub fn node(model: &Model, node: u32) -> Result<Self, PointError> {
        let count = model.header.node_count;
        if node as usize >= count {
            return Err(PointError::NoNode { found: node, count });
        }
        Ok(Self { weights: vec![(node, 1.0)] })
    }

    /// Mean of a node set.
    ///
    /// # Errors
    /// [`PointError::NoSet`].
    pub fn of_set(model: &Model, name: &str) -> Result<Self, PointError> {
        let sets = &model.header.node_sets;
        let set = sets.iter().find(|set| set.name == name && !set.nodes.is_empty());
        let set = set.ok_or_else(|| PointError::NoSet {
            found: name.to_owned(),
            known: sets.iter().map(|set| set.name.clone()).collect(),
        })?;
        let weight = 1.0 / set.nodes.len() as f64;
        Ok(Self { weights: set.nodes.iter().map(|node| (*node, weight)).collect() })
    }

    /// The point at undeformed coordinates (mm): the smallest weights of near nodes, by distance, that give its place.
    ///
    /// # Errors
    /// [`PointError`] when it is not on the mesh or the model has none.
    pub fn at(model: &Model, at_mm: [f64; 3]) -> Result<Self, PointError> {
        let mesh = model.undeformed_mm().ok_or(PointError::NoMesh)?;
        let place = |node: usize| mesh.map(|axis| f64::from(axis[node]));
        let square =
            |node: usize| -> f64 { place(node).iter().zip(at_mm).map(|(x, p)| (x - p) * (x - p)).sum() };
        let mut nodes: Vec<(f64, usize)> = (0..model.header.node_count).map(|n| (square(n), n)).collect();
        nodes.sort_by(|a, b| a.0.total_cmp(&b.0));
        nodes.truncate(NEIGHBOURS);
        let Some((nearest, node)) = nodes.first().copied() else { return Err(PointError::NoMesh) };
        let distance_mm = nearest.sqrt();
        if distance_mm < SAME_NODE_MM {
            return Self::node(model, node as u32);
        }
        if distance_mm.is_nan() || distance_mm > MAX_DISTANCE_MM {
            return Err(PointError::OffMesh { at_mm, nearest_mm: place(node), distance_mm });
        }
        let weights = linear_weights(&nodes, place, at_mm);
        let mean = |axis: usize| -> f64 {
            weights.iter().map(|(n, w)| w * f64::from(mesh[axis][*n as usize])).sum()
        };
        let found_mm = (0..3).map(|a| (mean(a) - at_mm[a]).powi(2)).sum::<f64>().sqrt();
        if found_mm.is_nan() || found_mm >= SAME_NODE_MM {
            return Err(PointError::NotSpanned { at_mm, found_mm });
        }
        Ok(Self { weights })
    }
}

/// Weights that reproduce linear functions: smallest `sum w^2 d^2` under `sum w = 1`, `sum w x = p`.
fn linear_weights(
    nodes: &[(f64, usize)],
    place: impl Fn(usize) -> [f64; 3],
    at_mm: [f64; 3],
) -> Vec<(u32, f64)> {
    let scale = nodes.last().map_or(1.0, |(square, _)| square.sqrt());
    let terms = |node: usize| {
        let x = place(node);
        [1.0, (x[0] - at_mm[0]) / scale, (x[1] - at_mm[1]) / scale, (x[2] - at_mm[2]) / scale]
    };
    let mut normal = Dense::zeros(4);
    for (square, node) in nodes {
        let t = terms(*node);
        for i in 0..4 {
            for j in 0..4 {
                normal[(i, j)] += t[i] * t[j] / square;
            }
        }
    }
    // Nodes in one plane span the point in it; the ridge keeps the missing direction out.
    let ridge = 1e-12 * (0..4).map(|i| normal[(i, i)]).sum::<f64>();
    (0..4).for_each(|i| normal[(i, i)] += ridge);
    let mut multipliers = [1.0, 0.0, 0.0, 0.0];
    if normal.solve(&mut multipliers, 1).is_none() {
        return Vec::new();
    }
    let weight = |(square, node): &(f64, usize)| {
        let t = terms(*node);
        (*node as u32, (0..4).map(|i| t[i] * multipliers[i]).sum::<f64>() / square)
    };
    nodes.iter().map(weight).collect()
}

/// Position of a point and its derivatives.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ProbePosition {
    /// Deformed position (mm).
    pub position_mm: [f64; 3],
    /// Derivatives per axis and input, in mm per unit of the input.
    pub gradient: [[f64; MAX_INPUTS]; 3],
}

/// The part of a model that moves some points: force, regime and the points' positions, nothing else.
#[derive(Clone, Debug)]
pub struct Probes {
    evaluator: Evaluator,
    /// Per regime: mean and first coefficient of each coordinate of each point.
    regimes: Vec<(RegimeKind, Vec<(f64, usize)>)>,
    /// Per regime of a model with inertia: shape of each linear mode at the points.
    modes: Vec<(RegimeKind, Vec<Vec<[f64; 3]>>)>,
    inputs: usize,
}

impl Probes {
    /// Takes means and modes of the points' nodes. The model's coordinate blocks must be loaded.
    ///
    /// # Errors
    /// [`ModelError`] when a block is missing or the header contradicts itself.
    pub fn new(model: &Model, points: &[MeshPoint]) -> Result<Self, ModelError> {
        let (mut means, mut outputs) = (Vec::new(), Vec::new());
        let inertia = model.record::<InertiaModel>(BlockKind::Inertia);
        let inertia = inertia.map_err(|error| ModelError::Inconsistent(error.to_string()))?;
        let inertia = inertia.as_ref().map_or(&[][..], |inertia| &inertia.regimes);
        let mut modes: Vec<(RegimeKind, Vec<Vec<[f64; 3]>>)> = inertia
            .iter()
            .map(|regime| (regime.kind, vec![vec![[0.0; 3]; points.len()]; regime.modes.len()]))
            .collect();
        for regime in &model.header.regimes {
            // Axis by axis: groups with one kernel are consecutive.
            let (mut of_points, mut of_axes) = (vec![[0.0; 3]; points.len()], Vec::new());
            for axis in 0..3 {
                for (index, (point, mean)) in points.iter().zip(&mut of_points).enumerate() {
                    let (value, group, weights) = coordinate(model, regime, point, axis)?;
                    mean[usize::from(axis)] = value;
                    let mut stored =
                        inertia.iter().zip(&mut modes).find(|(moving, _)| moving.kind == regime.kind);
                    for (mode, shape) in
                        stored.iter_mut().flat_map(|(moving, (_, shapes))| moving.modes.iter().zip(shapes))
                    {
                        let own = &mode.coefficients[regime.groups[group].coefficients.clone()];
                        shape[index][usize::from(axis)] = own.iter().zip(&weights).map(|(c, w)| c * w).sum();
                    }
                    of_axes.push(Output { parts: vec![(group, weights)] });
                }
            }
            means.push(of_points);
            outputs.push(of_axes);
        }
        let (header, places) = contract::contracted(&model.header, &outputs);
        let count = points.len();
        let place = |((regime, means), places): ((&RegimeModel, &Vec<[f64; 3]>), &Vec<usize>)| {
            let of_point =
                |(point, mean): (usize, &[f64; 3])| [0, 1, 2].map(|a| (mean[a], places[a * count + point]));
            (regime.kind, means.iter().enumerate().flat_map(of_point).collect())
        };
        let regimes = model.header.regimes.iter().zip(&means).zip(&places).map(place).collect();
        Ok(Self {
            evaluator: Evaluator::new(&header)?.for_search(),
            regimes,
            modes,
            inputs: header.inputs.len(),
        })
    }

    /// Evaluation with capacity for any state.
    pub fn evaluation(&self) -> Evaluation {
        self.evaluator.evaluation()
    }

    /// Force, regime and gradients of a state, as the query asks for them, and the points' positions, one for each point; NaN when the
    /// model was not trained in its regime. The evaluation's coefficients are no modal coefficients. Allocates nothing.
    pub fn answer(
        &self,
        inputs: Inputs,
        query: Query<'_>,
        evaluation: &mut Evaluation,
        out: &mut [ProbePosition],
    ) {
        self.evaluator.answer(inputs, Query { until: Until::Gradients, ..query }, evaluation);
        let rows = self.regimes.iter().find(|(kind, _)| *kind == evaluation.regime);
        let mut rows = rows.map_or(&[][..], |(_, rows)| rows).as_chunks::<3>().0.iter();
        for out in out {
            *out = ProbePosition { position_mm: [f64::NAN; 3], gradient: [[f64::NAN; MAX_INPUTS]; 3] };
            let Some(axes) = rows.next() else { continue };
            for ((x, gradient), (mean, at)) in out.position_mm.iter_mut().zip(&mut out.gradient).zip(axes) {
                *x = mean + evaluation.coefficients[*at];
                *gradient = [0.0; MAX_INPUTS];
                for (input, by) in gradient.iter_mut().enumerate().take(self.inputs) {
                    *by = evaluation.coefficient_gradient(input)[*at];
                }
            }
        }
    }

    /// Adds linear modes with these amplitudes to the points of a regime.
    pub fn add_modes(&self, regime: RegimeKind, amplitudes: &Amplitudes, out: &mut [ProbePosition]) {
        let modes = self.modes.iter().find(|(kind, _)| *kind == regime);
        for (mode, y) in modes.iter().flat_map(|(_, modes)| modes).zip(amplitudes) {
            for (point, shape) in out.iter_mut().zip(mode) {
                point.position_mm.iter_mut().zip(shape).for_each(|(x, by)| *x += y * by);
            }
        }
    }

    /// [`Evaluator::closed_gap_mm`] of the model.
    pub fn closed_gap_mm(&self, inputs: Inputs, scratch: &mut Evaluation) -> Option<f64> {
        self.evaluator.closed_gap_mm(inputs, scratch)
    }
}

/// Mean of a point's coordinate, its group, and the weight of each of the group's coefficients.
pub(crate) fn coordinate(
    model: &Model,
    regime: &RegimeModel,
    point: &MeshPoint,
    axis: u8,
) -> Result<(f64, usize, Vec<f64>), ModelError> {
    let nodes = model.header.node_count;
    let field = model.header.coordinate_field(axis).ok_or_else(|| ModelError::MissingBlock {
        block: format!("coordinate {axis}"),
        expected: nodes,
        found: 0,
    });
    field_at(model, regime, point, field?)
}

/// [`coordinate`] as a function of all coefficients.
pub(crate) fn affine_coordinate(
    model: &Model,
    regime: &RegimeModel,
    point: &MeshPoint,
    axis: u8,
) -> Result<Affine, ModelError> {
    let (mean, group, weights) = coordinate(model, regime, point, axis)?;
    let first = regime.groups.get(group).map_or(0, |group| group.coefficients.start);
    Ok(Affine { mean, first, weights })
}

/// [`coordinate`] of any field that is interpolated.
pub(crate) fn field_at(
    model: &Model,
    regime: &RegimeModel,
    point: &MeshPoint,
    field: usize,
) -> Result<(f64, usize, Vec<f64>), ModelError> {
    let nodes = model.header.node_count;
    let missing = |block: String, found: usize| ModelError::MissingBlock { block, expected: nodes, found };
    let group = regime.groups.iter().position(|group| group.fields.contains(&field));
    let group = group.ok_or_else(|| missing(format!("group of field {field}"), 0))?;
    let (kind, field) = (regime.kind, field as u32);
    let mean = model.mean(kind, field).unwrap_or(&[]);
    if mean.len() != nodes {
        return Err(missing(format!("mean of field {field}"), mean.len()));
    }
    let modes = model.modes(kind, field)?;
    let weighted = |value: &dyn Fn(usize) -> f64| -> f64 {
        point.weights.iter().map(|(node, weight)| weight * value(*node as usize)).sum()
    };
    let weights = (0..regime.groups[group].coefficients.len())
        .map(|mode| weighted(&|node| modes.value(mode, node)))
        .collect();
    Ok((weighted(&|node| f64::from(mean[node])), group, weights))
}
