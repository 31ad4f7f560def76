//! Meshes of any number of chambers, from the grid and from VTU files; a solved state that pins the formulation.

use crate::actuators::{chambers, tiny, with};
use fem::actuator::Actuator;
use fem::run::fingerprint;
use fem::{FORMULATION, Locator, Output, Problem, Solver};
use std::collections::BTreeSet;
use std::sync::Arc;

fn problem(text: &str, size_mm: f64) -> (Actuator, Arc<Problem>) {
    let actuator = Actuator::parse(text).unwrap();
    let mesh = actuator.grid_mesh(size_mm, 1).unwrap();
    let problem = Problem::new(mesh, actuator.problem_config()).unwrap();
    (actuator, Arc::new(problem))
}

/// Volume between the undeformed walls of the cavity: chambers and the channels that join them.
fn cavity_mm3(a: &Actuator) -> f64 {
    let shape = a.shape().unwrap();
    let (floor, c, h) = (shape.cavity_floor_mm(), shape.chambers, shape.channels.unwrap());
    let n = c.count as f64;
    let channel = (c.pitch_mm - c.length_mm) * h.width_mm * (h.top_mm - floor);
    n * c.length_mm * c.width_mm * (c.top_mm - floor) + (n - 1.0) * channel
}

#[test]
fn grids_have_all_surfaces_and_a_closed_cavity() {
    for count in [1, 3, 5] {
        let (actuator, problem) = problem(&chambers(count), 9.0);
        assert_eq!(problem.mesh().slots.len(), count - 1);
        let mut solver = Solver::new(problem).unwrap();
        let start = solver.undeformed();
        let (found, expected) = (solver.output(&start).cavity_volume_mm3, cavity_mm3(&actuator));
        assert!((found / expected - 1.0).abs() < 1.0e-12, "{count}: {found} against {expected} mm3");
    }
}

#[test]
fn grid_size_sets_the_number_of_elements_and_invalid_sizes_are_refused() {
    let actuator = Actuator::parse(&tiny()).unwrap();
    let tets = |size| actuator.grid_mesh(size, 1).unwrap().tets.len();
    assert!(tets(3.0) > tets(9.0) && tets(1.5) > 4 * tets(3.0));
    for size in [0.0, -1.0, f64::NAN, 0.01] {
        let list = actuator.grid_mesh(size, 1).unwrap_err();
        assert!(list[0].place.contains("size"), "{list:?}");
    }
}

#[test]
fn grids_of_a_family_divide_every_box_alike() {
    let actuator = Actuator::parse(&tiny()).unwrap();
    let family = |times| actuator.grid_mesh(9.0, times).unwrap();
    let coarse = family(1);
    for times in [2, 3] {
        let fine = family(times);
        assert_eq!(fine.tets.len(), coarse.tets.len() * times.pow(3));
        let place_nm = |p: &[f64; 3]| p.map(|c| (c * 1.0e6).round() as i64);
        let nodes: BTreeSet<_> = fine.nodes_mm.iter().map(place_nm).collect();
        // Corners of the coarse mesh are nodes of all others; its mid-side nodes need not be.
        let mut corners = coarse.tets.iter().flat_map(|tet| &tet[..4]).map(|n| &coarse.nodes_mm[*n as usize]);
        assert!(corners.all(|p| nodes.contains(&place_nm(p))));
    }
    assert!(actuator.grid_mesh(9.0, 0).is_err());
}

#[test]
fn vtu_of_a_mesh_gives_the_same_problem() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("actuator.toml");
    std::fs::write(&path, tiny()).unwrap();
    let (actuator, direct) = problem(&tiny(), 9.0);
    let mesh = direct.mesh();
    let cells = formats::vtu::Cells::QuadraticTets(&mesh.tets);
    let grid = formats::vtu::Grid { points_mm: &mesh.nodes_mm, cells, point_data: &[] };
    formats::vtu::write(&folder.path().join("mesh.vtu"), &grid).unwrap();
    let read = actuator.read_mesh(&path).unwrap();
    let problem = Problem::new(read, actuator.problem_config()).unwrap();
    assert_eq!(fingerprint(&problem), fingerprint(&direct));
    // The same file for another geometry: its faces are at other positions.
    let other = Actuator::parse(&with(&tiny(), "chambers", "top_mm", "16.0")).unwrap();
    let text = other.read_mesh(&path).map(|mesh| Problem::new(mesh, other.problem_config()).is_err());
    assert!(!matches!(text, Ok(false)), "a mesh of another geometry must not be taken");
    std::fs::write(&path, with(&tiny(), "mesh", "file", "\"mesh.stl\"")).unwrap();
    let refused = Actuator::read(&path).unwrap().read_mesh(&path).unwrap_err().to_string();
    assert!(refused.contains(".msh or .inp"), "{refused}");
}

