//! Continuation: from a solved state to another load, in as few steps as the iteration allows.

use std::sync::Arc;
use std::time::Instant;

use thiserror::Error;

use crate::algebra::{Vec3, norm, sub};
use crate::config::{Load, NewtonSettings, amount_mm3, pressures_mpa};
use crate::contact::Obstacle;
use crate::family::VariantError;
use crate::linear::LinearError;
use crate::newton::{Closure, Effort, Newton, NewtonError};
use crate::output::{self, MAX_RESIDUAL, Output};
use crate::problem::Problem;
use crate::state::State;
use crate::transfer::transferred;

/// Cost and residual of a solution.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SolveReport {
    /// Factorisations of the tangent, one per Newton iteration.
    pub factorisations: usize,
    /// Load steps that succeeded.
    pub steps: usize,
    /// Load steps given up and halved.
    pub cuts: usize,
    /// Largest nodal force out of balance at the end (N).
    pub residual_n: f64,
    /// The same relative to the larger of support reaction and obstacle force.
    pub residual: f64,
    /// Wall time (s).
    pub seconds: f64,
}

/// A continuation that stopped before its loads.
#[derive(Clone, Debug, Error, PartialEq)]
#[error(
    "stopped at {:.1} % of the way to {}: {reason}. Last equilibrium: {}. {}",
    100.0 * fraction, named(to, cavities_mpa), named(last, cavities_mpa), advice(reason, newton)
)]
pub struct NotConverged {
    /// Fraction of the path that was covered.
    pub fraction: f64,
    /// Requested loads.
    pub to: Load,
    /// The last loads in equilibrium.
    pub last: Load,
    /// Pressures of the further cavities in the configuration (MPa), from which those of the loads count.
    pub cavities_mpa: Vec<f64>,
    /// Settings of the iteration, which the message names where one of them ended the path.
    pub newton: NewtonSettings,
    /// Why the next step failed.
    pub reason: NewtonError,
    /// The work spent.
    pub report: SolveReport,
}

/// Loads as people read them: every pressure and the gap, to 1e-6 MPa, which is below every sensor's resolution.
fn named(load: &Load, cavities_mpa: &[f64]) -> String {
    let digits = |mpa: f64| (1.0e6 * mpa).round() / 1.0e6;
    let changes = cavities_mpa.iter().zip(load.cavities_change_mpa);
    let further: Vec<String> = changes.map(|(base, change)| digits(base + change).to_string()).collect();
    let further = match further.is_empty() {
        true => String::new(),
        false => format!(", further cavities {} MPa", further.join(", ")),
    };
    let gap = load.obstacle.gap_mm().map_or_else(String::new, |gap| format!(", gap {gap:.4} mm"));
    format!("P = {} MPa{further}{gap}", digits(load.pressure_mpa))
}

fn advice(reason: &NewtonError, newton: &NewtonSettings) -> String {
    let NewtonSettings { max_iterations, step_length_mm, smallest_step, .. } = newton;
    match reason {
        NewtonError::Stalled { .. } => {
            return format!(
                "Steps were halved down to newton.smallest_step = {smallest_step} of the path, at most \
                 newton.max_iterations = {max_iterations} each: lower the first or raise the second; or lower the pressures, of which one may have its limit there"
            );
        }
        NewtonError::StepTooShort { .. } => {
            return format!(
                "newton.step_length_mm = {step_length_mm} allows no more, newton.smallest_step = {smallest_step} no less: raise \
                 the first or lower the second, or start from a solved state nearer to it"
            );
        }
        NewtonError::Jumped { .. } => {
            return format!(
                "Three times newton.step_length_mm = {step_length_mm} is what a step may move, and steps were halved down to \
                 newton.smallest_step = {smallest_step} of the path: check that the loads are meant, or lower the second"
            );
        }
        _ => {}
    }
    let text = match reason {
        NewtonError::MaterialLimit { .. } => {
            "The elastomer is at its limit there: lower the pressure or the gravity"
        }
        NewtonError::ContactOpened { .. } => "Press less far, or take a gap at which the body still touches",
        NewtonError::Stalled { .. } | NewtonError::StepTooShort { .. } | NewtonError::Jumped { .. } => "",
        NewtonError::Limit { next_injected_mm3: Some(_), .. } => {
            "Lower the pressure to stay before it; `softtwin simulate --volume-mm3 V` with the volume of the next state solves that one, \
             `--path` the branch to it"
        }
        NewtonError::Limit { .. } => {
            "Lower the pressure to stay before it; `softtwin simulate --path --volume-mm3 V` with several times that volume follows the \
             branch beyond it"
        }
        NewtonError::Unstable { .. } => "Lower the pressure to stay before it, or take another gap",
        NewtonError::PathTooLong { .. } => "Give a smaller volume",
        NewtonError::Body(_) => "Start from a state whose measures are nearer",
        NewtonError::Linear(_) => "Check the supports; past a limit point no neighbouring equilibrium exists",
    };
    text.into()
}

