//! Newton iteration at one load, with element pressures and sheet resultants as separate unknowns.
//!
//! Eliminating `p` from `integral (J - 1) = p V / K` and the resultants from `N = C E` leaves the displacement
//! equation that [`System`] assembles. After the solve those unknowns follow the *linearised* relation,
//! `p <- K/V (integral (J-1) + b . du)` and `N <- C (E + dE(du))`, not the new shape: the stiff stresses are then unaffected by
//! the second-order part of a finite rotation, and a step that rotates the whole finger converges in a few iterations.

use std::sync::Arc;

use thiserror::Error;

use crate::algebra::{Vec3, add, axpy, dot, mat_vec, norm, sub};
use crate::config::Load;
use crate::element::membrane::{self, Plane};
use crate::element::tet10::Invalid;
use crate::family::VariantError;
use crate::linear::CONSTRAINED;
use crate::linear::LinearError;
use crate::output::{MAX_RESIDUAL, balance};
use crate::problem::Problem;
use crate::state::State;
use crate::system::{Ahead, InvalidState, System, face};
use crate::tangent::Tangent;
use rom::memory::ATMOSPHERE_MPA;

/// Error of the iteration at one load.
#[derive(Clone, Debug, Error, PartialEq)]
#[allow(missing_docs)] // the messages say what the values are
pub enum NewtonError {
    /// The corrections did not become small.
    #[error("no equilibrium after {iterations} iterations, last correction {correction_mm:.3e} mm")]
    Stalled { iterations: usize, correction_mm: f64 },
    /// The path would take too many steps.
    #[error("a step of the largest allowed length covers {fraction:.1e} of the path only")]
    StepTooShort { fraction: f64 },
    /// The iteration ended at an equilibrium far from its start: another branch, such as a finger folded over.
    #[error("the body jumped by {moved_mm:.1} mm in one step, at most {allowed_mm:.1} mm are expected")]
    Jumped { moved_mm: f64, allowed_mm: f64 },
    /// The path winds on without reaching its volume.
    #[error("the volume was not reached within {points} points")]
    PathTooLong { points: usize },
    /// The pressure has a limit on the way.
    #[error(
        "the pressure has a limit of {pressure_mpa:.6} MPa at an injected volume of {injected_mm3:.1} mm3; beyond it {}",
        next_injected_mm3.map_or_else(
            || format!("no state up to {searched_mm3:.1} mm3 is stable at that pressure"),
            |mm3| format!("the next stable state has {mm3:.1} mm3"),
        )
    )]
    Limit {
        pressure_mpa: f64,
        injected_mm3: f64,
        /// Injected volume of the next state on the path that is stable at that pressure (mm3).
        next_injected_mm3: Option<f64>,
        searched_mm3: f64,
    },
    /// The equilibrium loses its stability on the way, at a rising pressure.
    #[error(
        "the equilibrium becomes unstable at {pressure_mpa:.6} MPa, an injected volume of {injected_mm3:.1} mm3: the body swings to another one"
    )]
    Unstable { pressure_mpa: f64, injected_mm3: f64 },
    /// The contact with the obstacle opened within a step, and the body swung away.
    #[error("the contact with the obstacle opened, and the body moved by {moved_mm:.1} mm in one step")]
    ContactOpened { moved_mm: f64 },
    /// The state is outside the limits of the elastomer.
    #[error("element {element}{}: {what}", at_mm.map_or_else(String::new, |[x, y, z]| format!(" at ({x:.1}, {y:.1}, {z:.1}) mm")))]
    MaterialLimit {
        element: usize,
        /// Its undeformed middle, where the mesh is known.
        at_mm: Option<Vec3>,
        what: String,
    },
    /// The linear solver failed.
    #[error(transparent)]
    Linear(#[from] LinearError),
    /// An intermediate variant is invalid.
    #[error(transparent)]
    Body(#[from] VariantError),
}

impl NewtonError {
    /// The error with the place of its element.
    pub(crate) fn placed(mut self, problem: &Problem) -> Self {
        if let Self::MaterialLimit { element, at_mm, .. } = &mut self {
            *at_mm = problem.mesh.tets.get(*element).map(|tet| {
                let mut middle = [0.0; 3];
                tet[..4].iter().for_each(|n| axpy(0.25, problem.mesh.nodes_mm[*n as usize], &mut middle));
                middle
            });
        }
        self
    }
}

impl From<InvalidState> for NewtonError {
    fn from(invalid: InvalidState) -> Self {
        let what = match invalid.reason {
            Invalid::Collapsed(j) => format!("its volume fell to {j:.3} of the undeformed one"),
            Invalid::BeyondLimit(i) => {
                format!("its stretch invariant {i:.2} passed the material's limit (locking)")
            }
            Invalid::Unstable(i) => {
                format!(
                    "its law is unstable at the stretch invariant {i:.2}, as `softtwin material fit` reports"
                )
            }
        };
        Self::MaterialLimit { element: invalid.element, at_mm: None, what }
    }
}

/// Work spent on one load.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Effort {
    /// Factorisations of the tangent.
    pub(crate) factorisations: usize,
}

