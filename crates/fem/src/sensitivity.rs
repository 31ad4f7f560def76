//! Derivatives of a state with respect to its inputs, from the factorised tangent: `K du/dp = dR/dp`.
//!
//! `R` is the residual with pressures and resultants that follow from the displacements, `dR/dp` its central difference at
//! fixed displacements over inputs a tiny step apart (exact for loads, whose residual is linear or piecewise quadratic).
//! The motion of the reference mesh is part of the derivative: coordinates are `x = X + u`.

use crate::algebra::{Vec3, add, axpy, norm};
use crate::config::Load;
use crate::linear::CONSTRAINED;
use crate::newton::NewtonError;
use crate::output::mean_von_mises;
use crate::problem::Problem;
use crate::solver::Solver;
use crate::state::State;
use crate::system::{Ahead, face};
use std::sync::Arc;

/// Largest displacement of the differences that follow the fields along a derivative (mm).
const DIFFERENCE_MM: f64 = 1.0e-5;

/// Fraction of the penalty's stiffness below which a node has just begun to touch.
const EDGE_STIFFNESS: f64 = 0.05;

/// Input with bodies and loads one step below and above the state's.
#[derive(Clone, Debug)]
pub struct Change {
    /// The step, in the input's unit.
    pub step: f64,
    /// Body and loads at the input minus a step.
    pub below: (Arc<Problem>, Load),
    /// Body and loads at the input plus a step.
    pub above: (Arc<Problem>, Load),
}

/// Derivative of a state with respect to one input, per unit of the input.
#[derive(Clone, Debug, PartialEq)]
pub struct Sensitivity {
    /// Derivative of the deformed node positions (mm).
    pub coordinates_mm: Vec<Vec3>,
    /// Derivative of the mean von Mises stress at the nodes (MPa).
    pub von_mises_mpa: Vec<f64>,
    /// Derivative of the force on the obstacle (N).
    pub contact_force_n: f64,
}

impl Solver {
    /// Derivatives with respect to each input. `None` if the set of touching nodes is about to change: every touching node has
    /// just begun to touch, so the derivative is valid for that state alone.
    ///
    /// Cost: one factorisation, and per input one solve and six residuals.
    ///
    /// # Errors
    /// [`NewtonError`], for example for a state that is not an equilibrium of this body.
    pub fn sensitivities(
        &mut self,
        state: &State,
        changes: &[Change],
    ) -> Result<Option<Vec<Sensitivity>>, NewtonError> {
        let problem = Arc::clone(self.problem());
        if on_the_edge(&problem, state) {
            return Ok(None);
        }
        let newton = self.newton();
        let (system, tangent) = (&mut newton.system, &mut newton.tangent);
        system.assemble(&problem, state, &state.load, Ahead::default(), true)?;
        tangent.factorise(&problem, system)?;
        let unknowns = problem.pattern.unknowns();
        let mut sides = vec![0.0; changes.len() * unknowns];
        for (change, side) in changes.iter().zip(sides.chunks_exact_mut(unknowns)) {
            for ((body, load), sign) in [(&change.above, 0.5), (&change.below, -0.5)] {
                system.assemble(body, state, load, Ahead::default(), false)?;
                for (r, free) in
                    system.condensed.iter().zip(problem.free.iter()).filter(|(_, f)| **f != CONSTRAINED)
                {
                    let first = 3 * *free as usize;
                    side[first..first + 3].iter_mut().zip(r).for_each(|(s, r)| *s += sign / change.step * r);
                }
            }
        }
        tangent.solve(&mut sides);
        let all = changes.iter().zip(sides.chunks_exact(unknowns));
        Ok(Some(all.map(|(change, side)| follow(&problem, state, change, side)).collect()))
    }
}

/// Fields along the derivative `side` of the displacements.
fn follow(problem: &Problem, state: &State, change: &Change, side: &[f64]) -> Sensitivity {
    let rate = |free: &u32| match *free {
        CONSTRAINED => [0.0; 3],
        block => std::array::from_fn(|k| side[3 * block as usize + k]),
    };
    let rates: Vec<Vec3> = problem.free.iter().map(rate).collect();
    let largest = rates.iter().map(|r| norm(*r)).fold(f64::MIN_POSITIVE, f64::max);
    let along = DIFFERENCE_MM / largest;
    let moved = |by: f64| -> Vec<Vec3> {
        let mut u = state.displacement_mm.clone();
        u.iter_mut().zip(&rates).for_each(|(u, r)| axpy(by, *r, u));
        u
    };
    let ends = [(moved(along), 0.5 / along), (moved(-along), -0.5 / along)];
    let sides = [(&change.above, 0.5 / change.step), (&change.below, -0.5 / change.step)];
    let mut out = Sensitivity {
        coordinates_mm: rates,
        von_mises_mpa: vec![0.0; state.displacement_mm.len()],
        contact_force_n: 0.0,
    };
    let add_stress = |body: &Problem, u: &[Vec3], weight: f64, sum: &mut [f64]| {
        let values = mean_von_mises(body, u, None).0;
        sum.iter_mut().zip(values).for_each(|(s, v)| *s += weight * v);
    };
    for (u, weight) in &ends {
        add_stress(problem, u, *weight, &mut out.von_mises_mpa);
        out.contact_force_n += weight * contact_force_n(problem, u, &state.load);
    }
    for ((body, load), weight) in sides {
        out.contact_force_n += weight * contact_force_n(body, &state.displacement_mm, load);
        if std::ptr::eq(Arc::as_ptr(body), problem) {
            continue; // a load: the body is unchanged
        }
        add_stress(body, &state.displacement_mm, weight, &mut out.von_mises_mpa);
        for (rate, x) in out.coordinates_mm.iter_mut().zip(&body.mesh.nodes_mm) {
            axpy(weight, *x, rate);
        }
    }
    out
}

/// Force on the obstacle (N) at displacements `u`.
fn contact_force_n(problem: &Problem, u: &[Vec3], load: &Load) -> f64 {
    let Some(face) = face(problem, load.obstacle) else { return 0.0 };
    let position = |n: &u32| add(problem.mesh.nodes_mm[*n as usize], u[*n as usize]);
    let nodes = problem.contact_nodes.iter().zip(&problem.contact_stiffness_n_per_mm);
    nodes.filter_map(|(n, k)| Some(k * face.touch(position(n))?.vertical())).sum()
}

/// True if nodes touch the obstacle and all of them have just begun to.
fn on_the_edge(problem: &Problem, state: &State) -> bool {
    let Some(face) = face(problem, state.load.obstacle) else { return false };
    let position = |n: &u32| add(problem.mesh.nodes_mm[*n as usize], state.displacement_mm[*n as usize]);
    let mut touching = problem.contact_nodes.iter().filter_map(|n| face.touch(position(n))).peekable();
    touching.peek().is_some() && touching.all(|touch| touch.penalty.stiffness < EDGE_STIFFNESS)
}
