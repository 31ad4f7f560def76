//! Mesh as plain data, with its checks.

mod body;
mod check;
mod end;
mod measures;
mod orient;
mod types;

pub use body::{BodyReport, four_digits};
pub(crate) use check::diagnostics;
pub use end::EndFace;
pub(crate) use measures::enclosed;
pub use measures::{Hollow, Measures, Wall};
pub(crate) use orient::{Boundary, closed, flipped};
pub use types::{Mesh, Slot};