/// Halvings of a correction that leads to an invalid state.
const MAX_HALVINGS: usize = 5;

/// Corrections longer than the longest step after which an iteration is given up.
const MAX_LONG: usize = 4;

/// Last correction (mm) above which the slots' normals are fixed. Far from equilibrium walls overlap too much, and the rotation
/// of that force misleads the iteration. Close to it the exact tangent converges quadratically.
pub(crate) const TURNING_WITHIN_MM: f64 = 0.1;

/// Last correction (mm) up to which the next one is solved with the last factor, in few linear iterations.
const NEAR_MM: f64 = 0.02;

/// Most corrections of a descent.
const DESCENT_ITERATIONS: usize = 400;
/// First shift of a descent, over the mean diagonal of the tangent.
const FIRST_SHIFT: f64 = 0.01;
/// Factors on the shift where the residual falls.
const WEAKER: [f64; 2] = [0.5, 0.8];
/// Largest factor on the shift where the residual rises.
const RISING: f64 = 2.0;
/// Factor on the shift where the tangent is indefinite.
const STRONGER: f64 = 4.0;
/// Correction (mm) at which Newton's iteration takes over.
const DESCENDED_MM: f64 = 1.0e-3;

/// Relative residual of a solution with an older factor: the iteration converges as with a new one.
const LINEAR_TOLERANCE: f64 = 1.0e-9;

/// Equation that determines the cavity pressure if it is an unknown. With `g = dV/du` and `y = K^-1 g` the corrections are
/// `du = K^-1 R + dp y`, where `dp` satisfies the linearised equation.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Closure {
    /// The cavity has that volume (mm3).
    Volume(f64),
    /// Cavity and supply have that amount of gas.
    Gas { amount_mm3: f64, dead_mm3: f64 },
    /// Corrections are normal to a direction of the unknowns.
    Normal(Vec<f64>),
}

/// Correction of all unknowns.
#[derive(Clone, Debug, Default)]
struct Increment {
    displacement: Vec<Vec3>,
    pressure: Vec<f64>,
    resultants: Vec<[Plane; 3]>,
    cavity_mpa: f64,
}

impl Increment {
    fn scale(&mut self, fraction: f64) {
        self.displacement.iter_mut().flatten().for_each(|v| *v *= fraction);
        self.pressure.iter_mut().for_each(|v| *v *= fraction);
        self.resultants.iter_mut().flatten().flatten().for_each(|v| *v *= fraction);
        self.cavity_mpa *= fraction;
    }

    fn largest_mm(&self) -> f64 {
        self.displacement.iter().map(|d| norm(*d)).fold(0.0, f64::max)
    }

    fn apply(&self, fraction: f64, state: &mut State) {
        for (u, du) in state.displacement_mm.iter_mut().zip(&self.displacement) {
            axpy(fraction, *du, u);
        }
        for (p, dp) in state.element_pressure_mpa.iter_mut().zip(&self.pressure) {
            *p += fraction * dp;
        }
        for (n, dn) in state.sheet_resultants_n_per_mm.iter_mut().zip(&self.resultants) {
            for (n, dn) in n.iter_mut().zip(dn) {
                axpy(fraction, *dn, n);
            }
        }
        state.load.pressure_mpa += fraction * self.cavity_mpa;
    }
}

