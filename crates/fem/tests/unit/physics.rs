//! Properties of the whole problem on small bodies made in code.

use std::sync::Arc;

use super::builder::{Builder, close};
use super::noise;
use super::potential::potential_n_mm;
use crate::algebra::{Mat3, Vec3, add, axpy, dot, mat_vec, norm, scale, sub};
use crate::config::{ContactSettings, GRAVITY_DOWN_MM_S2, NewtonSettings};
use crate::element::{membrane, tet10};
use crate::linear::CONSTRAINED;
use crate::linear::nested_dissection;
use crate::mesh::{Mesh, Slot};
use crate::newton::{Closure, Effort, NewtonError};
use crate::system::{Ahead, System};
use crate::{
    Load, Obstacle, Problem, ProblemConfig, ProblemError, Round, RoundShape, SolveError, Solver, State,
    StressRecovery,
};
use rom::snapshots::Footprint;

/// First scalar unknown of a node; `None` where it is fixed.
fn unknown(problem: &Problem, node: usize) -> Option<usize> {
    let free = problem.free[node];
    (free != CONSTRAINED).then(|| 3 * free as usize)
}

/// A hollow finger of 24 x 6 x 6 mm with the sheet on its underside, held at x = 0.
fn finger() -> Mesh {
    let mut b = Builder::default();
    b.cells([0.0; 3], [24.0, 6.0, 6.0], [8, 3, 3], |[i, j, k]| !(j == 1 && k == 1 && (1..7).contains(&i)));
    b.mesh.cavity =
        b.faces(|p| p[0] > 2.9 && p[0] < 21.1 && p[1] > 1.9 && p[1] < 4.1 && p[2] > 1.9 && p[2] < 4.1);
    b.mesh.bottom = b.faces(|p| p[1] < 1.0e-9);
    b.mesh.sheet = b.mesh.bottom.clone();
    b.mesh.fixed_nodes = b.nodes_where(|p| p[0] < 1.0e-9);
    b.mesh
}

#[test]
fn stress_from_positions_equals_the_solutions() {
    let problem = Arc::new(Problem::new(finger(), config()).unwrap());
    let mut solver = Solver::new(Arc::clone(&problem)).unwrap();
    let load = Load { pressure_mpa: 0.02, ..Load::default() };
    let (state, _) = solver.solve_to(&solver.undeformed(), &load).unwrap();
    let output = solver.output(&state);
    let stress = |recovery: &StressRecovery, count: usize| {
        let mut out = vec![0.0; count];
        let positions: Vec<Vec3> =
            recovery.needed().iter().map(|n| output.coordinates_mm[*n as usize]).collect();
        recovery.evaluate(&positions, &mut out);
        out
    };
    let nodes = output.von_mises_mpa.len();
    let largest = output.von_mises_mpa.iter().copied().fold(0.0, f64::max);
    let all = stress(&StressRecovery::new(Arc::clone(&problem), None), nodes);
    for (node, (found, exact)) in all.iter().zip(&output.von_mises_mpa).enumerate() {
        assert!((found - exact).abs() < 1.0e-12 * largest, "node {node}: {found} is not {exact}");
    }
    // In the requested order, and from the positions around these nodes alone.
    let set = [nodes as u32 - 1, 0, nodes as u32 / 2];
    let of_set = StressRecovery::new(problem, Some(&set));
    assert_eq!(stress(&of_set, 3), set.map(|node| all[node as usize]));
    assert!(set.iter().all(|node| of_set.needed().contains(node)) && of_set.needed().len() < nodes / 2);
}

