//! Solves a list of cases on several threads.

use super::board::{Board, Next};
use super::derivatives::{self, DerivativeError};
use super::schedule::{Start, starts};
use super::store::{Sizes, Solved, Store};
use crate::cases::Case;
use crate::config::{Load, flat};
use crate::family::{Family, Variant, VariantError};
use crate::linear::LinearError;
use crate::problem::Problem;
use crate::solver::{Bodies, FORMULATION, SolveError, SolveReport, Solver};
use crate::state::State;
use formats::FormatError;
use std::sync::{Arc, Condvar, Mutex, PoisonError};

/// Event of a run, for progress bars and logs.
#[derive(Debug)]
pub enum Event<'a> {
    /// The case was found among the checkpoints.
    Reused(&'a Case),
    /// The case is in work.
    Started(&'a Case),
    /// The case is solved.
    Solved(&'a Case, &'a Solved),
    /// The case failed.
    Failed {
        /// The case that has no answer so far.
        case: &'a Case,
        /// What the solver said of it.
        reason: &'a str,
        /// True if it will be tried from another state.
        again: bool,
    },
}

/// Result of a run.
#[derive(Debug, Default)]
pub struct Outcome {
    /// Index in the list and state, in the list's order.
    pub solved: Vec<(usize, Arc<Solved>)>,
    /// Number of them that were checkpoints.
    pub reused: usize,
    /// Index in the list and reason.
    pub failed: Vec<(usize, String)>,
    /// The last limit of pressure that ended a case (MPa).
    pub limit_mpa: Option<f64>,
}

/// Error that ends a run.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // the messages say what the values are
pub enum RunError {
    /// A checkpoint or the database could not be written.
    #[error(transparent)]
    Store(#[from] FormatError),
    /// There is no equilibrium under gravity alone.
    #[error("no equilibrium under gravity alone: {0}")]
    Gravity(SolveError),
    /// The factor does not fit into memory.
    #[error(transparent)]
    Memory(#[from] LinearError),
    /// A case has invalid parameters.
    #[error("case {case}: {reason}")]
    Variant { case: String, reason: VariantError },
    /// A state's derivatives could not be computed.
    #[error("derivatives of case {case}: {reason}")]
    Derivatives { case: String, reason: Box<DerivativeError> },
}

/// Solves a list of cases of one actuator and its variants.
pub struct Run<'a> {
    /// The actuator and its variants.
    pub family: &'a Family,
    /// Where finished cases are kept, so that a run that was ended goes on.
    pub store: Store,
    /// Cases solved at the same time, 1 or more; about 1 GB each.
    pub threads: usize,
    /// True to store derivatives with respect to all inputs with each state.
    pub sensitivities: bool,
    /// True to look behind a limit of the pressure for the next stable state, which the message of the failed case then names.
    pub searches_behind_limits: bool,
}

/// Case with the variant, loads and starts of its row.
pub(super) struct Task<'a> {
    pub(super) case: &'a Case,
    pub(super) variant: Variant,
    pub(super) load: Load,
    pub(super) store: Store,
    pub(super) starts: Vec<Start>,
}

/// State shared by the threads.
struct RunState {
    board: Board,
    outcome: Outcome,
    broken: Option<RunError>,
    /// True if a thread was unwound: what its case decides will not come.
    is_unwound: bool,
}

/// List in work.
struct OngoingRun<'a> {
    run: &'a Run<'a>,
    tasks: Vec<Task<'a>>,
    rest: Arc<Solved>,
    shared: Mutex<RunState>,
    changed: Condvar,
    notify: &'a (dyn Fn(Event<'_>) + Sync),
}