/// Workspace of the iteration of one thread.
pub(crate) struct Newton {
    problem: Arc<Problem>,
    pub(crate) system: System,
    pub(crate) tangent: Tangent,
    rhs: Vec<f64>,
    increment: Increment,
    /// Equation of the cavity pressure; `None` where it is given.
    pub(crate) closure: Option<Closure>,
    /// Length of the last correction (mm).
    last_mm: f64,
}

impl Newton {
    /// Allocates the workspace.
    ///
    /// # Errors
    /// [`LinearError::Memory`].
    pub(crate) fn new(problem: Arc<Problem>) -> Result<Self, LinearError> {
        let tangent = Tangent::new(&problem)?;
        let system = System::new(&problem);
        let rhs = vec![0.0; problem.pattern.unknowns()];
        Ok(Self {
            problem,
            system,
            tangent,
            rhs,
            increment: Increment::default(),
            closure: None,
            last_mm: 0.0,
        })
    }

    /// Sets the body of the next steps: the present one or a variant by [`Problem::varied`].
    pub(crate) fn set_problem(&mut self, problem: Arc<Problem>) {
        self.problem = problem;
    }

    /// Starts a step towards `load`: predicts its correction, shortens it to the largest length, applies it.
    ///
    /// Returns the fraction of the step taken: the prediction is linear in the load, so a shorter step costs nothing.
    pub(crate) fn start(
        &mut self,
        state: &mut State,
        load: &Load,
        effort: &mut Effort,
    ) -> Result<f64, NewtonError> {
        self.predict(state, load)?;
        self.solve(state, None, effort)?;
        let fraction = (self.problem.config.newton.step_length_mm / self.increment.largest_mm()).min(1.0);
        self.update(state, fraction);
        self.last_mm = self.increment.largest_mm();
        Ok(fraction)
    }

    /// Brings `state`, started towards `load`, into equilibrium with it; `state` is undefined on errors.
    ///
    /// `effort` counts the work also on errors. With a closure the pressure of `state` changes, otherwise it is that of `load`.
    pub(crate) fn iterate(
        &mut self,
        state: &mut State,
        load: &Load,
        effort: &mut Effort,
    ) -> Result<(), NewtonError> {
        let settings = self.problem.config.newton;
        let mut long = 0;
        for iteration in 1..=settings.max_iterations {
            self.assemble(state, load)?;
            if self.last_mm > TURNING_WITHIN_MM {
                self.system.turning.clear();
            }
            // With a closure two right-hand sides are solved: a new factor is cheaper.
            let is_near = self.last_mm <= NEAR_MM && self.closure.is_none();
            let tolerance = is_near.then_some(LINEAR_TOLERANCE);
            self.solve(state, tolerance, effort)?;
            let correction = self.increment.largest_mm();
            long += usize::from(correction > settings.step_length_mm);
            if long == MAX_LONG {
                return Err(NewtonError::Stalled { iterations: iteration, correction_mm: correction });
            }
            self.update(state, (settings.displacement_cap_mm / correction).min(1.0));
            // The next correction shrinks at least by the same factor.
            let next = correction * (correction / self.last_mm).min(1.0);
            self.last_mm = correction;
            let settled = next < settings.correction_tolerance_mm;
            if settled && self.force_error_n(state, load) < settings.force_tolerance_n {
                let problem = Arc::clone(&self.problem);
                if balance(&problem, state, &mut self.system).relative() <= MAX_RESIDUAL {
                    return Ok(());
                }
            }
        }
        Err(NewtonError::Stalled { iterations: settings.max_iterations, correction_mm: self.last_mm })
    }

