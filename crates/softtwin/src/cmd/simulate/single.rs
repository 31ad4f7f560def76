//! One state, or a path of states from rest.

use crate::failure::{configuration, usage};
use crate::output;
use crate::progress::Doing;
use anyhow::Context;
use fem::MM3_PER_MG;
use fem::actuator::{Actuator, Setting, mesh_quality};
use fem::{Family, Load, Output, Problem, SolveError, SolveReport, Solver, State};
use formats::export::{Label, StateFormat};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// Given quantity.
#[derive(Clone, Copy, Debug)]
pub enum Driven {
    /// Cavity pressure (MPa).
    Pressure(f64),
    /// Injected volume (mm3).
    Volume(f64),
    /// Gas added to the cavity and a supply (mg), and the volume of the supply (mm3).
    Gas(f64, f64),
}

impl Driven {
    /// Loads at a fraction of it.
    fn load(self, actuator: &Actuator, gap_mm: Option<f64>, fraction: f64) -> Load {
        match self {
            Self::Pressure(pressure_mpa) => actuator.load(fraction * pressure_mpa, gap_mm),
            Self::Volume(volume_mm3) => {
                Load { injected_mm3: Some(fraction * volume_mm3), ..actuator.load(0.0, gap_mm) }
            }
            Self::Gas(mg, dead_mm3) => Load {
                injected_mm3: Some(fraction * mg * MM3_PER_MG),
                dead_mm3: Some(dead_mm3),
                ..actuator.load(0.0, gap_mm)
            },
        }
    }
}

/// What `simulate` is asked for one state.
pub struct StaticLoad {
    /// Pressure or volume at the end.
    pub driven: Driven,
    pub gap_mm: Option<f64>,
    /// Steps from rest.
    pub steps: u32,
    /// Print which nodes touch, besides how many.
    pub node_sets: bool,
    /// Quantities of the actuator with other values than its file's.
    pub settings: Vec<Setting>,
}

/// What a step has reached. The last four numbers are of all steps so far.
#[derive(Serialize)]
struct StepReport<'a> {
    pressure_mpa: f64,
    gap_mm: Option<f64>,
    contact_force_n: f64,
    cavity_volume_mm3: f64,
    /// Volume that was added to the cavity.
    volume_mm3: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    gas_mg: Option<f64>,
    max_displacement_mm: f64,
    max_von_mises_mpa: f64,
    largest_stretch: f64,
    /// Share of the body that is stretched further than its law was fitted.
    beyond_law_percent: f64,
    lowest_point_mm: f64,
    contact_nodes: usize,
    slot_contact_nodes: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    contact_node_set: Option<&'a Vec<u32>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    slot_contact_node_set: Option<&'a Vec<u32>>,
    /// Quantities that have other values than in the actuator's file, and the mesh that they make.
    #[serde(skip_serializing_if = "Option::is_none")]
    set: Option<BTreeMap<&'a str, f64>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    mesh_quality: Option<MeshQuality>,
    residual_n: f64,
    steps: usize,
    factorisations: usize,
    cuts: usize,
    seconds: f64,
}

/// Quality of the elements, 1 for a regular tetrahedron.
#[derive(Serialize)]
struct MeshQuality {
    least: f64,
    mean: f64,
}

