//! Variants of an actuator: names, moved meshes, derivatives with respect to every input against two solved neighbours.

use crate::actuators;
use fem::actuator::{Actuator, Setting, mesh_quality, moved_nodes};
use fem::{Change, Family, Load, Output, Problem, Solver, State, Variant};
use std::sync::Arc;

fn settings(list: &[(&str, f64)]) -> Vec<Setting> {
    list.iter().map(|(name, value)| ((*name).into(), *value)).collect()
}

/// Two chambers on a coarse grid; tolerances so tight that differences of two states mean something.
fn family() -> Family {
    family_with("12.0")
}

fn family_with(channel_mm: &str) -> Family {
    tight(&actuators::with(&actuators::tiny(), "channels", "width_mm", channel_mm))
}

fn tight(text: &str) -> Family {
    let mut text = text.to_owned();
    let tight = [("correction_tolerance_mm", "1e-11"), ("force_tolerance_n", "1e-11")];
    for (key, value) in tight.into_iter().chain([("max_iterations", "30"), ("smallest_step", "0.01")]) {
        text = actuators::with(&text, "newton", key, value);
    }
    let actuator = Actuator::parse(&text).unwrap();
    let problem = Problem::new(actuator.grid_mesh(9.0, 1).unwrap(), actuator.problem_config()).unwrap();
    Family { actuator, problem: Arc::new(problem) }
}

fn solve(family: &Family, variant: &Variant, load: &Load) -> (Solver, State, Output) {
    let mut solver = Solver::new(family.problem_of(variant).unwrap()).unwrap();
    let (rest, _) = solver.gravity_equilibrium(load.gravity_mm_s2).unwrap();
    let (state, _) = solver.solve_to(&rest, load).unwrap();
    let output = solver.output(&state);
    (solver, state, output)
}

/// The bodies on the way from one variant to another.
struct Path<'a> {
    family: &'a Family,
    from: &'a Variant,
    to: &'a Variant,
}

impl fem::Bodies for Path<'_> {
    fn at(&self, fraction: f64) -> Result<Arc<Problem>, fem::VariantError> {
        self.family.problem_of(&self.family.between(self.from, self.to, fraction))
    }
}

/// Largest difference of two lists relative to the largest of the second.
fn off(a: impl Iterator<Item = f64>, b: impl Iterator<Item = f64>) -> f64 {
    let (worst, largest) =
        a.zip(b).fold((0.0_f64, 0.0_f64), |(w, l), (a, b)| (w.max((a - b).abs()), l.max(b.abs())));
    worst / largest.max(1.0e-12)
}

#[test]
fn derivatives_equal_differences_of_solved_neighbours() {
    // Channels narrower than the chambers, so that either width can change alone.
    let family = family_with("8.0");
    let names = [
        "elastomer.law.mu_mpa",
        "chambers.length_mm",
        "chambers.width_mm",
        "base.lower_mm",
        "sheet.thickness_mm",
    ];
    assert_derivatives(&family, &names, &[(0.05, None), (0.12, Some(0.4)), (0.2, Some(1.0))]);
}

#[test]
fn derivatives_with_round_obstacles_equal_differences_of_solved_neighbours() {
    for kind in ["cylinder", "sphere"] {
        let body = format!("\"{kind}\"\nradius_mm = 15.0\ncentre_mm = [27.0, 8.0]");
        let family = tight(&actuators::with(&actuators::tiny(), "obstacle", "kind", &body));
        let names = ["elastomer.law.mu_mpa", "obstacle.radius_mm", "obstacle.centre_mm.0"];
        assert_derivatives(&family, &names, &[(0.12, Some(0.2))]);
        let wrong = family.actuator.with(&settings(&[("obstacle.radius_mm", 0.0)]));
        assert!(wrong.unwrap_err()[0].to_string().contains("obstacle.radius_mm"));
    }
}

