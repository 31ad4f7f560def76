//! Fields, forces and contact sets of a solved state.

use crate::algebra::{Vec3, add, axpy, norm};
use crate::contact::Obstacle;
use crate::element::tet10::{self, PointTensors};
use crate::linear::CONSTRAINED;
use crate::problem::Problem;
use crate::state::State;
use crate::system::{Ahead, System, face};
use formats::FormatError;
use formats::export::{Label, Moment, StateSeries};
use formats::vtu::Cells;
use rom::snapshots::FieldSpec;
use std::path::Path;

/// Fields and figures of one state.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Output {
    /// Deformed node positions (mm).
    pub coordinates_mm: Vec<Vec3>,
    /// Displacement magnitude |U| at each node (mm).
    pub displacement_mm: Vec<f64>,
    /// Von Mises stress at each node (MPa): mean of the elements' values at the node.
    pub von_mises_mpa: Vec<f64>,
    /// Von Mises stress at each node (MPa) of the one element the mesh's `mises_owner` names; empty without it.
    pub von_mises_owner_mpa: Vec<f64>,
    /// Force of the base on the obstacle (N).
    pub contact_force_n: f64,
    /// Volume the cavity encloses (mm3).
    pub cavity_volume_mm3: f64,
    /// Nodes that touch plate or block.
    pub contact_nodes: Vec<u32>,
    /// Nodes of chamber walls that touch across a slot.
    pub slot_contact_nodes: Vec<u32>,
    /// Largest nodal force out of balance (N).
    pub residual_n: f64,
}

impl Output {
    /// Writes the fields in the format of the name's ending.
    ///
    /// # Errors
    /// Another ending; I/O errors.
    pub fn write(&self, problem: &Problem, label: Label, out: &Path) -> Result<(), FormatError> {
        let mesh = problem.mesh();
        let axis = |points: &[[f64; 3]], k: usize| points.iter().map(|p| p[k] as f32).collect::<Vec<f32>>();
        let mut values: Vec<f32> = (0..3).flat_map(|k| axis(&self.coordinates_mm, k)).collect();
        values.extend(self.displacement_mm.iter().chain(&self.von_mises_mpa).map(|v| *v as f32));
        let undeformed = [0, 1, 2].map(|k| axis(&mesh.nodes_mm, k));
        let series = StateSeries {
            fields: &FieldSpec::of_the_paper(),
            nodes: mesh.nodes_mm.len(),
            cells: Cells::QuadraticTets(&mesh.tets),
            undeformed: Some(undeformed.each_ref().map(Vec::as_slice)),
            count: 1,
        };
        // The mesh is that of this state's own parameters.
        series.write_state(out, &Moment { time: 0.0, label, values, moved: None })
    }
}

/// Distance below the undeformed base at which an obstacle just clears the state (mm).
pub(crate) fn clearance_mm(problem: &Problem, state: &State) -> f64 {
    let lowest = |n: &u32| -(problem.mesh.nodes_mm[*n as usize][1] + state.displacement_mm[*n as usize][1]);
    problem.contact_nodes.iter().map(lowest).fold(f64::NEG_INFINITY, f64::max)
}

/// Largest depth of the body behind its obstacle (mm): only the base's underside has contact.
pub(crate) fn depth_mm(problem: &Problem, state: &State) -> f64 {
    let Some(face) = face(problem, state.load.obstacle) else { return 0.0 };
    let nodes = problem.mesh.nodes_mm.iter().zip(&state.displacement_mm);
    nodes.map(|(x, u)| face.depth_mm(add(*x, *u))).fold(0.0, f64::max)
}

/// True if displacements `u` bring the base onto the obstacle.
pub(crate) fn touches(problem: &Problem, u: &[Vec3], obstacle: Obstacle) -> bool {
    let Some(face) = face(problem, obstacle) else { return false };
    let position = |n: u32| add(problem.mesh.nodes_mm[n as usize], u[n as usize]);
    problem.contact_nodes.iter().any(|n| face.touch(position(*n)).is_some())
}

/// Forces (N) of a state, with the carried stresses.
pub(crate) struct Balance {
    /// Largest force out of balance at a free node.
    pub(crate) residual_n: f64,
    /// Resultant of the support.
    reaction_n: f64,
    contact_force_n: f64,
}

/// Largest force out of balance of a solved state, relative to the larger of support reaction and obstacle force.
pub const MAX_RESIDUAL: f64 = 1.0e-5;

/// Reference force of a state without loads (N).
const MIN_REACTION_N: f64 = 1.0e-3;