/// From displacements in which Newton's iteration goes astray.
#[test]
fn descent_ends_at_the_equilibrium_of_its_volume() {
    let problem = Arc::new(Problem::new(finger(), config()).unwrap());
    let mut solver = Solver::new(Arc::clone(&problem)).unwrap();
    let injected = |mm3| Load { injected_mm3: Some(mm3), ..Load::default() };
    let (exact, _) = solver.solve_to(&solver.undeformed(), &injected(30.0)).unwrap();
    let displaced = |n: usize| {
        let size = if problem.free[n] == CONSTRAINED { 0.0 } else { 0.05 };
        std::array::from_fn(|i| size * noise(3 * n + i))
    };
    let mut state = follow(&problem, (0..problem.free.len()).map(displaced).collect(), Load::default());
    let (volume_mm3, mut effort) = (problem.undeformed_volume_mm3() + 30.0, Effort::default());
    let mut astray = state.clone();
    solver.newton().closure = Some(Closure::Volume(volume_mm3));
    assert!(solver.newton().iterate(&mut astray, &Load::default(), &mut effort).is_err());
    solver.newton().descend(&mut state, volume_mm3, &mut effort).unwrap();
    let apart = state.displacement_mm.iter().zip(&exact.displacement_mm).map(|(a, b)| norm(sub(*a, *b)));
    let apart_mm = apart.fold(0.0, f64::max);
    assert!(apart_mm < 1.0e-5 && close(state.load.pressure_mpa, exact.load.pressure_mpa, 1e-6), "{apart_mm}");
}

/// Two towers on a base with a slot of 1 mm between them.
fn towers() -> Mesh {
    let mut b = Builder::default();
    b.cells([0.0; 3], [5.0, 3.0, 2.0], [5, 3, 2], |[i, j, _]| j == 0 || i != 2);
    let wall = |x: f64| move |p: [f64; 3]| (p[0] - x).abs() < 1.0e-9 && p[1] > 0.9;
    b.mesh.slots = vec![Slot { lower: b.faces(wall(2.0)), upper: b.faces(wall(3.0)) }];
    b.mesh.bottom = b.faces(|p| p[1] < 1.0e-9);
    b.mesh.fixed_nodes = b.nodes_where(|p| p[0] < 1.0e-9);
    b.mesh
}

fn config() -> ProblemConfig {
    let plate = Footprint { x_mm: [-100.0, 100.0], z_mm: [-100.0, 100.0] };
    ProblemConfig { plate, block: plate, ..ProblemConfig::default() }
}

fn shaken(problem: &Problem, size: f64, load: Load) -> State {
    let nodes = problem.mesh().nodes_mm.len();
    let u = (0..nodes).map(|n| std::array::from_fn(|i| size * noise(3 * n + i))).collect();
    follow(problem, u, load)
}

/// The state whose element pressures and resultants follow from the displacements.
fn follow(problem: &Problem, u: Vec<Vec3>, load: Load) -> State {
    let mesh = problem.mesh();
    let pressure = |(e, tet): (usize, &[u32; 10])| {
        let geometry = tet10::TetGeometry::new(&tet.map(|n| mesh.nodes_mm[n as usize])).unwrap();
        let material = problem.elastomer(e);
        let (_, change) =
            crate::energy::isochoric(&geometry, &tet.map(|n| u[n as usize]), &material.law).unwrap();
        material.element_bulk_mpa() * change / geometry.volume_mm3()
    };
    let x = problem.positions(&u);
    let axes = mesh.sheet.first().map(|t| membrane::plane_axes(&t.map(|n| mesh.nodes_mm[n as usize])));
    let resultants = |t: &[u32; 6]| {
        let undeformed = t.map(|n| mesh.nodes_mm[n as usize]);
        let geometry = membrane::MembraneGeometry::new(&undeformed, axes.unwrap()).unwrap();
        let law = membrane::Law::of_sheet(&problem.config().sheet.unwrap());
        let at = t.map(|n| x[n as usize]);
        std::array::from_fn(|q| law.resultant(membrane::strain(&geometry, q, &at)))
    };
    State {
        element_pressure_mpa: mesh.tets.iter().enumerate().map(pressure).collect(),
        sheet_resultants_n_per_mm: mesh.sheet.iter().map(resultants).collect(),
        displacement_mm: u,
        load,
    }
}

fn residual(problem: &Problem, state: &State, load: &Load) -> Vec<Vec3> {
    let mut system = System::new(problem);
    system.assemble(problem, state, load, Ahead::default(), false).unwrap();
    system.condensed
}

