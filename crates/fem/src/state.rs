//! Solved state, the start of a continuation and the source of the output.

use crate::algebra::{Vec3, norm};
use crate::config::Load;
use crate::element::membrane::Plane;

/// Displacements with the stress unknowns of the mixed formulation; valid for one problem.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct State {
    /// Nodal displacements (mm).
    pub displacement_mm: Vec<Vec3>,
    /// Pressure unknown of each tetrahedron (MPa, tension positive).
    pub element_pressure_mpa: Vec<f64>,
    /// Membrane resultants of each sheet triangle's three Gauss points (11, 22, 12; N/mm).
    pub sheet_resultants_n_per_mm: Vec<[Plane; 3]>,
    /// The loads this state is in equilibrium with.
    pub load: Load,
}

impl State {
    /// Largest displacement of a node (mm).
    pub fn largest_displacement_mm(&self) -> f64 {
        self.displacement_mm.iter().map(|u| norm(*u)).fold(0.0, f64::max)
    }
}