fn assert_derivatives(family: &Family, names: &[&str], states: &[(f64, Option<f64>)]) {
    for (pressure_mpa, gap_mm) in states.iter().copied() {
        let variant =
            family.variant(&settings(&[("elastomer.law.mu_mpa", 0.75), ("base.lower_mm", 2.1)])).unwrap();
        let load = family.actuator.load(pressure_mpa, gap_mm);
        let (mut solver, state, output) = solve(family, &variant, &load);
        assert_eq!(gap_mm.is_some(), output.contact_force_n > 0.0, "{pressure_mpa} MPa, gap {gap_mm:?}");
        println!(
            "{pressure_mpa} MPa, gap {gap_mm:?}: {} N, {} slot nodes",
            output.contact_force_n,
            output.slot_contact_nodes.len()
        );
        // Neighbours of inputs: name, step of the residual's difference, step of the solved neighbours, how to get there.
        type Go<'a> = Box<dyn Fn(f64) -> (Variant, Load) + 'a>;
        let mut inputs: Vec<(&str, f64, f64, Go<'_>)> = vec![(
            "pressure_mpa",
            1.0e-5,
            1.0e-6,
            Box::new(|d| (variant.clone(), Load { pressure_mpa: pressure_mpa + d, ..load })),
        )];
        if gap_mm.is_some() {
            inputs.push((
                "gap_mm",
                1.0e-6,
                1.0e-6,
                Box::new(|d| {
                    (variant.clone(), family.actuator.load(pressure_mpa, gap_mm.map(|gap_mm| gap_mm + d)))
                }),
            ));
        }
        for name in names.iter().copied() {
            let variant = &variant;
            // What the obstacle's form changes is small: its neighbours lie further apart, above the solver's tolerance.
            let apart = if name.starts_with("obstacle.") { 1.0e-4 } else { 1.0e-6 };
            inputs.push((name, 1.0e-6, apart, Box::new(move |d| (family.stepped(variant, name, d), load))));
        }
        let changes: Vec<Change> = inputs
            .iter()
            .map(|(name, step, _, go)| {
                let side = |d: f64| {
                    let (v, load) = go(d);
                    let loads = ["pressure_mpa", "gap_mm"].contains(name);
                    (if loads { Arc::clone(solver.problem()) } else { family.problem_of(&v).unwrap() }, load)
                };
                Change { step: *step, below: side(-step), above: side(*step) }
            })
            .collect();
        let stated = solver.sensitivities(&state, &changes).unwrap().unwrap();
        let mut neighbours = Solver::new(family.problem_of(&variant).unwrap()).unwrap();
        for ((name, _, step, go), stated) in inputs.iter().zip(&stated) {
            let mut side = |d: f64| {
                let (to, load) = go(d);
                let path = Path { family, from: &variant, to: &to };
                let (state, _) = neighbours.solve_along(&state, &load, &path).unwrap();
                neighbours.output(&state)
            };
            let (above, below) = (side(*step), side(-step));
            let rate = |a: f64, b: f64| (a - b) / (2.0 * step);
            let x = |o: &Output| o.coordinates_mm.clone().into_flattened();
            let found_x: Vec<f64> = x(&above).iter().zip(x(&below)).map(|(a, b)| rate(*a, b)).collect();
            let found_s: Vec<f64> =
                above.von_mises_mpa.iter().zip(&below.von_mises_mpa).map(|(a, b)| rate(*a, *b)).collect();
            let found_f = rate(above.contact_force_n, below.contact_force_n);
            let errors = [
                off(stated.coordinates_mm.as_flattened().iter().copied(), found_x.into_iter()),
                off(stated.von_mises_mpa.iter().copied(), found_s.into_iter()),
                (stated.contact_force_n - found_f).abs() / found_f.abs().max(1.0e-9),
            ];
            println!("  {name}: {errors:?}, force {found_f:.6} N per unit");
            assert!(errors[0] < 1.0e-4 && errors[1] < 1.0e-4, "{name}: {errors:?}");
            assert!(errors[2] < 1.0e-4 || found_f.abs() < 1.0e-9, "{name}: {errors:?}");
        }
    }
}