    /// Brings `state`, no equilibrium, to a stable one of that cavity volume by pseudo-transient continuation:
    ///
    /// ```text
    /// (K + s) du - dp g = R,   g . du = volume - v;   s changes with the residual and rises while K + s is indefinite
    /// ```
    ///
    /// Unlike the iteration it does not end on the fold of a single element. `state` is undefined on errors.
    ///
    /// # Errors
    /// [`NewtonError`].
    pub(crate) fn descend(
        &mut self,
        state: &mut State,
        volume_mm3: f64,
        effort: &mut Effort,
    ) -> Result<(), NewtonError> {
        self.closure = Some(Closure::Volume(volume_mm3));
        let result = self.descend_closed(state, effort);
        self.closure = None;
        result
    }

    fn descend_closed(&mut self, state: &mut State, effort: &mut Effort) -> Result<(), NewtonError> {
        let load = state.load;
        let cap_mm = self.problem.config.newton.displacement_cap_mm;
        let diagonal: Vec<usize> = self.problem.pattern.columns().0[..self.rhs.len()].to_vec();
        let (mut shift, mut last_n) = (None, f64::INFINITY);
        for _ in 0..DESCENT_ITERATIONS {
            self.assemble(state, &load)?;
            let mean =
                diagonal.iter().map(|at| self.system.tangent[*at].abs()).sum::<f64>() / diagonal.len() as f64;
            let residual_n = self.system.condensed.iter().map(|r| dot(*r, *r)).sum::<f64>().sqrt();
            let ratio = residual_n / last_n;
            let change = if ratio < 1.0 { ratio.clamp(WEAKER[0], WEAKER[1]) } else { ratio.min(RISING) };
            let mut now = shift.map_or(FIRST_SHIFT * mean, |shift: f64| shift * change);
            last_n = residual_n;
            let mut added = 0.0;
            loop {
                diagonal.iter().for_each(|at| self.system.tangent[*at] += now - added);
                added = now;
                self.solve(state, None, effort)?;
                if self.is_stable_at_volume(state) || now >= mean {
                    break;
                }
                now *= STRONGER;
            }
            shift = Some(now);
            let correction = self.increment.largest_mm();
            self.update(state, (cap_mm / correction).min(1.0));
            self.last_mm = correction;
            if correction < DESCENDED_MM {
                return self.iterate(state, &load, effort);
            }
        }
        Err(NewtonError::Stalled { iterations: DESCENT_ITERATIONS, correction_mm: self.last_mm })
    }

    /// True if the factorised tangent is positive definite for displacements that keep the cavity's volume.
    fn is_stable_at_volume(&mut self, state: &State) -> bool {
        let negative = self.tangent.negative_eigenvalues();
        let [by, gradient] = self.by_pressure(state);
        negative == 0 || negative == 1 && product(&gradient, &by) < 0.0
    }

    /// Moves the nodes by `displacement_mm`, the stress unknowns by the linearised relations of the system assembled at `state`.
    pub(crate) fn displace(&mut self, state: &mut State, displacement_mm: Vec<Vec3>) {
        self.increment.displacement = displacement_mm;
        self.increment.cavity_mpa = 0.0;
        self.update(state, 1.0);
    }

    /// Sum over the nodes of the difference between the obstacle's force at the new iterate and the one that the last
    /// tangent predicted (N).
    ///
    /// Small corrections are not sufficient for equilibrium: a node that the last one brought back into a stiff contact carries a
    /// force that was not part of the last solve and is not balanced.
    fn force_error_n(&self, state: &State, load: &Load) -> f64 {
        let problem = &self.problem;
        let Some(face) = face(problem, load.obstacle) else { return 0.0 };
        let error = |(n, k): (&u32, &f64)| {
            let n = *n as usize;
            let now = add(problem.mesh.nodes_mm[n], state.displacement_mm[n]);
            let correction = self.increment.displacement[n];
            let (is, was) = (face.touch(now), face.touch(sub(now, correction)));
            let foreseen = was.map_or([0.0; 3], |was| sub(was.force(), mat_vec(&was.tangent(), correction)));
            k * norm(sub(is.map_or([0.0; 3], |is| is.force()), foreseen))
        };
        problem.contact_nodes.iter().zip(&problem.contact_stiffness_n_per_mm).map(error).sum()
    }