fn total(forces: &[Vec3]) -> Vec3 {
    forces.iter().fold([0.0; 3], |sum, f| add(sum, *f))
}

#[test]
fn homogeneous_deformation_passes_the_patch_test() {
    let mut b = Builder::default();
    b.solid([0.0; 3], [3.0; 3], [3, 3, 3]);
    let inside = |p: Vec3| p.iter().all(|v| *v > 1.0e-6 && *v < 3.0 - 1.0e-6);
    // Corners inside are moved, mid-sides follow: an irregular patch of straight-sided elements.
    let nodes = &mut b.mesh.nodes_mm;
    for (n, p) in nodes.iter_mut().enumerate() {
        if inside(*p) && p.iter().all(|v| (v - v.round()).abs() < 1.0e-6) {
            *p = std::array::from_fn(|i| p[i] + 0.2 * noise(3 * n + i));
        }
    }
    for tet in &b.mesh.tets {
        for (m, [a, c]) in formats::mesh_file::TET_EDGES.into_iter().enumerate() {
            nodes[tet[4 + m] as usize] = scale(0.5, add(nodes[tet[a] as usize], nodes[tet[c] as usize]));
        }
    }
    b.mesh.fixed_nodes = vec![0];
    let problem = Problem::new(b.mesh, config()).unwrap();
    let gradient: Mat3 = [[0.3, 0.1, -0.05], [0.02, -0.2, 0.15], [0.1, 0.0, 0.1]];
    let u: Vec<Vec3> = problem.mesh().nodes_mm.iter().map(|x| mat_vec(&gradient, *x)).collect();
    let state = follow(&problem, u, Load::default());
    let forces = residual(&problem, &state, &Load::default());
    let scale_n = forces.iter().map(|f| norm(*f)).fold(0.0, f64::max);
    let inner = problem.mesh().nodes_mm.iter().zip(&forces).filter(|(x, _)| inside(**x));
    let worst = inner.map(|(_, f)| norm(*f)).fold(0.0, f64::max) / scale_n;
    println!("patch test: largest force inside {worst:.1e} of the largest on the boundary");
    for (x, f) in problem.mesh().nodes_mm.iter().zip(&forces) {
        assert!(!inside(*x) || norm(*f) < 1.0e-10 * scale_n, "{x:?}: {f:?} of {scale_n}");
    }
}

#[test]
fn residual_and_tangent_are_derivatives_of_the_energy() {
    let round = |form| Round { form, radius_mm: 40.0, centre_mm: [12.0, 3.0] };
    for round in [None, Some(round(RoundShape::Sphere)), Some(round(RoundShape::Cylinder))] {
        derivatives_agree(&Problem::new(finger(), ProblemConfig { round, ..config() }).unwrap());
    }
}

fn derivatives_agree(problem: &Problem) {
    let load = Load {
        pressure_mpa: 0.05,
        obstacle: Obstacle::Plate { gap_mm: 0.02 },
        gravity_mm_s2: [1.0e3, -9810.0, 2.0e3],
        ..Load::default()
    };
    let state = shaken(problem, 0.05, load);
    let nodes = state.displacement_mm.len();
    let direction: Vec<Vec3> = (0..nodes)
        .map(|n| unknown(problem, n).map_or([0.0; 3], |_| std::array::from_fn(|i| noise(9000 + 3 * n + i))))
        .collect();
    let moved = |step: f64| {
        let u = state.displacement_mm.iter().zip(&direction).map(|(u, d)| add(*u, scale(step, *d))).collect();
        follow(problem, u, load)
    };
    let step = 1.0e-6;
    let (up, down) = (moved(step), moved(-step));
    let energy = |s: &State| potential_n_mm(problem, s, &load).unwrap();
    let slope = (energy(&up) - energy(&down)) / (2.0 * step);
    let mut system = System::new(problem);
    system.assemble(problem, &state, &load, Ahead::default(), true).unwrap();
    assert!(system.contact_force_n > 0.0, "the obstacle must touch for the test to mean anything");
    let work: f64 = system.condensed.iter().zip(&direction).map(|(f, d)| dot(*f, *d)).sum();
    println!("energy: derivative {slope:.9e} N, force {:.9e} N along the same direction", -work);
    assert!(close(-work, slope, 1.0e-6), "{} against {slope}", -work);

    let mut v = vec![0.0; problem.pattern.unknowns()];
    for (n, d) in direction.iter().enumerate() {
        if let Some(k) = unknown(problem, n) {
            v[k..k + 3].copy_from_slice(d);
        }
    }
    let kv = problem.pattern.multiply(&system.tangent, &v);
    let (up, down) = (residual(problem, &up, &load), residual(problem, &down, &load));
    let largest = kv.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    for n in 0..nodes {
        if let Some(k) = unknown(problem, n) {
            for i in 0..3 {
                let measured = -(up[n][i] - down[n][i]) / (2.0 * step);
                assert!(
                    (kv[k + i] - measured).abs() < 1.0e-6 * largest,
                    "node {n}: {} {measured}",
                    kv[k + i]
                );
            }
        }
    }
}