/// Solves step by step, prints a JSON line a step and writes the last state. The first step starts from its state on the last of the
/// coarse meshes, if there are any, otherwise from rest.
pub fn run(
    family: &Family,
    coarse: &[Family],
    target: &StaticLoad,
    out: Option<&Path>,
) -> anyhow::Result<()> {
    if let Some(out) = out {
        StateFormat::of(out).map_err(usage)?; // before the work, not after it
    }
    let variant = family.variant(&target.settings).map_err(configuration)?;
    let problem = family.problem_of(&variant).map_err(configuration)?;
    let actuator = family.actuator_of(&variant).map_err(configuration)?;
    let quality =
        (!target.settings.is_empty()).then(|| mesh_quality(problem.mesh(), &problem.mesh().nodes_mm));
    let doing = Doing::default();
    let _heartbeat = doing.heartbeat();
    let load =
        |step: u32| target.driven.load(&actuator, target.gap_mm, f64::from(step) / f64::from(target.steps));
    let mut solver = Solver::new(Arc::clone(&problem))?;
    doing.begin("solving under gravity");
    let (mut state, mut work) = if coarse.is_empty() {
        solver.gravity_equilibrium(actuator.loads.gravity_mm_s2)?
    } else {
        begun(coarse, target, &load(1), &solver, &doing)?
    };
    for step in 1..=target.steps {
        let load = load(step);
        doing.begin(format!("solving step {step} of {}", target.steps));
        let (next, report) = solver.solve_to(&state, &load).map_err(sorted)?;
        state = next;
        work = work.and(&report);
        let output = solver.output(&state);
        let stretches = problem.stretches(&state);
        if let Some(warning) = problem.stretch_warning(stretches) {
            tracing::warn!("{warning}");
        }
        let largest = |values: &[f64]| values.iter().copied().fold(0.0, f64::max);
        let gas_mm3 = load.dead_mm3.and(load.injected_mm3);
        let set = || target.settings.iter().map(|(name, value)| (name.as_str(), *value)).collect();
        output::json(&StepReport {
            pressure_mpa: state.load.pressure_mpa,
            gap_mm: state.load.obstacle.gap_mm(),
            contact_force_n: output.contact_force_n,
            cavity_volume_mm3: output.cavity_volume_mm3,
            volume_mm3: solver.injected_mm3(&state),
            gas_mg: gas_mm3.map(|mm3| mm3 / MM3_PER_MG),
            max_displacement_mm: largest(&output.displacement_mm),
            max_von_mises_mpa: largest(&output.von_mises_mpa),
            largest_stretch: stretches.largest,
            beyond_law_percent: 100.0 * stretches.beyond,
            lowest_point_mm: -solver.clearance_mm(&state),
            contact_nodes: output.contact_nodes.len(),
            slot_contact_nodes: output.slot_contact_nodes.len(),
            contact_node_set: target.node_sets.then_some(&output.contact_nodes),
            slot_contact_node_set: target.node_sets.then_some(&output.slot_contact_nodes),
            set: quality.map(|_| set()),
            mesh_quality: quality.map(|(least, mean)| MeshQuality { least, mean }),
            residual_n: output.residual_n,
            steps: work.steps,
            factorisations: work.factorisations,
            cuts: work.cuts,
            seconds: work.seconds,
        })?;
        if let (true, Some(out)) = (step == target.steps, out) {
            output
                .write(&problem, label(target, &state.load, &output), out)
                .context("the state was not written")?;
        }
    }
    Ok(())
}

/// The state at a load on the coarse meshes, one after the other, interpolated to the mesh of `fine`.
fn begun(
    coarse: &[Family],
    target: &StaticLoad,
    load: &Load,
    fine: &Solver,
    doing: &Doing,
) -> anyhow::Result<(State, SolveReport)> {
    let mut before: Option<(Arc<Problem>, State)> = None;
    let mut work = SolveReport::default();
    let onto = |solver: &Solver, (problem, state): &(Arc<Problem>, State)| {
        solver.transferred(problem, state).ok_or_else(|| {
            usage("--coarse-mesh: expected meshes of the same body; the next one reaches beyond one of them")
        })
    };
    for (k, family) in coarse.iter().enumerate() {
        doing.begin(format!("solving on coarse mesh {} of {}", k + 1, coarse.len()));
        let variant = family.variant(&target.settings).map_err(configuration)?;
        let problem = family.problem_of(&variant).map_err(configuration)?;
        let mut solver = Solver::new(Arc::clone(&problem))?;
        let (start, to_start) = match &before {
            Some(before) => (onto(&solver, before)?, SolveReport::default()),
            None => solver.gravity_equilibrium(load.gravity_mm_s2)?,
        };
        let (state, report) = solver.solve_to(&start, load).map_err(sorted)?;
        work = work.and(&to_start).and(&report);
        before = Some((problem, state));
    }
    let last = before.ok_or_else(|| usage("--coarse-mesh: expected a mesh"))?;
    Ok((onto(fine, &last)?, work))
}

/// A load that the solver does not take is the user's mistake; a state it cannot reach is not.
pub fn sorted(error: SolveError) -> anyhow::Error {
    match error {
        SolveError::Load { .. } => usage(error),
        _ => error.into(),
    }
}

/// Description of the state in the file: options and resulting force.
fn label(target: &StaticLoad, load: &Load, output: &Output) -> Label {
    let settings = target.settings.iter().cloned();
    Label::of_state(load.pressure_mpa, target.gap_mm, settings, output.contact_force_n)
}