/// Error of a solution.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum SolveError {
    /// The continuation stopped before the loads were reached.
    #[error(transparent)]
    NotConverged(Box<NotConverged>),
    /// The iteration converged but forces are not in balance.
    #[error(
        "the largest force out of balance is {found:.1e} of the reaction, expected at most {limit:.0e}; lower newton.correction_tolerance_mm",
        limit = MAX_RESIDUAL
    )]
    Unbalanced {
        /// Largest nodal force out of balance, relative to the larger of support reaction and obstacle force.
        found: f64,
    },
    /// The body lies partly behind the obstacle: a side without contact has passed it.
    #[error(
        "part of the body lies {depth_mm:.1} mm behind the obstacle, at most {MAX_DEPTH_MM} mm are accepted; lower the pressure, or widen the gap"
    )]
    Behind {
        /// Largest distance of a node behind the obstacle's face (mm).
        depth_mm: f64,
    },
    /// A load is out of range.
    #[error("{name} = {found}, expected {expected}")]
    Load {
        /// The load.
        name: &'static str,
        /// Value found.
        found: f64,
        /// Accepted values.
        expected: &'static str,
    },
    /// The body at the start or the end of the path is invalid.
    #[error(transparent)]
    Body(VariantError),
    /// The start does not belong to this problem.
    #[error("the start has {found} nodes, this mesh has {expected}; start from a state of the same mesh")]
    ForeignState {
        /// Nodes of the start.
        found: usize,
        /// Nodes of the mesh.
        expected: usize,
    },
}

impl SolveError {
    /// Limit of the pressure on the way (MPa), if that is the reason.
    #[must_use]
    pub fn limit_mpa(&self) -> Option<f64> {
        match self {
            Self::NotConverged(stopped) => match stopped.reason {
                NewtonError::Limit { pressure_mpa, .. } => Some(pressure_mpa),
                _ => None,
            },
            _ => None,
        }
    }
}

/// Version of the formulation. Every change that moves a result by more than the solver's tolerance raises it: checkpoints of
/// other versions are solved again instead of mixed with new ones.
pub const FORMULATION: u32 = 4;

/// Number of steps in which gravity is applied to the undeformed body.
const GRAVITY_STEPS: u32 = 3;

/// Largest number of factorisations of a step after which the next one may grow.
const EASY_STEP: usize = 9;

/// Failed steps, one after the other, after which a limit of the pressure is looked for; fewer if the next would be too short.
const SEARCH_AFTER: usize = 2;

/// Largest displacement of a step's corrections, in step lengths. Beyond it the equilibrium is on another branch, which no slow
/// change of the loads reaches.
const MAX_STEP_LENGTHS: f64 = 3.0;

/// Largest depth of nodes behind an obstacle's face (mm), far more than the overlap of its penalty.
const MAX_DEPTH_MM: f64 = 1.0;

/// Distance to which a plate is withdrawn before it is removed (mm).
const WITHDRAWAL_MM: f64 = 100.0;

/// Bodies along a path, at fractions from 0 to 1.
pub trait Bodies {
    /// Body at a fraction of the path.
    ///
    /// # Errors
    /// The variant there is invalid.
    fn at(&self, fraction: f64) -> Result<Arc<Problem>, VariantError>;
}

/// Path with a constant body.
struct ConstantBody(Arc<Problem>);

impl Bodies for ConstantBody {
    fn at(&self, _: f64) -> Result<Arc<Problem>, VariantError> {
        Ok(Arc::clone(&self.0))
    }
}

