//! Elements: solid tetrahedra, the sheet's membrane and bending, and the cavity's facets.

pub mod bending;
pub mod cavity;
pub mod membrane;
pub mod tet10;
pub mod tri6;
