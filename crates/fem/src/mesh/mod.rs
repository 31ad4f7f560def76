//! Mesh as plain data, with its checks.

mod check;
mod end;
mod orient;
mod types;

pub(crate) use check::diagnostics;
pub(crate) use orient::{Boundary, closed, flipped};
pub use end::EndFace;
pub use types::{Mesh, Slot};