/// One thread's solver for a problem.
pub struct Solver {
    problem: Arc<Problem>,
    newton: Newton,
    /// True to follow a path behind a limit of the pressure until a state is stable at that pressure again: some 24 steps, several
    /// times the cost of the limit itself. Without it the search ends at the limit.
    pub searches_behind_limits: bool,
}

impl Solver {
    /// Allocates factor and workspace.
    ///
    /// # Errors
    /// [`LinearError::Memory`].
    pub fn new(problem: Arc<Problem>) -> Result<Self, LinearError> {
        let newton = Newton::new(Arc::clone(&problem))?;
        Ok(Self { problem, newton, searches_behind_limits: true })
    }

    /// The problem this solver works on.
    #[must_use]
    pub fn problem(&self) -> &Arc<Problem> {
        &self.problem
    }

    /// Sets the body: a variant of the first by [`Problem::varied`].
    pub fn set_problem(&mut self, problem: Arc<Problem>) {
        self.newton.set_problem(Arc::clone(&problem));
        self.problem = problem;
    }

    /// The undeformed, unloaded state.
    #[must_use]
    pub fn undeformed(&self) -> State {
        State {
            displacement_mm: vec![[0.0; 3]; self.problem.mesh.nodes_mm.len()],
            element_pressure_mpa: vec![0.0; self.problem.mesh.tets.len()],
            sheet_resultants_n_per_mm: vec![[[0.0; 3]; 3]; self.problem.sheet.triangles.len()],
            load: self.at_rest([0.0; 3]),
        }
    }

    /// Loads of gravity alone. The pressures of further cavities in the configuration are taken off, so that a path from here raises
    /// all pressures together.
    #[must_use]
    pub fn at_rest(&self, gravity_mm_s2: [f64; 3]) -> Load {
        let mut load = Load { gravity_mm_s2, ..Load::default() };
        let further = load.cavities_change_mpa.iter_mut().zip(&self.problem.config.cavities_mpa);
        further.for_each(|(change, mpa)| *change = -mpa);
        load
    }

    /// Equilibrium under gravity alone, without any pressure, applied in steps: the first state of every path.
    ///
    /// # Errors
    /// [`SolveError`].
    pub fn gravity_equilibrium(
        &mut self,
        gravity_mm_s2: [f64; 3],
    ) -> Result<(State, SolveReport), SolveError> {
        let load = self.at_rest(gravity_mm_s2);
        self.continuation(
            &self.undeformed(),
            &load,
            1.0 / f64::from(GRAVITY_STEPS),
            &ConstantBody(self.problem.clone()),
        )
    }

    /// Follows the path from a solved state to `load`: all pressures, gravity and obstacle move together.
    ///
    /// The equilibrium does not depend on the path (conservative and frictionless), so any near state is a good start.
    /// A new obstacle approaches from the distance at which it just clears the base.
    ///
    /// # Errors
    /// [`SolveError`]; the start is untouched.
    pub fn solve_to(&mut self, from: &State, load: &Load) -> Result<(State, SolveReport), SolveError> {
        let body = ConstantBody(Arc::clone(&self.problem));
        self.solve_along(from, load, &body)
    }

    /// [`Solver::solve_to`] with a changing body; afterwards the solver has the body at the path's end.
    ///
    /// A plate that approaches an inflated finger may fold it over or pass its tip. A state that lies behind its obstacle is solved
    /// again on the physical path: at rest on the obstacle first, then inflated.
    ///
    /// # Errors
    /// [`SolveError`]; the start is untouched.
    pub fn solve_along(
        &mut self,
        from: &State,
        load: &Load,
        path: &dyn Bodies,
    ) -> Result<(State, SolveReport), SolveError> {
        let (state, report) = self.follow(from, load, path)?;
        if output::depth_mm(&self.problem, &state) <= MAX_DEPTH_MM {
            return Ok((state, report));
        }
        let body = ConstantBody(Arc::clone(&self.problem));
        let (rest, to_rest) = self.gravity_equilibrium(load.gravity_mm_s2)?;
        let on_obstacle = Load { obstacle: load.obstacle, ..rest.load };
        let (pressed, to_obstacle) = self.follow(&rest, &on_obstacle, &body)?;
        let (state, inflation) = self.follow(&pressed, load, &body)?;
        let depth_mm = output::depth_mm(&self.problem, &state);
        if depth_mm > MAX_DEPTH_MM {
            return Err(SolveError::Behind { depth_mm });
        }
        Ok((state, report.and(&to_rest).and(&to_obstacle).and(&inflation)))
    }

