//! Mesh as plain data, with its checks.

mod body;
mod check;
mod end;
mod measures;
mod types;

pub(crate) use body::three_digits;
pub use body::{BodyReport, four_digits};
pub(crate) use check::{Boundary, closed, diagnostics, flipped};
pub use end::EndFace;
pub(crate) use measures::enclosed;
pub use measures::{Hollow, Measures, Wall};
pub use types::{Mesh, Slot};