    /// First system of a step: the tangent at the old pressure and obstacle, with the new pressure's force, and the obstacle's
    /// advance acting on the touching nodes. If the obstacle moved first, a retreat would lose all contact in the first iteration
    /// and the actuator would swing away.
    fn predict(&mut self, state: &State, load: &Load) -> Result<(), NewtonError> {
        let mut linearised = Load { pressure_mpa: state.load.pressure_mpa, ..*load };
        let mut ahead = Ahead { pressure_mpa: load.pressure_mpa - state.load.pressure_mpa, advance_mm: 0.0 };
        if self.closure.is_some() {
            ahead.pressure_mpa = 0.0;
        }
        if state.load.obstacle.same_body(load.obstacle) {
            linearised.obstacle = state.load.obstacle;
            if let (Some(was), Some(is)) = (state.load.obstacle.gap_mm(), load.obstacle.gap_mm()) {
                ahead.advance_mm = was - is;
            }
        }
        let problem = Arc::clone(&self.problem);
        self.system.assemble(&problem, state, &linearised, ahead, true)?;
        Ok(())
    }

    /// Assembles at the current iterate; halves the last correction while the iterate is invalid.
    fn assemble(&mut self, state: &mut State, load: &Load) -> Result<(), NewtonError> {
        let problem = Arc::clone(&self.problem);
        let mut fraction = 1.0;
        for _ in 0..MAX_HALVINGS {
            match self.system.assemble(&problem, state, &self.at(state, load), Ahead::default(), true) {
                Ok(()) => return Ok(()),
                Err(_) => {
                    fraction *= 0.5;
                    self.increment.apply(-fraction, state);
                }
            }
        }
        self.system.assemble(&problem, state, &self.at(state, load), Ahead::default(), true)?;
        Ok(())
    }

    /// The loads of an iterate.
    fn at(&self, state: &State, load: &Load) -> Load {
        let pressure_mpa = if self.closure.is_some() { state.load.pressure_mpa } else { load.pressure_mpa };
        Load { pressure_mpa, ..*load }
    }

    /// Factorises the tangent at an equilibrium and solves for the displacement (mm) per MPa of cavity pressure; returns it with the
    /// gradient of the volume (mm2).
    pub(crate) fn direction(
        &mut self,
        state: &State,
        effort: &mut Effort,
    ) -> Result<[Vec<f64>; 2], NewtonError> {
        let problem = Arc::clone(&self.problem);
        self.system.assemble(&problem, state, &state.load, Ahead::default(), true)?;
        self.tangent.factorise(&problem, &self.system)?;
        effort.factorisations += 1;
        Ok(self.by_pressure(state))
    }

    /// `y = K^-1 g` and `g`, with the present factor.
    fn by_pressure(&mut self, state: &State) -> [Vec<f64>; 2] {
        let mut gradient = vec![0.0; self.rhs.len()];
        self.problem.cavity_volume(&self.problem.positions(&state.displacement_mm), Some(&mut gradient));
        let mut by = gradient.clone();
        self.tangent.solve(&mut by);
        [by, gradient]
    }

    /// Starts a step along a direction of the unknowns from an equilibrium: `state` moves by `cavity_mpa` times `by` (mm per MPa).
    pub(crate) fn push(&mut self, state: &mut State, by: &[f64], cavity_mpa: f64) -> Result<(), NewtonError> {
        let problem = Arc::clone(&self.problem);
        self.system.assemble(&problem, state, &state.load, Ahead::default(), false)?;
        self.increment.displacement = spread(&self.problem, by, cavity_mpa);
        self.increment.cavity_mpa = cavity_mpa;
        self.update(state, 1.0);
        self.last_mm = self.increment.largest_mm();
        Ok(())
    }