    fn follow(
        &mut self,
        from: &State,
        load: &Load,
        path: &dyn Bodies,
    ) -> Result<(State, SolveReport), SolveError> {
        self.check(from, load)?;
        let mut start = from.clone();
        let mut before = SolveReport::default();
        if from.load.obstacle != Obstacle::None && !from.load.obstacle.same_body(load.obstacle) {
            (start, before) = self.withdraw(from, path)?;
        }
        if start.load.obstacle == Obstacle::None && load.obstacle != Obstacle::None {
            let clear = output::clearance_mm(&self.problem, &start);
            let gap = load.obstacle.gap_mm().map_or(clear, |gap| gap.max(clear));
            start.load.obstacle = load.obstacle.at(gap);
        }
        let (state, report) = self.continuation(&start, load, 1.0, path)?;
        Ok((state, before.and(&report)))
    }

    /// A state of another mesh of the same body as a start on this one: interpolated, not in equilibrium.
    ///
    /// `None` if the other mesh does not cover this one.
    #[must_use]
    pub fn transferred(&self, from: &Problem, state: &State) -> Option<State> {
        transferred(from, state, &self.problem)
    }

    /// Distance below the undeformed base at which an obstacle just clears the state (mm).
    #[must_use]
    pub fn clearance_mm(&self, state: &State) -> f64 {
        output::clearance_mm(&self.problem, state)
    }

    /// Fields, forces and contact sets of a state.
    #[must_use]
    pub fn output(&mut self, state: &State) -> Output {
        output::output(&self.problem, state, &mut self.newton.system)
    }

    /// Workspace of the iteration.
    pub(crate) fn newton(&mut self) -> &mut Newton {
        &mut self.newton
    }

    fn withdraw(&mut self, from: &State, path: &dyn Bodies) -> Result<(State, SolveReport), SolveError> {
        let first = path.at(0.0).map_err(SolveError::Body)?;
        let gap = from.load.obstacle.gap_mm().unwrap_or(0.0) + WITHDRAWAL_MM;
        let away = Load { obstacle: from.load.obstacle.at(gap), ..from.load };
        let (mut state, report) = self.continuation(from, &away, 1.0, &ConstantBody(first))?;
        state.load.obstacle = Obstacle::None;
        Ok((state, report))
    }

    pub(crate) fn check(&self, from: &State, load: &Load) -> Result<(), SolveError> {
        let (found, expected) = (from.displacement_mm.len(), self.problem.mesh.nodes_mm.len());
        if found != expected || from.element_pressure_mpa.len() != self.problem.mesh.tets.len() {
            return Err(SolveError::ForeignState { found, expected });
        }
        let invalid = |name, found, expected| Err(SolveError::Load { name, found, expected });
        if let Some(dead_mm3) = load.dead_mm3.filter(|dead_mm3| !(dead_mm3.is_finite() && *dead_mm3 >= 0.0)) {
            return invalid("dead_mm3", dead_mm3, "a finite number, 0 or more");
        }
        if let Some(injected_mm3) = load.injected_mm3 {
            if !injected_mm3.is_finite() {
                return invalid("volume_mm3", injected_mm3, "a finite number");
            }
            if self.problem.cavity.is_empty() {
                return invalid("volume_mm3", injected_mm3, "a mesh with a cavity");
            }
        } else if !(load.pressure_mpa.is_finite() && load.pressure_mpa >= 0.0) {
            return invalid("pressure_mpa", load.pressure_mpa, "a finite number, 0 or more");
        }
        let cavities_mpa = &pressures_mpa(self.problem.config(), load)[1..];
        if let Some(bad) = cavities_mpa.iter().find(|mpa| !(mpa.is_finite() && **mpa >= 0.0)) {
            return invalid("pressure_mpa of a further cavity", *bad, "a finite number, 0 or more");
        }
        if let Some(bad) = load.gravity_mm_s2.iter().find(|g| !g.is_finite()) {
            return invalid("gravity_mm_s2", *bad, "finite components");
        }
        match load.obstacle.gap_mm() {
            // At a gap of zero or less the obstacle would be inside the undeformed base.
            Some(gap) if !(gap.is_finite() && gap > 0.0) => invalid(
                "gap_mm",
                gap,
                "a finite distance above 0: the obstacle must stand outside the undeformed base",
            ),
            _ => Ok(()),
        }
    }

