//! Total potential energy, the scalar whose derivative the residual is: `strain + obstacle - p V_cavity - m g . u`. Contact of
//! slot walls is left out: its normal is held while force and tangent are formed, so it has no exact potential.

use crate::algebra::dot;
use crate::config::Load;
use crate::element::cavity::face_terms;
use crate::energy::{obstacle_n_mm, strain_n_mm};
use crate::problem::Problem;
use crate::state::State;
use crate::system::InvalidState;

/// Potential energy (N mm) of a state under a load, with stresses that follow from the displacements.
///
/// # Errors
/// [`InvalidState`] names the element that collapsed or passed its material's limit.
pub fn potential_n_mm(problem: &Problem, state: &State, load: &Load) -> Result<f64, InvalidState> {
    let u = &state.displacement_mm;
    let mut sum = strain_n_mm(problem, u)? + obstacle_n_mm(problem, u, load.obstacle);
    let x = problem.positions(u);
    for nodes in &problem.cavity {
        let terms = face_terms(&nodes.map(|n| x[n as usize]), problem.config.cavity_load);
        sum -= load.pressure_mpa * terms.volume_mm3;
    }
    for (u, mass) in u.iter().zip(&problem.node_mass_t) {
        sum -= mass * dot(load.gravity_mm_s2, *u);
    }
    Ok(sum)
}