#[test]
fn forces_rotate_with_the_body_and_vanish_under_rigid_motion() {
    let problem = Problem::new(finger(), config()).unwrap();
    let (c, s) = (0.6, 0.8);
    let turn: Mat3 = [[c, -s * 0.6, s * 0.8], [s, c * 0.6, -c * 0.8], [0.0, 0.8, 0.6]];
    let load = Load { pressure_mpa: 0.03, ..Load::default() };
    let state = shaken(&problem, 0.05, load);
    let turned = |u: &[Vec3]| {
        let x = problem.positions(u);
        let new = x.iter().map(|p| add(mat_vec(&turn, *p), [3.0, -1.0, 2.0]));
        let u = new.zip(&problem.mesh().nodes_mm).map(|(p, x)| sub(p, *x)).collect();
        follow(&problem, u, load)
    };
    let (before, after) =
        (residual(&problem, &state, &load), residual(&problem, &turned(&state.displacement_mm), &load));
    let largest = before.iter().map(|f| norm(*f)).fold(0.0, f64::max);
    let turned_by = |(a, b): (&Vec3, &Vec3)| norm(sub(mat_vec(&turn, *a), *b)) / largest;
    let worst = before.iter().zip(&after).map(turned_by).fold(0.0, f64::max);
    println!("frame invariance: forces turn with the body to {worst:.1e} of the largest");
    for (a, b) in before.iter().zip(&after) {
        assert!(norm(sub(mat_vec(&turn, *a), *b)) < 1.0e-9 * largest);
    }
    let rest = vec![[0.0; 3]; state.displacement_mm.len()];
    let unloaded = residual(&problem, &turned(&rest), &Load::default());
    let most = unloaded.iter().map(|f| norm(*f)).fold(0.0, f64::max);
    println!("rigid motion: largest force {most:.1e} N");
    assert!(unloaded.iter().all(|f| norm(*f) < 1.0e-8), "a rigid motion must not strain the body");
}