#[test]
fn moved_mesh_keeps_faces_on_their_planes_and_volume() {
    let family = family();
    let mesh = family.problem.mesh();
    assert_eq!(moved_nodes(mesh, &family.actuator, &family.actuator).unwrap(), mesh.nodes_mm);
    let list = settings(&[
        ("chambers.length_mm", 3.4),
        ("base.lower_mm", 1.6),
        ("chambers.width_mm", 11.5),
        ("channels.width_mm", 11.5),
    ]);
    let changed = family.actuator.with(&list).unwrap();
    let nodes = moved_nodes(mesh, &family.actuator, &changed).unwrap();
    let volume = |nodes: &[[f64; 3]]| mesh.tets.iter().map(|t| six_volumes(nodes, t)).sum::<f64>() / 6.0;
    // The solid's volume, from the boxes: base, body above the pocket, less chambers, channels and the slot.
    let expected = |a: &Actuator| {
        let a = a.shape().unwrap();
        let (base, body, c, s, ch) = (a.base, a.body, a.chambers, a.slots.unwrap(), a.channels.unwrap());
        let floor = a.cavity_floor_mm();
        let solid = base.length_mm * base.width_mm * a.base_top_mm()
            + body.length_mm * body.width_mm * (body.top_mm - a.base_top_mm());
        let chambers = 2.0 * c.length_mm * c.width_mm * (c.top_mm - floor);
        let channel = (c.pitch_mm - c.length_mm) * ch.width_mm * (ch.top_mm - floor);
        solid - chambers - channel - s.width_mm * body.width_mm * (body.top_mm - s.floor_mm)
    };
    assert!((volume(&mesh.nodes_mm) - expected(&family.actuator)).abs() < 1.0e-6);
    assert!(
        (volume(&nodes) - expected(&changed)).abs() < 1.0e-6,
        "{} {}",
        volume(&nodes),
        expected(&changed)
    );
    assert!(mesh.sheet.iter().flatten().all(|n| (nodes[*n as usize][1] - 1.6).abs() < 1.0e-12));
    let (least, mean) = mesh_quality(mesh, &nodes);
    assert!(least > 0.0 && mean > least && mean < 1.0);
    let back = family.problem.varied(nodes, changed.problem_config()).unwrap();
    assert_eq!(back.mesh().tets, mesh.tets);
}

fn six_volumes(nodes: &[[f64; 3]], t: &[u32; 10]) -> f64 {
    let [a, b, c, d] = [0, 1, 2, 3].map(|k| nodes[t[k] as usize]);
    let from_a = |p: [f64; 3]| [p[0] - a[0], p[1] - a[1], p[2] - a[2]];
    let (u, v, w) = (from_a(b), from_a(c), from_a(d));
    w[0] * (u[1] * v[2] - u[2] * v[1])
        + w[1] * (u[2] * v[0] - u[0] * v[2])
        + w[2] * (u[0] * v[1] - u[1] * v[0])
}

#[test]
fn invalid_shapes_and_names_are_refused_with_the_expected() {
    let family = family();
    let refused = |list: &[(&str, f64)], parts: &[&str]| {
        let result = family.variant(&settings(list)).and_then(|v| family.problem_of(&v).map(|_| ()));
        let text = result.unwrap_err().to_string();
        assert!(parts.iter().all(|part| text.contains(part)), "{list:?}: {text}");
    };
    refused(&[("elastomer.law.mu", 0.7)], &["elastomer.law.mu_mpa"]);
    refused(&[("chambers.count", 3.0)], &["chambers.count", "another mesh"]);
    refused(&[("mesh.size_mm", 3.0)], &["mesh.size_mm"]);
    refused(&[("elastomer.law.mu_mpa", -1.0)], &["mu_mpa"]);
    refused(&[("chambers.width_mm", 30.0)], &["chambers.width_mm"]);
    refused(&[("base.lower_mm", 2.1), ("base.lower_mm", 2.2)], &["every parameter once"]);
    // Chambers and channels fraction their side faces on this actuator: one alone would tear the mesh.
    refused(&[("chambers.width_mm", 12.5)], &["stay in one plane"]);
    let flat = family.actuator.with(&settings(&[("slots.floor_mm", 18.0)])).unwrap();
    assert!(
        moved_nodes(family.problem.mesh(), &family.actuator, &flat).is_err(),
        "the slot's floor passes the chambers' top"
    );
    let known = family.actuator.quantities();
    assert!(known.iter().any(|(name, _)| name == "loads.gravity_mm_s2.1") && known.len() > 30, "{known:?}");
    assert_eq!(fem::actuator::unit("loads.gravity_mm_s2.1"), "mm/s2");
    assert_eq!(fem::actuator::unit("elastomer.law.jm"), "");
}

#[test]
fn path_through_variants_ends_at_the_direct_solution() {
    let family = family();
    let far = family.variant(&settings(&[("elastomer.law.mu_mpa", 1.0), ("base.lower_mm", 1.7)])).unwrap();
    let load = family.actuator.load(0.1, Some(0.5));
    let (mut solver, nominal, _) = solve(&family, &Variant::default(), &load);
    let (_, direct, _) = solve(&family, &far, &load);
    let path = Path { family: &family, from: &Variant::default(), to: &far };
    let (along, report) = solver.solve_along(&nominal, &load, &path).unwrap();
    let apart = along
        .displacement_mm
        .iter()
        .zip(&direct.displacement_mm)
        .map(|(a, b)| a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt());
    let apart = apart.fold(0.0, f64::max);
    println!("{} factorisations, {apart:.1e} mm apart", report.factorisations);
    assert!(apart < 1.0e-9);
}
