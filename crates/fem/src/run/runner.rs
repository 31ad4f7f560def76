//! Solves a list of cases on several threads.

use super::schedule::{Next, Schedule};
use super::store::{Sizes, Solved, Store};
use crate::actuator::Actuator;
use crate::cases::Case;
use crate::config::Load;
use crate::linear::LinearError;
use crate::problem::Problem;
use crate::solver::{FORMULATION, Report, SolveError, Solver};
use crate::state::State;
use formats::FormatError;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

/// What happens during a run, for progress bars and logs.
#[derive(Debug)]
pub enum Event<'a> {
    /// The case was found among the checkpoints.
    Reused(&'a Case),
    /// The case is solved.
    Solved(&'a Case, &'a Solved),
    /// The case failed; `again` says whether it will be tried from another state.
    Failed {
        /// The case.
        case: &'a Case,
        /// Why.
        reason: &'a str,
        /// Whether it will be tried again.
        again: bool,
    },
}

/// What came of a run.
#[derive(Debug, Default)]
pub struct Outcome {
    /// Index in the list and state, in the list's order.
    pub solved: Vec<(usize, Arc<Solved>)>,
    /// How many of them were checkpoints.
    pub reused: usize,
    /// Index in the list and reason.
    pub failed: Vec<(usize, String)>,
}

/// Why a run could not go on at all.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// A checkpoint could not be written.
    #[error(transparent)]
    Store(#[from] FormatError),
    /// There is no equilibrium under gravity alone.
    #[error("no equilibrium under gravity alone: {0}")]
    Gravity(SolveError),
    /// The factor does not fit into memory.
    #[error(transparent)]
    Memory(#[from] LinearError),
}

/// Solves a list of cases of one actuator.
pub struct Run<'a> {
    /// The actuator, which turns a case into loads.
    pub actuator: &'a Actuator,
    /// Its problem.
    pub problem: Arc<Problem>,
    /// Where states are kept.
    pub store: Store,
    /// Cases solved at the same time, 1 or more; about 1 GB each.
    pub threads: usize,
}

/// What threads share.
struct Shared {
    schedule: Schedule,
    outcome: Outcome,
    broken: Option<RunError>,
}

