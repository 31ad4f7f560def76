//! Elements: solid tetrahedra, the sheet's membrane and bending, and the cavity's facets.

pub(crate) mod bending;
pub(crate) mod cavity;
pub(crate) mod membrane;
pub(crate) mod spectral;
pub(crate) mod tet10;
pub(crate) mod tri6;