    /// One step of at most `length` of the path, which becomes the length tried; `state` becomes the equilibrium at the returned
    /// fraction.
    fn step(
        &mut self,
        state: &mut State,
        (from, to): (&Load, &Load),
        (done, length): (f64, &mut f64),
        path: &dyn Bodies,
        effort: &mut Effort,
    ) -> Result<f64, NewtonError> {
        let aim = (done + *length).min(1.0);
        *length = aim - done;
        self.set_problem(path.at(aim)?);
        let target = self.targeted(between(from, to, aim));
        let taken = self.newton.start(state, &target, effort)?;
        let reached = if taken < 1.0 { done + taken * (aim - done) } else { aim };
        *length = reached - done;
        if reached < aim {
            self.set_problem(path.at(reached)?);
        }
        let load = self.targeted(between(from, to, reached));
        let pressure_mpa = state.load.pressure_mpa;
        state.load = load;
        if load.injected_mm3.is_some() {
            state.load.pressure_mpa = pressure_mpa;
        }
        let before = state.displacement_mm.clone();
        self.newton.iterate(state, &load, effort)?;
        let moved = state.displacement_mm.iter().zip(&before).map(|(a, b)| norm(sub(*a, *b)));
        let moved_mm = moved.fold(0.0, f64::max);
        let allowed_mm = MAX_STEP_LENGTHS * self.problem.config.newton.step_length_mm;
        if moved_mm <= allowed_mm {
            return Ok(reached);
        }
        let touches = |u: &[Vec3]| output::touches(&self.problem, u, load.obstacle);
        if touches(&before) && !touches(&state.displacement_mm) {
            return Err(NewtonError::ContactOpened { moved_mm });
        }
        Err(NewtonError::Jumped { moved_mm, allowed_mm })
    }

    /// Sets the equation of the pressure for these loads, which it returns.
    fn targeted(&mut self, load: Load) -> Load {
        let closure = |injected_mm3| {
            let volume_mm3 = self.problem.undeformed_volume_mm3() + injected_mm3;
            load.dead_mm3.map_or(Closure::Volume(volume_mm3), |dead_mm3| Closure::Gas {
                amount_mm3: volume_mm3 + dead_mm3,
                dead_mm3,
            })
        };
        self.newton.closure = load.injected_mm3.map(closure);
        load
    }

    /// Volume, or gas, that is given in these loads, at a state (mm3).
    fn driven_mm3(&self, state: &State, load: &Load) -> f64 {
        let injected_mm3 = self.injected_mm3(state);
        let undeformed_mm3 = self.problem.undeformed_volume_mm3();
        load.dead_mm3.map_or(injected_mm3, |dead_mm3| {
            amount_mm3(state.load.pressure_mpa, undeformed_mm3 + injected_mm3, dead_mm3)
                - undeformed_mm3
                - dead_mm3
        })
    }

    /// Volume of the cavity minus that of the undeformed one (mm3).
    #[must_use]
    pub fn injected_mm3(&self, state: &State) -> f64 {
        let x = self.problem.positions(&state.displacement_mm);
        self.problem.cavity_volume(&x, None) - self.problem.undeformed_volume_mm3()
    }