#[test]
fn pressure_and_wall_forces_balance_and_the_plate_reacts() {
    let finger = Problem::new(finger(), config()).unwrap();
    let free = Load { pressure_mpa: 0.05, ..Load::default() };
    let state = shaken(&finger, 0.05, free);
    assert!(norm(total(&residual(&finger, &state, &free))) < 1.0e-9, "a closed cavity exerts no net force");
    let plate = Load { obstacle: Obstacle::Plate { gap_mm: 0.02 }, ..free };
    let mut system = System::new(&finger);
    system.assemble(&finger, &state, &plate, Ahead::default(), false).unwrap();
    let sum = total(&system.condensed);
    assert!(close(sum[1], system.contact_force_n, 1.0e-9) && sum[0].abs() + sum[2].abs() < 1.0e-9);

    let towers = Problem::new(towers(), config()).unwrap();
    let nodes = towers.mesh().nodes_mm.clone();
    // The right tower leans on the left one.
    let lean =
        |x: &Vec3| if x[0] > 2.9 && x[1] > 0.9 { [-0.7 * (x[1] - 0.5), 0.02 * x[2], 0.0] } else { [0.0; 3] };
    let state = follow(&towers, nodes.iter().map(lean).collect(), Load::default());
    let none = ProblemConfig {
        contact: ContactSettings { slot_penalty_mpa_per_mm: 0.0, ..Default::default() },
        ..config()
    };
    let apart = Problem::new(towers.mesh().clone(), none).unwrap();
    let (with, without) =
        (residual(&towers, &state, &Load::default()), residual(&apart, &state, &Load::default()));
    let contact: Vec<Vec3> = with.iter().zip(&without).map(|(a, b)| sub(*a, *b)).collect();
    let on_left = contact.iter().zip(&nodes).filter(|(_, x)| x[0] < 2.5).map(|(f, _)| *f);
    let on_left = total(&on_left.collect::<Vec<_>>());
    assert!(on_left[0] < -0.1, "the left tower must be pushed: {on_left:?}");
    println!(
        "wall contact: {:.4} N on the left, sum of both sides {:.1e} N",
        on_left[0],
        norm(total(&contact))
    );
    assert!(norm(total(&contact)) < 1.0e-12 * norm(on_left).max(1.0), "action = reaction");
}

#[test]
fn contact_state_is_independent_of_the_path() {
    let newton = NewtonSettings { correction_tolerance_mm: 1.0e-7, ..NewtonSettings::default() };
    let problem = Arc::new(Problem::new(finger(), ProblemConfig { newton, ..config() }).unwrap());
    let mut solver = Solver::new(problem).unwrap();
    let (rest, _) = solver.gravity_equilibrium(GRAVITY_DOWN_MM_S2).unwrap();
    let at = |pressure_mpa, gap: Option<f64>| Load {
        pressure_mpa,
        obstacle: gap.map_or(Obstacle::None, |gap_mm| Obstacle::Plate { gap_mm }),
        gravity_mm_s2: GRAVITY_DOWN_MM_S2,
        ..Load::default()
    };
    let (free, _) = solver.solve_to(&rest, &at(0.5, None)).unwrap();
    let sag = crate::output::clearance_mm(solver.problem(), &free);
    assert!(sag > 0.2, "the finger must bend towards the plate: {sag}");
    let target = at(0.5, Some(0.5 * sag));
    let (direct, report) = solver.solve_to(&rest, &target).unwrap();
    let (pressed, _) = solver.solve_to(&free, &target).unwrap();
    for (a, b) in direct.displacement_mm.iter().zip(&pressed.displacement_mm) {
        assert!(norm(sub(*a, *b)) < 1.0e-6);
    }
    let apart = direct.displacement_mm.iter().zip(&pressed.displacement_mm).map(|(a, b)| norm(sub(*a, *b)));
    println!("path independence: two paths to one state differ by {:.1e} mm", apart.fold(0.0, f64::max));
    let output = solver.output(&direct);
    assert!(output.contact_force_n > 1.0e-2 && !output.contact_nodes.is_empty());
    println!("equilibrium: {:.1e} N out of balance at {:.4} N", report.residual_n, output.contact_force_n);
    assert!(report.residual_n < 1.0e-6 * output.contact_force_n, "{report:?}");
    assert!(output.von_mises_mpa.iter().all(|s| s.is_finite()) && output.von_mises_owner_mpa.is_empty());
    // Withdrawn, the plate leaves the free state behind.
    let (back, _) = solver.solve_to(&direct, &at(0.5, None)).unwrap();
    for (a, b) in back.displacement_mm.iter().zip(&free.displacement_mm) {
        assert!(norm(sub(*a, *b)) < 1.0e-6);
    }
}

