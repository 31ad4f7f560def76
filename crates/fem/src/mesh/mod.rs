//! Mesh as plain data, with its checks.

mod check;
mod orient;
mod types;

pub(crate) use check::diagnostics;
pub(crate) use orient::{Boundary, closed, flipped};
pub use types::{Mesh, Slot};