impl Run<'_> {
    /// Solves all cases; a failed one never stops the others. Two runs of one list give the same bytes, whatever the
    /// number of threads. `notify` is called from any thread, one call at a time; if it unwinds, so does the call, with each thread's next event.
    ///
    /// # Errors
    /// [`RunError`]; solved states are kept.
    pub fn solve(&self, cases: &[Case], notify: &(dyn Fn(Event<'_>) + Sync)) -> Result<Outcome, RunError> {
        let tasks = self.tasks(cases)?;
        let mut board = Board::new(tasks.iter().map(|task| task.starts.clone()).collect());
        let mut outcome = Outcome::default();
        for (index, task) in tasks.iter().enumerate() {
            if let Some(solved) = self.stored(task) {
                notify(Event::Reused(task.case));
                board.solved(index, Arc::clone(&solved));
                outcome.solved.push((index, solved));
            }
        }
        outcome.reused = outcome.solved.len();
        if !board.is_done() {
            let shared = Mutex::new(RunState { board, outcome, broken: None, is_unwound: false });
            let rest = Arc::new(self.rest()?);
            let work = OngoingRun { run: self, tasks, rest, shared, changed: Condvar::new(), notify };
            std::thread::scope(|scope| {
                for _ in 0..self.threads.max(1) {
                    scope.spawn(|| work.run_thread());
                }
            });
            let shared = work.shared.into_inner().unwrap_or_else(PoisonError::into_inner);
            if let Some(error) = shared.broken {
                return Err(error);
            }
            outcome = shared.outcome;
        }
        outcome.solved.sort_by_key(|(index, _)| *index);
        outcome.failed.sort_by_key(|(index, _)| *index);
        Ok(outcome)
    }

    /// Derivatives of a solved case, in the order of its inputs; empty if they are undefined, `None` if they were not computed.
    pub fn derivatives(&self, case: &Case) -> Option<Vec<super::Derivative>> {
        let variant = self.family.variant(&case.settings).ok()?;
        let load = self.load(case, &variant).ok()?;
        derivatives::load(&self.store.marked(self.family.mark(&variant)), case, &load, self.sizes())
    }

    fn tasks<'c>(&self, cases: &'c [Case]) -> Result<Vec<Task<'c>>, RunError> {
        let wrong = |case: &Case, reason| RunError::Variant { case: case.name.clone(), reason };
        let names = cases.first().map_or(&[][..], |case| &case.settings);
        let nominal: Vec<f64> =
            names.iter().map(|(name, _)| self.family.value(&Variant::default(), name)).collect();
        let variants =
            cases.iter().map(|case| self.family.variant(&case.settings).map_err(|e| wrong(case, e)));
        let variants = variants.collect::<Result<Vec<Variant>, _>>()?;
        let rows = cases.iter().zip(variants).zip(starts(cases, &nominal));
        let task = |((case, variant), starts)| {
            let load = self.load(case, &variant).map_err(|e| wrong(case, e))?;
            let store = self.store.marked(self.family.mark(&variant));
            Ok(Task { case, variant, load, store, starts })
        };
        rows.map(task).collect()
    }

    /// Stored state of a case; `None` also if required derivatives are missing.
    fn stored(&self, task: &Task<'_>) -> Option<Arc<Solved>> {
        let solved = task.store.load(&task.load, self.sizes())?;
        let whole = !self.sensitivities
            || derivatives::load(&task.store, task.case, &task.load, self.sizes()).is_some();
        whole.then(|| Arc::new(solved))
    }

    /// Nominal actuator under gravity alone, from its checkpoint if there is one.
    fn rest(&self) -> Result<Solved, RunError> {
        let mut solver = Solver::new(Arc::clone(&self.family.problem))?;
        let load = solver.at_rest(self.family.actuator.loads.gravity_mm_s2);
        if let Some(solved) = self.store.load(&load, self.sizes()) {
            return Ok(solved);
        }
        let (state, report) = solver.gravity_equilibrium(load.gravity_mm_s2).map_err(RunError::Gravity)?;
        Ok(describe(&mut solver, state, report))
    }

    fn load(&self, case: &Case, variant: &Variant) -> Result<Load, VariantError> {
        let load = self.family.actuator_of(variant)?.load(case.pressure_mpa, case.gap_mm);
        Ok(Load { injected_mm3: case.volume_mm3, ..load })
    }

    fn sizes(&self) -> Sizes {
        let problem = &self.family.problem;
        let sheet = problem.sheet.triangles.len();
        Sizes { nodes: problem.mesh.nodes_mm.len(), tets: problem.mesh.tets.len(), sheet }
    }
}

/// Bodies between two variants.
struct BodiesBetween<'a> {
    family: &'a Family,
    from: &'a Variant,
    to: &'a Variant,
    end: Arc<Problem>,
}

impl Bodies for BodiesBetween<'_> {
    fn at(&self, fraction: f64) -> Result<Arc<Problem>, VariantError> {
        if fraction >= 1.0 || self.from == self.to {
            return Ok(Arc::clone(&self.end));
        }
        self.family.problem_of(&self.family.between(self.from, self.to, fraction))
    }
}

/// Wakes the other threads when one ends, also by unwinding: `notify` may unwind to end the run.
struct Ending<'a>(&'a OngoingRun<'a>);

impl Drop for Ending<'_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.0.shared.lock().unwrap_or_else(PoisonError::into_inner).is_unwound = true;
        }
        self.0.changed.notify_all();
    }
}

