//! Actuators of boxes with chambers of own sizes, opposite rows, a bellows outline, any held face, and parts left out by 0.

use crate::actuators::{chambers, more, two_sided, with};
use fem::actuator::Actuator;
use fem::{Family, Load, Mesh, Problem, Solver};
use formats::mesh_file::Tri6;
use std::collections::HashMap;
use std::sync::Arc;

fn refused(text: &str, part: &str) {
    let list = Actuator::parse(text).unwrap_err();
    assert!(list.iter().any(|d| d.to_string().contains(part)), "{part}: {list:?}");
}

/// Volume behind plane faces whose normals point out of it.
fn enclosed_mm3(mesh: &Mesh, faces: &[Tri6]) -> f64 {
    let volume = |t: &Tri6| {
        let [a, b, c] = [t[0], t[1], t[2]].map(|n| mesh.nodes_mm[n as usize]);
        let cross = |k: usize| {
            let (i, j) = ((k + 1) % 3, (k + 2) % 3);
            (b[i] - a[i]) * (c[j] - a[j]) - (b[j] - a[j]) * (c[i] - a[i])
        };
        (0..3).map(|k| a[k] * cross(k)).sum::<f64>() / 6.0
    };
    faces.iter().map(volume).sum::<f64>().abs()
}

fn solid_mm3(mesh: &Mesh) -> f64 {
    let volume = |t: &[u32; 10]| {
        let [a, b, c, d] = [0, 1, 2, 3].map(|k| mesh.nodes_mm[t[k] as usize]);
        let [u, v, w] = [b, c, d].map(|p| [0, 1, 2].map(|k| p[k] - a[k]));
        let cross = [v[1] * w[2] - v[2] * w[1], v[2] * w[0] - v[0] * w[2], v[0] * w[1] - v[1] * w[0]];
        (0..3).map(|k| u[k] * cross[k]).sum::<f64>() / 6.0
    };
    mesh.tets.iter().map(volume).sum()
}

fn close(found: f64, expected: f64) {
    assert!((found / expected - 1.0).abs() < 1.0e-12, "{found} against {expected}");
}

/// The reference: floor of the cavities at 3.2, channels 2 wide and 2.8 high, base 4 high, walls between cavities 6.
#[test]
fn chambers_of_own_sizes_have_their_volumes_and_move_with_them() {
    let text = more(&chambers(3), "chambers", "lengths_mm = [3.0, 2.0, 4.0]\ntops_mm = [17.0, 12.0, 16.0]");
    let cavity = |lengths: [f64; 3]| {
        let tops = [17.0, 12.0, 16.0];
        let boxes: f64 = lengths.iter().zip(tops).map(|(length, top)| length * 14.0 * (top - 3.2)).sum();
        boxes + 2.0 * 6.0 * 2.0 * (6.0 - 3.2)
    };
    let actuator = Actuator::parse(&text).unwrap();
    let mesh = actuator.grid_mesh(9.0, 1).unwrap();
    close(enclosed_mm3(&mesh, &mesh.cavity), cavity([3.0, 2.0, 4.0]));
    // As three parts of the whole body, minus cavities, slots and the pocket that base and body share.
    let whole = 43.0 * 32.0 * 4.0 + 31.0 * 20.0 * 15.0 - 2.0 * 20.0 * 12.0 - cavity([3.0, 2.0, 4.0]);
    close(solid_mm3(&mesh), whole);
    let problem = Arc::new(Problem::new(mesh, actuator.problem_config()).unwrap());
    let family = Family { actuator, problem };
    let variant = family.variant(&[("chambers.lengths_mm.1".into(), 2.5)]).unwrap();
    let problem = family.problem_of(&variant).unwrap();
    close(enclosed_mm3(problem.mesh(), &problem.mesh().cavity), cavity([3.0, 2.5, 4.0]));
    refused(&more(&chambers(3), "chambers", "lengths_mm = [3.0, 2.0]"), "one for each of the 3 chambers");
    refused(&more(&chambers(3), "chambers", "tops_mm = [17.0, 19.0, 16.0]"), "closed above");
}

#[test]
fn side_cuts_make_the_outline_of_a_bellows() {
    let plain = Actuator::parse(&chambers(3)).unwrap().grid_mesh(9.0, 1).unwrap();
    let bellows = Actuator::parse(&more(&chambers(3), "slots", "side_mm = 6.0")).unwrap();
    let mesh = bellows.grid_mesh(9.0, 1).unwrap();
    close(enclosed_mm3(&mesh, &mesh.cavity), enclosed_mm3(&plain, &plain.cavity));
    // From the base at 4 to the slots' floor at 7, 1 long, on both sides of two slots.
    close(solid_mm3(&plain) - solid_mm3(&mesh), 4.0 * 1.0 * 3.0 * 6.0);
    assert!(mesh.slots.iter().zip(&plain.slots).all(|(cut, plain)| cut.lower.len() > plain.lower.len()));
    refused(&more(&chambers(3), "slots", "side_mm = 9.0"), "slots.side_mm");
}