impl Run<'_> {
    /// Solves all cases; a failed one never stops the others. `notify` is called from any thread, one call at a
    /// time.
    ///
    /// # Errors
    /// [`RunError`] where nothing more can be done; what was solved is kept.
    pub fn solve(&self, cases: &[Case], notify: &(dyn Fn(Event<'_>) + Sync)) -> Result<Outcome, RunError> {
        let mut outcome = Outcome::default();
        let mut waiting = Vec::new();
        for (index, case) in cases.iter().enumerate() {
            match self.store.load(&self.load(case), self.sizes()) {
                Some(solved) => {
                    notify(Event::Reused(case));
                    outcome.solved.push((index, Arc::new(solved)));
                }
                None => waiting.push(index),
            }
        }
        outcome.reused = outcome.solved.len();
        if !waiting.is_empty() {
            let gravity_only = self.gravity_only()?;
            let mut starts = outcome.solved.clone();
            starts.push((cases.len(), Arc::new(gravity_only)));
            let shared =
                Mutex::new(Shared { schedule: Schedule::new(waiting, starts), outcome, broken: None });
            let changed = Condvar::new();
            std::thread::scope(|scope| {
                for _ in 0..self.threads.max(1) {
                    scope.spawn(|| self.work(cases, &shared, &changed, notify));
                }
            });
            let shared = shared.into_inner().unwrap_or_else(PoisonError::into_inner);
            if let Some(error) = shared.broken {
                return Err(error);
            }
            outcome = shared.outcome;
        }
        outcome.solved.sort_by_key(|(index, _)| *index);
        outcome.failed.sort_by_key(|(index, _)| *index);
        Ok(outcome)
    }

    /// The state under gravity alone, from its checkpoint where there is one.
    fn gravity_only(&self) -> Result<Solved, RunError> {
        let load = self.actuator.load(0.0, None);
        if let Some(solved) = self.store.load(&load, self.sizes()) {
            return Ok(solved);
        }
        let mut solver = Solver::new(Arc::clone(&self.problem))?;
        let (state, report) = solver.gravity_equilibrium(load.gravity_mm_s2).map_err(RunError::Gravity)?;
        let solved = describe(&mut solver, state, report);
        self.store.save(&solved)?;
        Ok(solved)
    }

    /// The loop of one thread: takes the nearest case, solves it, stores and reports the state.
    fn work(
        &self,
        cases: &[Case],
        shared: &Mutex<Shared>,
        changed: &Condvar,
        notify: &(dyn Fn(Event<'_>) + Sync),
    ) {
        let lock = || shared.lock().unwrap_or_else(PoisonError::into_inner);
        let stop = |error: RunError| {
            lock().broken = Some(error);
            changed.notify_all();
        };
        let mut solver = match Solver::new(Arc::clone(&self.problem)) {
            Ok(solver) => solver,
            Err(error) => return stop(error.into()),
        };
        while let Some((case, start, tries)) = take(lock(), changed, cases) {
            let result = solver.solve_to(&start.state, &self.load(&cases[case]));
            match result {
                Ok((state, report)) => {
                    let solved = Arc::new(describe(&mut solver, state, report));
                    if let Err(error) = self.store.save(&solved) {
                        return stop(error.into());
                    }
                    let mut shared = lock();
                    shared.outcome.solved.push((case, Arc::clone(&solved)));
                    notify(Event::Solved(&cases[case], &solved));
                    shared.schedule.finished(case, solved);
                }
                Err(error) => {
                    let reason = error.to_string();
                    let mut shared = lock();
                    let again = shared.schedule.failed(case, tries);
                    notify(Event::Failed { case: &cases[case], reason: &reason, again });
                    if !again {
                        shared.outcome.failed.push((case, reason));
                    }
                }
            }
            changed.notify_all();
        }
    }

    fn load(&self, case: &Case) -> Load {
        self.actuator.load(case.pressure_mpa, case.gap_mm)
    }

    fn sizes(&self) -> Sizes {
        let mesh = self.problem.mesh();
        Sizes { nodes: mesh.nodes_mm.len(), tets: mesh.tets.len(), sheet: mesh.sheet.len() }
    }
}

/// The next case to solve; waits while there is none but other threads may add one.
fn take(
    mut shared: MutexGuard<'_, Shared>,
    changed: &Condvar,
    cases: &[Case],
) -> Option<(usize, Arc<Solved>, usize)> {
    loop {
        if shared.broken.is_some() {
            return None;
        }
        match shared.schedule.next(cases) {
            Next::Solve(case, start, tries) => return Some((case, start, tries)),
            Next::Done => return None,
            Next::Wait => shared = changed.wait(shared).unwrap_or_else(PoisonError::into_inner),
        }
    }
}

/// The part of a state that is stored.
fn describe(solver: &mut Solver, state: State, report: Report) -> Solved {
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

/// What notifys one problem from another: blake3 of the formulation's version, the mesh and the configuration.
#[must_use]
pub fn fingerprint(problem: &Problem) -> [u8; 32] {
    let mesh = problem.mesh();
    let mut hasher = blake3::Hasher::new();
    hasher.update(&FORMULATION.to_le_bytes());
    mesh.nodes_mm.as_flattened().iter().for_each(|v| {
        hasher.update(&v.to_le_bytes());
    });
    let walls = mesh.slots.iter().flat_map(|s| [&s.lower, &s.upper]);
    let surfaces = [&mesh.sheet, &mesh.cavity, &mesh.bottom].into_iter().chain(walls);
    let indices = mesh.tets.as_flattened().iter().chain(&mesh.fixed_nodes);
    for index in indices.chain(surfaces.flat_map(|s| s.as_flattened())) {
        hasher.update(&index.to_le_bytes());
    }
    // The debug form names every constant and prints floats so that they can be read back.
    hasher.update(format!("{:?}", problem.config()).as_bytes());
    *hasher.finalize().as_bytes()
}