fn solved(actuator: &Actuator, problem: &Arc<Problem>, pressure_mpa: f64, gap_mm: f64) -> Output {
    let mut solver = Solver::new(Arc::clone(problem)).unwrap();
    let (start, _) = solver.gravity_equilibrium(actuator.loads.gravity_mm_s2).unwrap();
    let (state, report) = solver.solve_to(&start, &actuator.load(pressure_mpa, Some(gap_mm))).unwrap();
    assert!(report.residual_n < 1.0e-3, "{report:?}");
    solver.output(&state)
}

#[test]
fn three_chambers_bend_press_and_touch() {
    let (actuator, problem) = problem(&chambers(3), 9.0);
    let output = solved(&actuator, &problem, 0.06, 1.5);
    assert!(output.contact_force_n > 0.05 && !output.contact_nodes.is_empty(), "{}", output.contact_force_n);
    assert!(output.cavity_volume_mm3 > 1.1 * cavity_mm3(&actuator));
}

/// Flat elements and a soft silicone: pressure softens thin walls, so a step must be predicted with the tangent it begins at.
#[test]
fn soft_finger_on_a_coarse_grid_takes_few_factorisations() {
    let (actuator, problem) = problem(&with(&chambers(3), "elastomer.law", "mu_mpa", "0.3"), 9.0);
    let mut solver = Solver::new(problem).unwrap();
    let (start, _) = solver.gravity_equilibrium(actuator.loads.gravity_mm_s2).unwrap();
    let (_, report) = solver.solve_to(&start, &actuator.load(0.05, None)).unwrap();
    println!("{report:?}");
    assert!(report.cuts == 0 && report.factorisations <= 40, "{report:?}");
}

/// Figures of one small state. A deliberate change requires a new `FORMULATION`, so that old checkpoints are not mixed with new
/// states.
#[test]
fn state_of_this_formulation_version_is_reproduced() {
    let (actuator, problem) = problem(&tiny(), 9.0);
    let output = solved(&actuator, &problem, 0.06, 0.3);
    let largest = output.displacement_mm.iter().copied().fold(0.0, f64::max);
    let stress = output.von_mises_mpa.iter().copied().fold(0.0, f64::max);
    let found = [largest, output.cavity_volume_mm3, output.contact_force_n, stress];
    println!("formulation {FORMULATION}: {found:?}");
    let expected = [1.997_667_41, 1_489.859_35, 1.335_142_91, 0.489_693_61];
    assert_eq!(FORMULATION, 4);
    for (found, expected) in found.iter().zip(expected) {
        assert!((found / expected - 1.0).abs() < 1.0e-4, "{found} against {expected}");
    }
}

/// A state interpolated to a finer mesh leads to the same equilibrium as rest, in fewer factorisations.
#[test]
fn transferred_state_leads_to_the_same_equilibrium() {
    let actuator = Actuator::parse(&tiny()).unwrap();
    let ((_, coarse), (_, fine)) = (problem(&tiny(), 9.0), problem(&tiny(), 3.5));
    assert!(fine.mesh().tets.len() > coarse.mesh().tets.len());
    let (mut on_coarse, mut on_fine) =
        (Solver::new(Arc::clone(&coarse)).unwrap(), Solver::new(Arc::clone(&fine)).unwrap());
    let load = actuator.load(0.05, None);
    let (rest, _) = on_coarse.gravity_equilibrium(actuator.loads.gravity_mm_s2).unwrap();
    let (state, _) = on_coarse.solve_to(&rest, &load).unwrap();
    let same = on_coarse.transferred(&coarse, &state).unwrap();
    for (a, b) in same.displacement_mm.iter().flatten().zip(state.displacement_mm.iter().flatten()) {
        assert!((a - b).abs() < 1.0e-9, "on its own mesh a state is what it was: {a} and {b}");
    }

    let (rest, to_rest) = on_fine.gravity_equilibrium(actuator.loads.gravity_mm_s2).unwrap();
    let (from_rest, inflation) = on_fine.solve_to(&rest, &load).unwrap();
    let start = on_fine.transferred(&coarse, &state).unwrap();
    let (found, report) = on_fine.solve_to(&start, &load).unwrap();
    let off = found.displacement_mm.iter().flatten().zip(from_rest.displacement_mm.iter().flatten());
    let off_mm = off.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    println!("{off_mm:.1e} mm apart, {report:?}");
    assert!(off_mm < 1.0e-4, "{off_mm} mm");
    assert!(report.factorisations < to_rest.factorisations + inflation.factorisations, "{report:?}");

    // Point values of a field: the nodal values at the nodes, none outside.
    let locator = Locator::new(&fine);
    for (n, x) in fine.mesh().nodes_mm.iter().enumerate().step_by(37) {
        let place = locator.place(*x).unwrap();
        let [a, b] = [place.vector(&found.displacement_mm), found.displacement_mm[n]];
        assert!(
            place.outside < 1.0e-9 && (0..3).all(|k| (a[k] - b[k]).abs() < 1.0e-9),
            "node {n}: {a:?} and {b:?}"
        );
    }
    assert!(locator.place([1.0e3, 0.0, 0.0]).is_none_or(|place| place.outside > 1.0));
}