    /// Steps along the straight line of loads; halves a failed step and enlarges an easy one.
    fn continuation(
        &mut self,
        from: &State,
        to: &Load,
        first_step: f64,
        path: &dyn Bodies,
    ) -> Result<(State, SolveReport), SolveError> {
        let began = Instant::now();
        let mut state = from.clone();
        state.load.injected_mm3 = to.injected_mm3.map(|_| self.driven_mm3(from, to));
        let begin = state.load;
        let mut report = SolveReport::default();
        let (mut done, mut step) = (0.0_f64, first_step);
        let (mut failures, mut has_searched) = (0, to.injected_mm3.is_some());
        while done < 1.0 {
            let mut trial = state.clone();
            let mut effort = Effort::default();
            let outcome = self.step(&mut trial, (&begin, to), (done, &mut step), path, &mut effort);
            report.factorisations += effort.factorisations;
            report.seconds = began.elapsed().as_secs_f64();
            let shortest = self.problem.config.newton.smallest_step;
            match outcome {
                Ok(reached) if reached < 1.0 && reached - done < shortest => {
                    let reason = NewtonError::StepTooShort { fraction: reached - done };
                    return Err(self.not_converged(reached, to, trial.load, reason, report));
                }
                Ok(reached) => {
                    // The predictor determines the length of the next step, unless this one was hard.
                    step = if first_step < 1.0 {
                        first_step
                    } else if effort.factorisations <= EASY_STEP {
                        1.0
                    } else {
                        2.0 * (reached - done)
                    };
                    state = trial;
                    done = reached;
                    failures = 0;
                    report.steps += 1;
                }
                Err(reason) => {
                    let reason = NewtonError::placed(reason, &self.problem);
                    report.cuts += 1;
                    failures += 1;
                    step *= 0.5;
                    if !has_searched && (failures == SEARCH_AFTER || step < shortest) {
                        has_searched = true;
                        self.set_problem(path.at(done).map_err(SolveError::Body)?);
                        let mut effort = Effort::default();
                        let limit = (to.pressure_mpa != state.load.pressure_mpa)
                            .then(|| self.limit_before(&state, to.pressure_mpa, &mut effort))
                            .flatten();
                        report.factorisations += effort.factorisations;
                        if let Some(reason) = limit {
                            let reason = NewtonError::placed(reason, &self.problem);
                            return Err(self.not_converged(done, to, state.load, reason, report));
                        }
                    }
                    if step < shortest {
                        return Err(self.not_converged(done, to, state.load, reason, report));
                    }
                }
            }
        }
        let pressure_mpa = state.load.pressure_mpa;
        state.load = *to;
        if to.injected_mm3.is_some() {
            state.load.pressure_mpa = pressure_mpa;
        }
        let balance = output::balance(&self.problem, &state, &mut self.newton.system);
        (report.residual_n, report.residual) = (balance.residual_n, balance.relative());
        report.seconds = began.elapsed().as_secs_f64();
        if report.residual > MAX_RESIDUAL {
            return Err(SolveError::Unbalanced { found: report.residual });
        }
        Ok((state, report))
    }

    /// The error of a path to a load that ended after a part of it, at `last`.
    fn not_converged(
        &self,
        fraction: f64,
        to: &Load,
        last: Load,
        reason: NewtonError,
        report: SolveReport,
    ) -> SolveError {
        SolveError::NotConverged(Box::new(NotConverged {
            fraction,
            to: *to,
            last,
            cavities_mpa: self.problem.config.cavities_mpa.clone(),
            newton: self.problem.config.newton,
            reason,
            report,
        }))
    }
}

impl SolveReport {
    /// This work followed by more.
    #[must_use]
    pub fn and(&self, later: &Self) -> Self {
        Self {
            factorisations: self.factorisations + later.factorisations,
            steps: self.steps + later.steps,
            cuts: self.cuts + later.cuts,
            residual_n: later.residual_n,
            residual: later.residual,
            seconds: self.seconds + later.seconds,
        }
    }
}

/// Loads at a fraction of the straight path.
fn between(from: &Load, to: &Load, fraction: f64) -> Load {
    let mix = |a: f64, b: f64| if fraction >= 1.0 { b } else { a + fraction * (b - a) };
    let obstacle = match (from.obstacle.gap_mm(), to.obstacle.gap_mm()) {
        (Some(a), Some(b)) => to.obstacle.at(mix(a, b)),
        _ => to.obstacle,
    };
    Load {
        pressure_mpa: mix(from.pressure_mpa, to.pressure_mpa),
        injected_mm3: from.injected_mm3.zip(to.injected_mm3).map(|(a, b)| mix(a, b)),
        dead_mm3: to.dead_mm3,
        obstacle,
        gravity_mm_s2: std::array::from_fn(|i| mix(from.gravity_mm_s2[i], to.gravity_mm_s2[i])),
        cavities_change_mpa: std::array::from_fn(|i| {
            mix(from.cavities_change_mpa[i], to.cavities_change_mpa[i])
        }),
    }
}
