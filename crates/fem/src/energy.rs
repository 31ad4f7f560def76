//! Energies whose derivatives the internal and contact forces are.

use crate::algebra::{Vec3, dot};
use crate::contact::Obstacle;
use crate::element::tet10::{Invalid, TetGeometry, point};
use crate::element::{bending, membrane};
use crate::material::{Elastomer, Hyperelastic};
use crate::problem::Problem;
use crate::system::{InvalidState, face};

/// Strain energy (N mm) of elastomer and sheet, `W_solid + K/(2V) (integral (J - 1))^2 + W_sheet + x.Hx/2`, with stresses that
/// follow from the displacements `u`.
///
/// # Errors
/// [`InvalidState`] names the element that collapsed or passed its material's limit.
pub(crate) fn strain_n_mm(problem: &Problem, u: &[Vec3]) -> Result<f64, InvalidState> {
    let mut sum = 0.0;
    for (e, (tet, geometry)) in problem.mesh.tets.iter().zip(&problem.tets).enumerate() {
        let material = problem.elastomer(e);
        sum += solid(geometry, &tet.map(|n| u[n as usize]), material)
            .map_err(|reason| InvalidState { reason, element: e })?;
    }
    let x = problem.positions(u);
    for (t, (tri, geometry)) in problem.sheet.triangles.iter().zip(&problem.sheet.membrane).enumerate() {
        let (corners, law) = (tri.map(|n| x[n as usize]), problem.sheet.law(t));
        for (q, weight) in geometry.weights.iter().enumerate() {
            sum += weight * law.energy(membrane::strain(geometry, q, &corners));
        }
    }
    let mut bent = vec![[0.0; 3]; x.len()];
    bending::add_force(&problem.sheet.bending, &x, &mut bent);
    Ok(sum + 0.5 * x.iter().zip(&bent).map(|(x, f)| dot(*x, *f)).sum::<f64>())
}

/// Energy (N mm) of the obstacle's penalty at displacements `u`.
pub(crate) fn obstacle_n_mm(problem: &Problem, u: &[Vec3], obstacle: Obstacle) -> f64 {
    let Some(face) = face(problem, obstacle) else { return 0.0 };
    let x = problem.positions(u);
    let nodes = problem.contact_nodes.iter().zip(&problem.contact_stiffness_n_per_mm);
    nodes.filter_map(|(n, k)| Some(k * face.touch(x[*n as usize])?.penalty.energy)).sum()
}

/// Energy (N mm) of the penalty between the walls of slots at displacements `u`. The forces are its derivative at a fixed normal.
pub(crate) fn slots_n_mm(problem: &Problem, u: &[Vec3]) -> f64 {
    let (x, settings) = (problem.positions(u), &problem.config.contact);
    let touching = problem.slots.iter().flat_map(|walls| walls.contacts(&x, settings.slot_smoothing_mm));
    let energy = touching.map(|contact| contact.pair.area_mm2 * contact.penalty.energy);
    settings.slot_penalty_mpa_per_mm * energy.sum::<f64>()
}

/// Strain energy (N mm) of an element.
fn solid(geometry: &TetGeometry, u: &[Vec3; 10], material: &Elastomer) -> Result<f64, Invalid> {
    let (w, change) = isochoric(geometry, u, &material.law)?;
    let mean = material.element_bulk_mpa() / geometry.volume_mm3() * change * change;
    Ok(w + 0.5 * (mean + material.point_bulk_mpa() * squared_change(geometry, u, &material.law)?))
}

/// Squared volume change `integral (J - 1)^2` (mm3) of an element.
pub(crate) fn squared_change(
    geometry: &TetGeometry,
    u: &[Vec3; 10],
    law: &Hyperelastic,
) -> Result<f64, Invalid> {
    (0..4).map(|q| Ok(geometry.weights[q] * (point(geometry, q, u, law)?.det - 1.0).powi(2))).sum()
}

/// Isochoric strain energy (N mm) and volume change `integral (J - 1)` (mm3) of an element.
pub(crate) fn isochoric(
    geometry: &TetGeometry,
    u: &[Vec3; 10],
    law: &Hyperelastic,
) -> Result<(f64, f64), Invalid> {
    let mut sum = (0.0, 0.0);
    for q in 0..4 {
        let p = point(geometry, q, u, law)?;
        sum.0 += geometry.weights[q] * p.w;
        sum.1 += geometry.weights[q] * (p.det - 1.0);
    }
    Ok(sum)
}
