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
