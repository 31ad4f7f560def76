//! A whole list of cases: several at a time, each from the nearest solved state; every state is stored when it is solved.

mod board;
mod derivatives;
mod folder;
mod runner;
mod schedule;
mod store;

pub use derivatives::{Derivative, DerivativeError};
pub use folder::{extend, write};
pub use runner::{Event, Outcome, Run, RunError, fingerprint};
pub use store::{Sizes, Solved, Store};

use crate::cases::Case;
use crate::family::Family;
use std::path::Path;

/// Solves what is not yet there of a list of cases and writes the database folder; states are kept in its folder `states`. Solves `threads`
/// cases at the same time, about 1 GB each, and keeps derivatives if asked to.
///
/// # Errors
/// [`RunError`]; I/O errors. Solved states are kept.
pub fn solve_into(
    out: &Path,
    family: &Family,
    cases: &[Case],
    (threads, sensitivities): (usize, bool),
    notify: &(dyn Fn(Event<'_>) + Sync),
) -> Result<Outcome, RunError> {
    let store = Store::new(&out.join("states"), fingerprint(&family.problem))?;
    let run = Run { family, store, threads, sensitivities, searches_behind_limits: true };
    let outcome = run.solve(cases, notify)?;
    let derivatives = |case: &Case| run.derivatives(case);
    let derivatives: Option<&dyn Fn(&Case) -> _> = if sensitivities { Some(&derivatives) } else { None };
    write(out, family, cases, &outcome.solved, derivatives)?;
    Ok(outcome)
}