#[test]
fn every_face_of_the_boxes_can_be_held_and_0_leaves_a_part_out() {
    let (length, top) = (34.0, 19.0);
    type On = fn([f64; 3], f64, f64) -> bool;
    let faces: [(&str, On); 7] = [
        ("body-start", |p, _, _| p[0] == 6.0),
        ("base-start", |p, _, _| p[0] == 0.0),
        ("body-end", |p, length, _| p[0] == length - 6.0),
        ("base-end", |p, length, _| p[0] == length),
        ("body-top", |p, _, top| p[1] == top),
        ("base-front", |p, _, _| p[2] == 0.0),
        ("base-back", |p, _, _| p[2] == 32.0),
    ];
    for (name, on) in faces {
        let text = with(&chambers(2), "support", "fixed", &format!("\"{name}\""));
        let mesh = Actuator::parse(&text).unwrap().grid_mesh(9.0, 1).unwrap();
        assert!(!mesh.fixed_nodes.is_empty(), "{name}");
        let off = mesh.fixed_nodes.iter().find(|n| !on(mesh.nodes_mm[**n as usize], length, top));
        assert!(off.is_none(), "{name}: {off:?}");
    }
    refused(&with(&chambers(2), "support", "fixed", "\"tip\""), "base-back");
    let mut text = chambers(2);
    for (section, key) in [("slots", "width_mm"), ("channels", "width_mm"), ("sheet", "thickness_mm")] {
        text = with(&text, section, key, "0.0");
    }
    let actuator = Actuator::parse(&text).unwrap();
    assert!(actuator.slots.is_none() && actuator.channels.is_none() && actuator.sheet.is_none());
    let mesh = actuator.grid_mesh(9.0, 1).unwrap();
    assert!(mesh.slots.is_empty() && mesh.sheet.is_empty());
    close(enclosed_mm3(&mesh, &mesh.cavity), 2.0 * 3.0 * 14.0 * 13.8);
}

/// A two-sided finger, and what its displacement `a` lacks to be the mirror image of `b` at the middle of the base.
struct TwoSided {
    actuator: Actuator,
    mesh: Mesh,
    mirror: Vec<usize>,
}

impl TwoSided {
    fn new() -> Self {
        let text = with(&two_sided(), "newton", "correction_tolerance_mm", "1.0e-10");
        let actuator = Actuator::parse(&text).unwrap();
        let mesh = actuator.grid_mesh(9.0, 1).unwrap();
        let key = |p: [f64; 3]| p.map(|v| (1e6 * v).round() as i64);
        let nodes: HashMap<_, usize> = mesh.nodes_mm.iter().enumerate().map(|(n, p)| (key(*p), n)).collect();
        // Both bodies reach 15 from the base, which is 4 high.
        let mirror = mesh.nodes_mm.iter().map(|p| nodes[&key([p[0], 34.0 - p[1], p[2]])]).collect();
        Self { actuator, mesh, mirror }
    }

    fn moved(&self, mpa: [f64; 2], gravity_mm_s2: [f64; 3]) -> Vec<[f64; 3]> {
        let mut actuator = self.actuator.clone();
        actuator.pressure_mpa.insert("lower".into(), mpa[1]);
        let problem = Arc::new(Problem::new(self.mesh.clone(), actuator.problem_config()).unwrap());
        let mut solver = Solver::new(problem).unwrap();
        let (rest, _) = solver.gravity_equilibrium(gravity_mm_s2).unwrap();
        let load = Load { pressure_mpa: mpa[0], gravity_mm_s2, ..Load::default() };
        solver.solve_to(&rest, &load).unwrap().0.displacement_mm
    }

    fn off(&self, a: &[[f64; 3]], b: &[[f64; 3]]) -> f64 {
        let of = |(u, n): (&[f64; 3], &usize)| {
            let other = b[*n];
            [u[0] - other[0], u[1] + other[1], u[2] - other[2]]
        };
        largest(&a.iter().zip(&self.mirror).map(of).collect::<Vec<_>>())
    }
}

fn largest(u: &[[f64; 3]]) -> f64 {
    u.iter().flatten().fold(0.0, |m, v| v.abs().max(m))
}

#[test]
fn opposite_rows_that_are_alike_bend_either_way_alike() {
    let finger = TwoSided::new();
    let mesh = &finger.mesh;
    close(enclosed_mm3(mesh, &mesh.cavities[0]), enclosed_mm3(mesh, &mesh.cavity));
    assert_eq!(mesh.slots.len(), 2);
    let small = 1.0e-3;
    let [up, down, both] = [[small, 0.0], [0.0, small], [small; 2]].map(|mpa| finger.moved(mpa, [0.0; 3]));
    println!("{:.3e} mm: {:.1e}, {:.1e}", largest(&up), finger.off(&up, &down), finger.off(&both, &both));
    assert!(largest(&up) > 1.0e-3 && finger.off(&up, &down) < 1.0e-9 && finger.off(&both, &both) < 1.0e-9);
    refused(&two_sided().replace("\nlower = 0.0", "\nother = 0.0"), "[pressure_mpa] lower");
}

#[test]
fn level_and_inverted_sag_alike_and_hanging_only_lengthens() {
    let finger = TwoSided::new();
    let [level, inverted, hanging] =
        [[0.0, -9810.0, 0.0], [0.0, 9810.0, 0.0], [9810.0, 0.0, 0.0]].map(|g| finger.moved([0.0; 2], g));
    let tip = finger.mesh.nodes_mm.iter().position(|p| p[0] > 33.999 && (p[1] - 17.0).abs() < 1e-6).unwrap();
    assert!(level[tip][1] < 0.0 && finger.off(&level, &inverted) < 1.0e-9, "{:?}", level[tip]);
    assert!(hanging[tip][0] > 0.0 && finger.off(&hanging, &hanging) < 1.0e-9, "{:?}", hanging[tip]);
    assert!(hanging[tip][0] < 0.2 * level[tip][1].abs(), "{:?} {:?}", hanging[tip], level[tip]);
}