    /// Solves for the displacement correction with the assembled tangent, as [`Tangent::solve_assembled`].
    fn solve(
        &mut self,
        state: &State,
        tolerance: Option<f64>,
        effort: &mut Effort,
    ) -> Result<(), NewtonError> {
        let problem = Arc::clone(&self.problem);
        for (r, free) in self.system.condensed.iter().zip(problem.free.iter()) {
            if *free != CONSTRAINED {
                self.rhs[3 * *free as usize..][..3].copy_from_slice(r);
            }
        }
        let factorised = self.tangent.solve_assembled(&problem, &self.system, &mut self.rhs, tolerance)?;
        effort.factorisations += usize::from(factorised);
        self.increment.cavity_mpa = 0.0;
        if let Some(closure) = self.closure.clone() {
            let [by, gradient] = self.by_pressure(state);
            let volume_mm3 = self.system.cavity_volumes_mm3[0];
            let (row, wanted, by_pressure) = match &closure {
                Closure::Volume(target_mm3) => (&gradient, target_mm3 - volume_mm3, 0.0),
                Closure::Gas { amount_mm3, dead_mm3 } => {
                    let absolute_mpa = state.load.pressure_mpa + ATMOSPHERE_MPA;
                    let space_mm3 = volume_mm3 + dead_mm3;
                    (
                        &gradient,
                        ATMOSPHERE_MPA * amount_mm3 / absolute_mpa - space_mm3,
                        space_mm3 / absolute_mpa,
                    )
                }
                Closure::Normal(direction) => (direction, 0.0, 0.0),
            };
            let cavity_mpa = (wanted - product(row, &self.rhs)) / (product(row, &by) + by_pressure);
            if !cavity_mpa.is_finite() {
                return Err(LinearError::Singular.into());
            }
            self.rhs.iter_mut().zip(&by).for_each(|(x, y)| *x += cavity_mpa * y);
            self.increment.cavity_mpa = cavity_mpa;
        }
        self.increment.displacement = spread(&problem, &self.rhs, 1.0);
        let correction_mm = self.increment.largest_mm();
        tracing::debug!(correction_mm, factorised, "Newton iteration");
        Ok(())
    }

    /// Applies a fraction of the correction to displacements, pressures and resultants.
    fn update(&mut self, state: &mut State, fraction: f64) {
        self.stress_increments(state);
        self.increment.scale(fraction);
        self.increment.apply(1.0, state);
    }

    /// Changes of pressures and resultants by the displacement correction, from the linearised relations.
    fn stress_increments(&mut self, state: &State) {
        let (problem, du) = (&self.problem, &self.increment.displacement);
        let pressure = |e: usize| {
            let gradient = &self.system.volume_gradient[e];
            let nodes = &problem.mesh.tets[e];
            let linear: f64 = gradient.iter().zip(nodes).map(|(g, n)| dot(*g, du[*n as usize])).sum();
            let bulk = problem.elastomer(e).element_bulk_mpa() / problem.tets[e].volume_mm3();
            bulk * (self.system.volume_change[e] + linear) - state.element_pressure_mpa[e]
        };
        self.increment.pressure = (0..problem.mesh.tets.len()).map(pressure).collect();
        let resultants = |(t, nodes): (usize, &[u32; 6])| {
            let geometry = &problem.sheet.membrane[t];
            let position = |n: u32| add(problem.mesh.nodes_mm[n as usize], state.displacement_mm[n as usize]);
            let (x, du) = (nodes.map(position), nodes.map(|n| du[n as usize]));
            std::array::from_fn(|q| {
                let (e, de) =
                    (membrane::strain(geometry, q, &x), membrane::strain_increment(geometry, q, &x, &du));
                let mut n = problem.sheet.law(t).linearised(e, de);
                axpy(-1.0, state.sheet_resultants_n_per_mm[t][q], &mut n);
                n
            })
        };
        self.increment.resultants = problem.sheet.triangles.iter().enumerate().map(resultants).collect();
    }
}

/// Values of the unknowns times `factor` at the nodes.
fn spread(problem: &Problem, unknowns: &[f64], factor: f64) -> Vec<Vec3> {
    let at = |free: &u32| {
        let k = 3 * *free as usize;
        if *free == CONSTRAINED { [0.0; 3] } else { [0, 1, 2].map(|c| factor * unknowns[k + c]) }
    };
    problem.free.iter().map(at).collect()
}

/// Scalar product over the unknowns.
pub(crate) fn product(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
