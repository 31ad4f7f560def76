//! Onset pressure from the free model: the pressure at which its lowest node above the obstacle reaches it. Without parameters a
//! table over the gap, with parameters a solver.

use crate::config::TrainConfig;
use crate::error::{OnsetError, TrainError};
use crate::group::Plan;
use crate::regime::{OnsetModel, TrainedRegime};
use crate::sort::TrainingCases;
use rom::clearance::OnsetSolver;
use rom::inputs::{Inputs, PARAMETERS, PRESSURE};
use rom::model::Clearance;
use rom::regime::OnsetTable;
use rom::snapshots::{Database, Footprint};

/// Pressures at which the free model is evaluated.
const STEPS: usize = 240;
/// Pressures per sampled set of parameters.
const COARSE_STEPS: usize = 12;
/// Distance from the lowest node in some state within which a node may be the lowest in another, mm.
const NEAR_MM: f64 = 0.05;
/// Way down below which a way up counts as lifting, as a fraction of it.
const LIFTING: f64 = 0.5;
/// Largest number of nodes of the solver.
const MAX_NODES: usize = 512;

/// Derives the onset for pressures from 0 to the largest one sampled.
pub(crate) fn derive(
    database: &Database,
    config: &TrainConfig,
    plan: &Plan,
    free: &TrainedRegime,
    sorted: &TrainingCases,
) -> Result<OnsetModel, TrainError> {
    let [x, y, z] = [0, 1, 2].map(|axis| database.coordinate(axis).ok_or(OnsetError::NoCoordinate { axis }));
    let coordinates = [x?, y?, z?];
    let obstacle = config.obstacle.unwrap_or(database.obstacle);
    let nominal: Vec<f64> = database.parameters.iter().map(|p| p.nominal).collect();
    let inputs_at = |pressure: f64, parameters: &[f64]| {
        let inputs = Inputs::new(pressure, 0.0);
        parameters.iter().enumerate().fold(inputs, |inputs, (i, v)| inputs.with(PARAMETERS + i, *v))
    };
    let max_mpa = sorted.max_pressure_mpa;
    let (mut gaps, mut pressures): (Vec<f64>, Vec<f64>) = (Vec::new(), Vec::new());
    let mut highest = f64::NEG_INFINITY;
    for step in 0..=STEPS {
        let pressure = max_mpa * step as f64 / STEPS as f64;
        let heights = Heights::new(plan, free, coordinates, &obstacle, &inputs_at(pressure, &nominal));
        let lowest = heights.lowest();
        highest = highest.max(lowest);
        // Only a new lowest point closes a gap that was open before: the table stays monotone.
        if lowest.is_finite() && gaps.last().is_none_or(|deepest| -lowest > deepest + 1e-9) {
            gaps.push(-lowest);
            pressures.push(pressure);
        }
    }
    if let (Some(at_rest), Some(deepest)) = (gaps.first(), gaps.last())
        && deepest - at_rest < LIFTING * (highest + at_rest)
    {
        return Err(OnsetError::Lifts { by_mm: highest + at_rest }.into());
    }
    if gaps.len() < 2 {
        let Footprint { x_mm, z_mm, .. } = obstacle;
        return Err(OnsetError::TooFewDepths { count: gaps.len(), x_mm, z_mm }.into());
    }
    let table = OnsetTable::new(gaps, pressures);
    if free.inputs.axes.iter().all(|axis| axis.input == PRESSURE) {
        return Ok(OnsetModel { table, solver: None, crossings: 0 });
    }
    let mut sampled: Vec<&[f64]> =
        sorted.free.iter().chain(&sorted.contact).map(|&i| database.cases[i].parameters.as_slice()).collect();
    sampled.sort_by(|a, b| a.partial_cmp(b).unwrap_or(std::cmp::Ordering::Equal));
    sampled.dedup();
    let (mut near, mut crossings) = (vec![f64::INFINITY; database.node_count], 0);
    for parameters in sampled {
        for step in 0..=COARSE_STEPS {
            let pressure = max_mpa * step as f64 / COARSE_STEPS as f64;
            let heights = Heights::new(plan, free, coordinates, &obstacle, &inputs_at(pressure, parameters));
            let lowest = heights.lowest();
            crossings += usize::from(heights.y.iter().any(|y| *y < lowest - NEAR_MM));
            for (near, (y, above)) in near.iter_mut().zip(heights.y.iter().zip(&heights.above)) {
                *near = if *above { near.min(y - lowest) } else { *near };
            }
        }
    }
    let mut nodes: Vec<usize> = (0..near.len()).filter(|i| near[*i] <= NEAR_MM).collect();
    nodes.sort_by(|a, b| near[*a].total_cmp(&near[*b]).then(a.cmp(b)));
    nodes.truncate(MAX_NODES);
    let clearance = heights_of_nodes(plan, free, coordinates[1], &nodes, max_mpa, table.bend_per_mm);
    let solver = OnsetSolver::new(clearance, &free.model(plan));
    Ok(OnsetModel { table, solver: Some(solver), crossings })
}

fn heights_of_nodes(
    plan: &Plan,
    free: &TrainedRegime,
    y: usize,
    nodes: &[usize],
    max_pressure_mpa: f64,
    bend_per_mm: f64,
) -> Clearance {
    let (group, at) = plan.find(y).unwrap_or_default();
    let fit = &free.groups[group];
    let first = at * (fit.compact.mean.len() / plan.groups[group].fields.len());
    let row = |node: &usize| (0..fit.choice.modes).map(|k| fit.basis[(first + node, k)]).collect::<Vec<_>>();
    Clearance {
        max_pressure_mpa,
        bend_per_mm,
        group,
        mean_mm: nodes.iter().map(|node| fit.compact.mean[first + node]).collect(),
        modes: nodes.iter().flat_map(row).collect(),
    }
}

/// Heights of all nodes in a free state, and whether each is above the obstacle.
struct Heights {
    y: Vec<f64>,
    above: Vec<bool>,
}

impl Heights {
    fn new(plan: &Plan, free: &TrainedRegime, fields: [usize; 3], obstacle: &Footprint, at: &Inputs) -> Self {
        let [xs, y, zs] = fields.map(|f| free.field(plan, f, at));
        let within = |range: [f64; 2], v: f64| (range[0]..=range[1]).contains(&v);
        let above = xs.iter().zip(&zs).map(|(x, z)| within(obstacle.x_mm, *x) && within(obstacle.z_mm, *z));
        Self { above: above.collect(), y }
    }

    /// Height of the lowest node above the obstacle; infinite without one.
    fn lowest(&self) -> f64 {
        let above = self.y.iter().zip(&self.above).filter(|(_, above)| **above);
        above.map(|(y, _)| *y).fold(f64::INFINITY, f64::min)
    }
}