impl Balance {
    /// The largest force out of balance relative to the larger of support reaction and obstacle force.
    pub(crate) fn relative(&self) -> f64 {
        self.residual_n / self.reaction_n.max(self.contact_force_n).max(MIN_REACTION_N)
    }
}

/// The balance of a state under its loads.
pub(crate) fn balance(problem: &Problem, state: &State, system: &mut System) -> Balance {
    if system.assemble(problem, state, &state.load, Ahead::default(), false).is_err() {
        return Balance { residual_n: f64::INFINITY, reaction_n: 0.0, contact_force_n: 0.0 };
    }
    let (mut residual_n, mut reaction) = (0.0_f64, [0.0; 3]);
    for (r, free) in system.mixed.iter().zip(problem.free.iter()) {
        if *free == CONSTRAINED {
            axpy(1.0, *r, &mut reaction);
        } else {
            residual_n = residual_n.max(norm(*r));
        }
    }
    Balance { residual_n, reaction_n: norm(reaction), contact_force_n: system.contact_force_n }
}

/// Output of a state; `system` is a workspace.
pub(crate) fn output(problem: &Problem, state: &State, system: &mut System) -> Output {
    let residual_n = balance(problem, state, system).residual_n;
    let coordinates_mm = problem.positions(&state.displacement_mm);
    let (von_mises_mpa, von_mises_owner_mpa) = von_mises(problem, state);
    let mut contact_nodes = Vec::new();
    if let Some(face) = face(problem, state.load.obstacle) {
        let touches = |n: &&u32| face.touch(coordinates_mm[**n as usize]).is_some();
        contact_nodes = problem.contact_nodes.iter().filter(touches).copied().collect();
    }
    Output {
        displacement_mm: state.displacement_mm.iter().map(|u| norm(*u)).collect(),
        von_mises_mpa,
        von_mises_owner_mpa,
        contact_force_n: system.contact_force_n,
        cavity_volume_mm3: system.cavity_volumes_mm3[0],
        contact_nodes,
        slot_contact_nodes: slot_contact_nodes(problem, &coordinates_mm),
        residual_n,
        coordinates_mm,
    }
}

fn slot_contact_nodes(problem: &Problem, x: &[Vec3]) -> Vec<u32> {
    let smoothing = problem.config.contact.slot_smoothing_mm;
    let touching = problem.slots.iter().flat_map(|walls| walls.contacts(x, smoothing));
    let mut nodes: Vec<u32> = touching.flat_map(|contact| contact.pair.nodes).collect();
    nodes.sort_unstable();
    nodes.dedup();
    nodes
}

/// Nodal von Mises stress: mean over the elements, and by owner where the mesh names one.
fn von_mises(problem: &Problem, state: &State) -> (Vec<f64>, Vec<f64>) {
    let (mean, elements) = mean_von_mises(problem, &state.displacement_mm, None);
    let owner = |o: &Option<(u32, u8)>| o.map_or(0.0, |(e, local)| elements[e as usize][usize::from(local)]);
    let owned = problem.mesh.mises_owner.as_ref().map_or_else(Vec::new, |o| o.iter().map(owner).collect());
    (mean, owned)
}

/// Nodal von Mises stress (MPa) of displacements `u`: the mean over the elements at a node, and each element's own.
/// `overstress_mpa` is the viscous part of each element's stress.
pub(crate) fn mean_von_mises(
    problem: &Problem,
    displacement_mm: &[Vec3],
    overstress_mpa: Option<&[PointTensors]>,
) -> (Vec<f64>, Vec<[f64; 10]>) {
    let nodes = problem.mesh.nodes_mm.len();
    let (mut sum, mut count) = (vec![0.0; nodes], vec![0.0; nodes]);
    let mut elements = Vec::with_capacity(problem.mesh.tets.len());
    for (e, tet) in problem.mesh.tets.iter().enumerate() {
        let u = tet.map(|n| displacement_mm[n as usize]);
        let law = &problem.elastomer(e).law;
        let mut stress = tet10::deviatoric_stress(&problem.tets[e], &u, law).unwrap_or([[f64::NAN; 6]; 4]);
        if let Some(over) = overstress_mpa {
            let over = tet10::cauchy_of_stress(&problem.tets[e], &u, &over[e]);
            stress.as_flattened_mut().iter_mut().zip(over.as_flattened()).for_each(|(s, o)| *s += o);
        }
        let values = tet10::extrapolate(stress).map(tet10::von_mises);
        for (n, v) in tet.iter().zip(values) {
            sum[*n as usize] += v;
            count[*n as usize] += 1.0;
        }
        elements.push(values);
    }
    for (s, c) in sum.iter_mut().zip(count) {
        *s /= c;
    }
    (sum, elements)
}
