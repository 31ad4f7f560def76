//! The mesh as plain data, and what must be true of it.

mod check;
mod orient;
mod types;

pub(crate) use check::diagnostics;
pub(crate) use orient::{Boundary, closed, flipped};
pub use types::{Mesh, Slot};