impl OngoingRun<'_> {
    /// The loop of one thread.
    fn run_thread(&self) {
        let _ending = Ending(self);
        let lock = || self.shared.lock().unwrap_or_else(PoisonError::into_inner);
        let result = Solver::new(Arc::clone(&self.run.family.problem)).map_err(RunError::from);
        let result = result.and_then(|mut solver| {
            solver.searches_behind_limits = self.run.searches_behind_limits;
            while let Some((case, start)) = self.next_case() {
                {
                    let _one_at_a_time = lock();
                    (self.notify)(Event::Started(self.tasks[case].case));
                }
                self.solve(&mut solver, case, start)?;
                self.changed.notify_all();
            }
            Ok(())
        });
        if let Err(error) = result {
            lock().broken.get_or_insert(error);
        }
    }

    /// The next case to solve and its start; waits while a case in work decides it.
    fn next_case(&self) -> Option<(usize, Start)> {
        let mut shared = self.shared.lock().unwrap_or_else(PoisonError::into_inner);
        while shared.broken.is_none() && !shared.is_unwound {
            match shared.board.next() {
                Next::Solve(case, start) => return Some((case, start)),
                Next::Done => return None,
                Next::Wait => {
                    shared = self.changed.wait(shared).unwrap_or_else(PoisonError::into_inner);
                }
            }
        }
        None
    }

    fn solve(&self, solver: &mut Solver, case: usize, start: Start) -> Result<(), RunError> {
        let task = &self.tasks[case];
        let lock = || self.shared.lock().unwrap_or_else(PoisonError::into_inner);
        let end = self.run.family.problem_of(&task.variant);
        let end = end.map_err(|reason| RunError::Variant { case: task.case.name.clone(), reason })?;
        let stored = task.store.load(&task.load, self.run.sizes());
        let result = match stored {
            Some(solved) => Ok(solved),
            None => {
                let nominal = Variant::default();
                let (from, variant) = match start {
                    Start::Rest => (Arc::clone(&self.rest), &nominal),
                    Start::Case(index) => {
                        let from = lock().board.state(index).unwrap_or_else(|| Arc::clone(&self.rest));
                        (from, &self.tasks[index].variant)
                    }
                };
                let path = BodiesBetween {
                    family: self.run.family,
                    from: variant,
                    to: &task.variant,
                    end: Arc::clone(&end),
                };
                if let Ok(body) = path.at(0.0) {
                    solver.set_problem(body);
                }
                let result = solver.solve_along(&from.state, &task.load, &path);
                result.map(|(state, report)| describe(solver, state, report))
            }
        };
        match result {
            Ok(solved) => {
                solver.set_problem(end);
                task.store.save(&solved)?;
                if self.run.sensitivities {
                    derivatives::compute(
                        self.run.family,
                        solver,
                        (task.case, &task.variant),
                        &solved.state,
                        &task.store,
                    )
                    .map_err(|e| RunError::Derivatives {
                        case: task.case.name.clone(),
                        reason: Box::new(e),
                    })?;
                }
                let solved = Arc::new(solved);
                let mut shared = lock();
                shared.outcome.solved.push((case, Arc::clone(&solved)));
                (self.notify)(Event::Solved(task.case, &solved));
                shared.board.solved(case, solved);
            }
            Err(error) => {
                let reason = error.to_string();
                let mut shared = lock();
                // From other starts the way ends at the same limit.
                let limit_mpa = error.limit_mpa();
                shared.outcome.limit_mpa = limit_mpa.or(shared.outcome.limit_mpa);
                let again = limit_mpa.is_none() && shared.board.try_next(case);
                (self.notify)(Event::Failed { case: task.case, reason: &reason, again });
                if !again {
                    shared.outcome.failed.push((case, reason));
                    shared.board.failed(case);
                }
            }
        }
        Ok(())
    }
}

/// Stored part of a state.
fn describe(solver: &mut Solver, state: State, report: SolveReport) -> Solved {
    let output = solver.output(&state);
    Solved {
        von_mises_mpa: output.von_mises_mpa.iter().map(|v| *v as f32).collect(),
        contact_force_n: output.contact_force_n,
        cavity_volume_mm3: output.cavity_volume_mm3,
        clearance_mm: solver.clearance_mm(&state),
        report,
        state,
    }
}

/// Fingerprint of a problem: blake3 of the formulation's version, the mesh and the configuration.
pub fn fingerprint(problem: &Problem) -> [u8; 32] {
    let mesh = problem.mesh();
    let mut hasher = blake3::Hasher::new();
    hasher.update(&FORMULATION.to_le_bytes());
    mesh.nodes_mm.as_flattened().iter().for_each(|v| {
        hasher.update(&v.to_le_bytes());
    });
    let walls = mesh.slots.iter().flat_map(|s| [&s.lower, &s.upper]);
    let surfaces = [&mesh.sheet, &mesh.cavity, &mesh.bottom].into_iter().chain(walls);
    let surfaces = surfaces.chain(&mesh.cavities).chain(&mesh.films);
    let indices = mesh.tets.as_flattened().iter().chain(&mesh.fixed_nodes);
    for index in indices.chain(surfaces.flat_map(|s| s.as_flattened())) {
        hasher.update(&index.to_le_bytes());
    }
    mesh.tet_material.iter().for_each(|material| {
        hasher.update(&material.to_le_bytes());
    });
    // The debug form names every constant and prints floats so that they can be read back.
    hasher.update(flat(&format!("{:?}", problem.config())).as_bytes());
    *hasher.finalize().as_bytes()
}