/// Small corrections are not sufficient: the iteration continues until the forces balance.
#[test]
fn state_is_accepted_only_with_balanced_forces() {
    let forces = |newton: NewtonSettings| -> Result<Vec<f64>, SolveError> {
        let problem = Arc::new(Problem::new(finger(), ProblemConfig { newton, ..config() }).unwrap());
        let mut solver = Solver::new(problem).unwrap();
        let (rest, _) = solver.gravity_equilibrium(GRAVITY_DOWN_MM_S2)?;
        let free = Load { pressure_mpa: 0.5, gravity_mm_s2: GRAVITY_DOWN_MM_S2, ..Load::default() };
        let (mut state, _) = solver.solve_to(&rest, &free)?;
        let sag = crate::output::clearance_mm(solver.problem(), &state);
        let at = |fraction: f64| Load { obstacle: Obstacle::Plate { gap_mm: fraction * sag }, ..free };
        let force = |fraction: &f64| {
            let (next, report) = solver.solve_to(&state, &at(*fraction))?;
            assert!(report.residual <= crate::MAX_RESIDUAL, "{report:?}");
            state = next;
            Ok(solver.output(&state).contact_force_n)
        };
        [0.995, 0.9, 0.5, 0.7, 0.98, 1.001].iter().map(force).collect()
    };
    let tight = NewtonSettings {
        correction_tolerance_mm: 1.0e-9,
        force_tolerance_n: 1.0e-9,
        ..NewtonSettings::default()
    };
    let (exact, usual) = (forces(tight).unwrap(), forces(NewtonSettings::default()).unwrap());
    let off = usual.iter().zip(&exact).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    println!("contact force with the usual tolerances: off by {off:.1e} N");
    assert!(off < 1.0e-6, "{off:e}");
    let loose = NewtonSettings {
        correction_tolerance_mm: 0.05,
        force_tolerance_n: f64::INFINITY,
        ..NewtonSettings::default()
    };
    let watched = forces(loose).unwrap().iter().zip(&exact).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    println!("with loose tolerances: {watched:.1e} N");
    assert!(watched < 1.0e-3, "{watched:e}");
}

#[test]
fn unreachable_pressure_is_refused_with_the_last_equilibrium() {
    // The end of the path need not be located exactly.
    let newton = NewtonSettings { smallest_step: 0.1, max_iterations: 8, ..NewtonSettings::default() };
    let problem = Arc::new(Problem::new(finger(), ProblemConfig { newton, ..config() }).unwrap());
    let mut solver = Solver::new(problem).unwrap();
    let start = solver.undeformed();
    let load = Load { pressure_mpa: 5.0, ..Load::default() };
    let Err(SolveError::NotConverged(stop)) = solver.solve_to(&start, &load) else {
        panic!("must not be reached")
    };
    println!("unbearable: {stop}");
    assert!(stop.fraction > 0.0 && stop.fraction < 1.0 && stop.last.pressure_mpa < 5.0, "{stop}");
    assert!(stop.to_string().contains("5 MPa"), "{stop}");
    for (bad, name) in [(f64::NAN, "pressure_mpa"), (-0.1, "pressure_mpa")] {
        let load = Load { pressure_mpa: bad, ..Load::default() };
        assert!(matches!(solver.solve_to(&start, &load), Err(SolveError::Load { name: n, .. }) if n == name));
    }
    let inside = Load { obstacle: Obstacle::Plate { gap_mm: -1.0 }, ..Load::default() };
    assert!(matches!(solver.solve_to(&start, &inside), Err(SolveError::Load { name: "gap_mm", .. })));
    let foreign = State::default();
    assert!(matches!(solver.solve_to(&foreign, &Load::default()), Err(SolveError::ForeignState { .. })));
}

/// A path of thousands of short steps ends with an error.
#[test]
fn path_of_too_many_steps_ends() {
    let newton = NewtonSettings { step_length_mm: 1.0e-6, ..NewtonSettings::default() };
    let problem = Arc::new(Problem::new(finger(), ProblemConfig { newton, ..config() }).unwrap());
    let mut solver = Solver::new(problem).unwrap();
    let load = Load { pressure_mpa: 0.02, ..Load::default() };
    let solved = solver.solve_to(&solver.undeformed(), &load).map(|(_, report)| report);
    let Err(SolveError::NotConverged(stop)) = solved else { panic!("expected too many steps: {solved:?}") };
    assert!(
        matches!(stop.reason, NewtonError::StepTooShort { fraction } if fraction < 1.0 / 256.0),
        "{stop}"
    );
    assert_eq!((stop.report.cuts, stop.report.steps), (0, 0), "the first step says it already");
}

/// An iteration that ends far from its start has found another branch, such as a finger folded over.
#[test]
fn jump_to_another_branch_is_refused() {
    let newton = NewtonSettings { step_length_mm: 0.05, ..NewtonSettings::default() };
    let problem = Arc::new(Problem::new(finger(), ProblemConfig { newton, ..config() }).unwrap());
    let mut solver = Solver::new(problem).unwrap();
    // The equilibrium without loads is the undeformed body; the start is bent away from it by 1 mm.
    let mut bent = solver.undeformed();
    let nodes = solver.problem().mesh().nodes_mm.clone();
    bent.displacement_mm.iter_mut().zip(nodes).for_each(|(u, x)| u[1] -= (x[0] / 24.0).powi(2));
    let solved = solver.solve_to(&bent, &Load::default()).map(|(_, report)| report);
    let Err(SolveError::NotConverged(stop)) = solved else { panic!("expected a jump: {solved:?}") };
    assert!(
        matches!(stop.reason, NewtonError::Jumped { moved_mm, .. } if (moved_mm - 1.0).abs() < 0.2),
        "{stop}"
    );
}

/// Only the underside has contact: a body of which another part has passed the obstacle is refused.
#[test]
fn body_behind_its_obstacle_is_refused() {
    let mut mesh = finger();
    let half = |face: &[u32; 6], nodes: &[Vec3]| face.iter().all(|n| nodes[*n as usize][0] < 12.1);
    let (faces, nodes) = (mesh.bottom.clone(), mesh.nodes_mm.clone());
    mesh.bottom = faces.into_iter().filter(|face| half(face, &nodes)).collect();
    let mut solver = Solver::new(Arc::new(Problem::new(mesh, config()).unwrap())).unwrap();
    let gravity_mm_s2 = GRAVITY_DOWN_MM_S2.map(|g| 120.0 * g);
    let (rest, _) = solver.gravity_equilibrium(gravity_mm_s2).unwrap();
    let lowest = solver.output(&rest).coordinates_mm.iter().map(|x| -x[1]).fold(0.0, f64::max);
    assert!(lowest > 1.5, "the tip must hang far below: {lowest}");
    let load = Load { obstacle: Obstacle::Plate { gap_mm: lowest - 1.2 }, gravity_mm_s2, ..Load::default() };
    let solved = solver.solve_to(&rest, &load).map(|(_, report)| report);
    assert!(matches!(solved, Err(SolveError::Behind { depth_mm }) if depth_mm > 1.0), "{solved:?}");
}

/// The walls' normal is held while force and tangent are formed; along a motion that does not turn the walls the
/// tangent must then be exact. Contact alone: the same body without it is subtracted.
#[test]
fn wall_contact_tangent_is_exact_without_wall_rotation() {
    let with_penalty = |slot_penalty_mpa_per_mm| {
        // Rounded so widely that the walls touch before the body between them is crushed.
        let contact =
            ContactSettings { slot_penalty_mpa_per_mm, slot_smoothing_mm: 1.5, ..Default::default() };
        Problem::new(towers(), ProblemConfig { contact, ..config() }).unwrap()
    };
    let problems = [with_penalty(50.0), with_penalty(0.0)];
    let nodes = &problems[0].mesh().nodes_mm;
    let right = |x: &Vec3| x[0] > 2.9 && x[1] > 0.9;
    let load = Load::default();
    let shifted = |by: f64| {
        let u = nodes.iter().map(|x| if right(x) { [-by, 0.0, 0.0] } else { [0.0; 3] });
        follow(&problems[0], u.collect(), load)
    };
    let contact = |of: &dyn Fn(&Problem) -> Vec<f64>| -> Vec<f64> {
        of(&problems[0]).iter().zip(of(&problems[1])).map(|(a, b)| a - b).collect()
    };
    let mut v = vec![0.0; problems[0].pattern.unknowns()];
    for k in nodes.iter().enumerate().filter(|(_, x)| right(x)).filter_map(|(n, _)| unknown(&problems[0], n))
    {
        v[k] = -1.0;
    }
    for by in [0.1, 0.4] {
        let stated = contact(&|problem| {
            let mut system = System::new(problem);
            system.assemble(problem, &shifted(by), &load, Ahead::default(), true).unwrap();
            problem.pattern.multiply(&system.tangent, &v)
        });
        let force = |by: f64| contact(&|p| residual(p, &shifted(by), &load).into_flattened());
        let (up, down) = (force(by + 1.0e-4), force(by - 1.0e-4));
        let largest = stated.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        assert!(largest > 0.1, "the walls must touch for the test to mean anything");
        for (n, k) in (0..nodes.len()).filter_map(|n| Some((n, unknown(&problems[0], n)?))) {
            for i in 0..3 {
                let measured = -(up[3 * n + i] - down[3 * n + i]) / 2.0e-4;
                assert!((stated[k + i] - measured).abs() < 1.0e-6 * largest, "node {n}, shift {by}");
            }
        }
    }
}

/// The same element with corners 0 and 1 exchanged: inside out.
fn mirrored(t: [u32; 10]) -> [u32; 10] {
    [t[1], t[0], t[2], t[3], t[4], t[6], t[5], t[8], t[7], t[9]]
}

#[test]
fn invalid_problems_are_refused_with_the_place() {
    let refuse = |change: &dyn Fn(&mut Mesh, &mut ProblemConfig)| {
        let (mut mesh, mut config) = (finger(), config());
        change(&mut mesh, &mut config);
        Problem::new(mesh, config).unwrap_err()
    };
    let inverted = refuse(&|m, _| m.tets[5] = mirrored(m.tets[5]));
    assert!(matches!(inverted, ProblemError::Inverted { element: 5, .. }), "{inverted}");
    let open = refuse(&|m, _| m.cavity.truncate(m.cavity.len() - 1));
    assert!(matches!(open, ProblemError::OpenCavity(..)), "{open}");
    let loose = refuse(&|m, _| m.nodes_mm.push([99.0; 3]));
    assert!(matches!(loose, ProblemError::Unconnected { .. }), "{loose}");
    let far = refuse(&|m, _| m.bottom[0][3] = 1_000_000);
    assert!(matches!(far, ProblemError::OutOfRange { found: 1_000_000, .. }), "{far}");
    let free = refuse(&|m, _| m.fixed_nodes.clear());
    assert!(matches!(free, ProblemError::Missing(_)), "{free}");
    let bare = refuse(&|_, c| c.sheet = None);
    assert!(matches!(bare, ProblemError::Missing(_)), "{bare}");
    let soft = refuse(&|_, c| c.elastomers[0].bulk_mpa = 1.0);
    assert!(matches!(soft, ProblemError::Material(_)), "{soft}");
    let inner = refuse(&|m, _| m.cavity[0] = m.sheet[0].map(|n| n ^ 1));
    assert!(matches!(inner, ProblemError::NotOnBoundary { surface: "cavity", triangle: 0 }), "{inner}");
    let bent = refuse(&|m, _| {
        let n = m.sheet[0][0] as usize;
        axpy(1.0, [0.0, 0.01, 0.0], &mut m.nodes_mm[n]);
    });
    assert!(matches!(bent, ProblemError::Sheet(_)), "{bent}");
}

#[test]
fn nested_dissection_orders_every_node_once() {
    let mesh = finger();
    let problem = Problem::new(mesh, config()).unwrap();
    let graph = problem.pattern.graph();
    let points = vec![[0.0; 3]; graph.len()];
    for points in [points, (0..graph.len()).map(|n| std::array::from_fn(|i| noise(3 * n + i))).collect()] {
        let mut order = nested_dissection(&graph, &points);
        order.sort_unstable();
        assert!(order.iter().enumerate().all(|(k, n)| k == *n as usize) && order.len() == graph.len());
    }
}
