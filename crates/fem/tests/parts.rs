//! Actuators of several parts: an own mesh with named volumes and surfaces, several cavities, films with fibres.

use crate::actuators::{model, reference};
use crate::builder::Builder;
use crate::closed_forms::neo_hookean;
use fem::actuator::Actuator;
use fem::material::{Fibres, Film, VolumeChange};
use fem::{CavityLoad, Family, Load, Mesh, Problem, ProblemConfig, SolveError, Solver};
use formats::mesh_file::TET_EDGES;
use std::fmt::Write as _;
use std::sync::Arc;

/// A bar of 12 x 4 x 8 mm with a closed chamber at either side; x = 0 is held.
fn two_chambers() -> Builder {
    let mut b = Builder::default();
    let hole = |c: [usize; 3]| (1..5).contains(&c[0]) && c[1] == 1 && (c[2] == 1 || c[2] == 6);
    b.cells([0.0; 3], [12.0, 3.0, 8.0], [6, 3, 8], |c| !hole(c));
    b
}

fn wall(b: &mut Builder, z: [f64; 2]) -> Vec<[u32; 6]> {
    let near = 1.0e-9;
    let within = move |v: f64, low: f64, high: f64| v > low - near && v < high + near;
    b.faces(|p| within(p[0], 2.0, 10.0) && within(p[1], 1.0, 2.0) && within(p[2], z[0], z[1]))
}

/// A bar with two chambers, the second one at a pressure of the configuration.
pub fn bar_of_two(second_mpa: f64) -> Arc<Problem> {
    let mut b = two_chambers();
    b.mesh.cavity = wall(&mut b, [1.0, 2.0]);
    b.mesh.cavities = vec![wall(&mut b, [6.0, 7.0])];
    b.mesh.fixed_nodes = b.nodes_where(|p| p[0] < 1.0e-9);
    let elastomers = neo_hookean(0.1, 200.0, 1.0e-9, VolumeChange::Mean);
    let cavities_mpa = vec![second_mpa];
    let config = ProblemConfig { elastomers, cavities_mpa, sheet: None, ..ProblemConfig::default() };
    Arc::new(Problem::new(b.mesh, config).unwrap())
}

/// Displacements for small pressures of both chambers.
fn bent(mpa: [f64; 2]) -> Vec<[f64; 3]> {
    let mut solver = Solver::new(bar_of_two(mpa[1])).unwrap();
    let start = solver.undeformed();
    let (state, _) = solver.solve_to(&start, &Load { pressure_mpa: mpa[0], ..Load::default() }).unwrap();
    state.displacement_mm
}

#[test]
fn two_chambers_superpose_at_small_pressures_and_bend_apart() {
    let small = 2.0e-5;
    let [left, right, both] = [[small, 0.0], [0.0, 2.0 * small], [small, 2.0 * small]].map(bent);
    let largest = both.iter().flatten().fold(0.0_f64, |m, v| m.max(v.abs()));
    let sum = left.iter().zip(&right).map(|(a, b)| [0, 1, 2].map(|k| a[k] + b[k]));
    let off = sum.zip(&both).flat_map(|(s, b)| [0, 1, 2].map(|k| (s[k] - b[k]).abs())).fold(0.0, f64::max);
    println!("superposition: off by {:.2e} of the largest displacement", off / largest);
    assert!(off < 2.0e-3 * largest, "{off} of {largest}");
    // The right chamber at twice the pressure bends twice as far the other way.
    let tip =
        |u: &[[f64; 3]]| u.iter().map(|u| u[2]).fold(0.0, |m: f64, v| if v.abs() > m.abs() { v } else { m });
    let ratio = tip(&right) / tip(&left);
    assert!((ratio + 2.0).abs() < 0.02, "{ratio}");
}

#[test]
fn a_path_begins_without_any_pressure_and_ends_with_all_of_them() {
    // Far more than the bar bears: a rest state that had this pressure would not exist.
    let mut solver = Solver::new(bar_of_two(5.0)).unwrap();
    let (rest, _) = solver.gravity_equilibrium([0.0; 3]).unwrap();
    assert!(rest.displacement_mm.iter().flatten().all(|u| u.abs() < 1.0e-12));
    // Towards a load without change the second pressure rises to that of the configuration, as the first one does.
    let error = solver.solve_to(&rest, &Load { pressure_mpa: 5.0, ..Load::default() }).unwrap_err();
    let SolveError::NotConverged(stopped) = error else { panic!("{error}") };
    assert_eq!(stopped.cavities_mpa, [5.0]);
    let second_mpa = 5.0 + stopped.last.cavities_change_mpa[0];
    assert!((second_mpa - stopped.last.pressure_mpa).abs() < 1.0e-9 && second_mpa < 1.0, "{stopped}");
    // Either chamber alone reaches the mirrored state, at a pressure that strains it.
    let [first, second] = [[0.02, 0.0], [0.0, 0.02]].map(|mpa| {
        let mut solver = Solver::new(bar_of_two(mpa[1])).unwrap();
        let (rest, _) = solver.gravity_equilibrium([0.0; 3]).unwrap();
        let load = Load { pressure_mpa: mpa[0], ..Load::default() };
        let (state, _) = solver.solve_to(&rest, &load).unwrap();
        state
            .displacement_mm
            .iter()
            .map(|u| u[2])
            .fold(0.0, |m: f64, v| if v.abs() > m.abs() { v } else { m })
    });
    assert!(first.abs() > 0.05 && (first + second).abs() < 0.02 * first.abs(), "{first} {second}");
}

/// A tube of radius 6 and wall 2 with closed, stiff ends, wound at `angle_deg`; its length and radius between two sections, relative to the
/// undeformed ones, at a pressure.
fn wound(angle_deg: f64, pressure_mpa: f64) -> [f64; 2] {
    let (n, length) = (6, 30.0);
    let mut b = Builder::default();
    let hollow =
        |c: [usize; 3]| (1..14).contains(&c[0]) && [c[1], c[2]].iter().all(|i| (1..n - 1).contains(i));
    b.cells([0.0, -6.0, -6.0], [length, 6.0, 6.0], [15, n, n], |c| !hollow(c));
    let inner =
        b.faces(|p| p[0] > 1.0 && p[0] < length - 1.0 && p[1].abs() < 4.0 + 1e-9 && p[2].abs() < 4.0 + 1e-9);
    let mantle = b.faces(|p| p[1].abs().max(p[2].abs()) > 6.0 - 1e-9);
    let flat = |t: &[u32; 6], nodes: &[[f64; 3]]| [t[0], t[1], t[2]].map(|n| nodes[n as usize][0]);
    // Faces of the ends have all corners at one x.
    let nodes = b.mesh.nodes_mm.clone();
    let mantle = mantle.into_iter().filter(|t| {
        let x = flat(t, &nodes);
        x.iter().any(|v| (v - x[0]).abs() > 1e-9)
    });
    b.mesh.films = vec![mantle.collect()];
    b.mesh.cavity = inner;
    b.mesh.fixed_nodes = b.nodes_where(|p| p[0] < 1.0e-9);
    // Squares become circles of the same reach; mid-sides stay in the middle of straight edges.
    for p in &mut b.mesh.nodes_mm {
        let reach = p[1].abs().max(p[2].abs());
        let norm = p[1].hypot(p[2]);
        if norm > 0.0 {
            (p[1], p[2]) = (p[1] * reach / norm, p[2] * reach / norm);
        }
    }
    for tet in &b.mesh.tets {
        for (m, [i, j]) in TET_EDGES.into_iter().enumerate() {
            let [p, q] = [i, j].map(|k| b.mesh.nodes_mm[tet[k] as usize]);
            b.mesh.nodes_mm[tet[4 + m] as usize] = [0, 1, 2].map(|k| 0.5 * (p[k] + q[k]));
        }
    }
    let fibres = |sign: f64| Fibres { angle_deg: sign * angle_deg, spacing_mm: 1.0, stiffness_n: 100.0 };
    let film = Film { axis: [1.0, 0.0, 0.0], isotropic: None, fibres: vec![fibres(1.0), fibres(-1.0)] };
    let end = |tet: &[u32; 10]| {
        let x = tet[..4].iter().map(|n| b.mesh.nodes_mm[*n as usize][0]).sum::<f64>() / 4.0;
        u16::from(x < 2.0 || x > length - 2.0)
    };
    b.mesh.tet_material = b.mesh.tets.iter().map(end).collect();
    let solid = |mu_mpa: f64| neo_hookean(mu_mpa, 2000.0 * mu_mpa, 0.0, VolumeChange::Mean);
    let config = ProblemConfig {
        elastomers: [solid(0.01), solid(10.0)].concat(),
        sheet: None,
        films: vec![film],
        cavity_load: CavityLoad::Consistent,
        ..ProblemConfig::default()
    };
    let problem = Arc::new(Problem::new(b.mesh, config).unwrap());
    let mut solver = Solver::new(Arc::clone(&problem)).unwrap();
    let start = solver.undeformed();
    let (state, report) = solver.solve_to(&start, &Load { pressure_mpa, ..Load::default() }).unwrap();
    println!("{angle_deg}: {report:?}");
    let nodes = &problem.mesh().nodes_mm;
    let section = |x: f64| -> [f64; 2] {
        let on = |n: &usize| (nodes[*n][0] - x).abs() < 1e-6 && nodes[*n][1].hypot(nodes[*n][2]) > 6.0 - 1e-6;
        let all: Vec<usize> = (0..nodes.len()).filter(on).collect();
        let sum = all.iter().fold([0.0; 2], |sum, n| {
            let p: [f64; 3] = [0, 1, 2].map(|k| nodes[*n][k] + state.displacement_mm[*n][k]);
            [sum[0] + p[0], sum[1] + p[1].hypot(p[2])]
        });
        sum.map(|v| v / all.len() as f64)
    };
    let (a, b) = (section(10.0), section(20.0));
    [(b[0] - a[0]) / 10.0, 0.5 * (a[1] + b[1]) / 6.0]
}

/// Inextensible fibres turn until the winding angle has `tan^2 = 2` (54.74 degrees from the axis): a tube wound at it keeps its length,
/// one wound steeper or flatter extends or contracts by `cos 54.74 / cos angle`.
#[test]
fn wound_tube_has_no_extension_at_54_7_degrees() {
    let neutral = 2.0_f64.sqrt().atan();
    let [length, radius] = wound(neutral.to_degrees(), 0.05);
    println!("neutral: {length} {radius}");
    assert!((length - 1.0).abs() < 5.0e-3 && (radius - 1.0).abs() < 5.0e-3, "{length} {radius}");
    for degrees in [50.0_f64, 60.0] {
        let angle = degrees.to_radians();
        let expected = [neutral.cos() / angle.cos(), neutral.sin() / angle.sin()];
        let found = wound(degrees, 0.05);
        println!("{degrees}: {found:?} expected {expected:?}");
        for (found, expected) in found.iter().zip(expected) {
            assert!(
                (found - expected).abs() < 0.15 * (expected - 1.0).abs() + 5.0e-3,
                "{degrees}: {found} {expected}"
            );
        }
    }
}

/// The mesh as an input file with a set of elements, one of nodes and two element surfaces.
fn input_file(mesh: &Mesh, skeleton: &[usize], surfaces: &[(&str, Vec<[u32; 6]>)]) -> String {
    let mut text = String::from("*NODE\n");
    for (n, p) in mesh.nodes_mm.iter().enumerate() {
        writeln!(text, "{}, {:?}, {:?}, {:?}", n + 1, p[0], p[1], p[2]).unwrap();
    }
    text += "*ELEMENT, TYPE=C3D10, ELSET=ALL\n";
    for (e, tet) in mesh.tets.iter().enumerate() {
        let nodes: Vec<String> = tet.iter().map(|n| (n + 1).to_string()).collect();
        writeln!(text, "{}, {}", e + 1, nodes.join(", ")).unwrap();
    }
    text += "*ELSET, ELSET=skeleton\n";
    skeleton.iter().for_each(|e| writeln!(text, "{}", e + 1).unwrap());
    for (name, triangles) in surfaces {
        writeln!(text, "*NSET, NSET={name}").unwrap();
        let mut nodes: Vec<u32> = triangles.iter().flatten().copied().collect();
        nodes.sort_unstable();
        nodes.dedup();
        nodes.iter().for_each(|n| writeln!(text, "{}", n + 1).unwrap());
    }
    text
}

/// `actuator.toml` of a mesh file: the reference's constants without its boxes.
fn own_mesh(parts: &str) -> String {
    let text = reference();
    let from = |section: &str| text.find(&format!("[{section}]")).unwrap();
    let rest = &text[from("elastomer")..from("sheet")];
    let settings = &text[from("contact")..from("mesh")];
    format!(
        "layout = 1\nname = \"bender\"\n{rest}[loads]\ngravity_mm_s2 = [0.0, 0.0, 0.0]\ncavity_load = \"flat-facets\"\n\
         [support]\nfixed = \"clamp\"\n{settings}\n{parts}"
    )
}

#[test]
fn own_mesh_gives_names_materials_and_two_pressures() {
    let mut b = two_chambers();
    let (left, right) = (wall(&mut b, [1.0, 2.0]), wall(&mut b, [6.0, 7.0]));
    let clamp = b.faces(|p| p[0] < 1.0e-9);
    let middle =
        |tet: &[u32; 10]| tet[..4].iter().all(|n| (3.0..=5.0).contains(&b.mesh.nodes_mm[*n as usize][2]));
    let skeleton: Vec<usize> = (0..b.mesh.tets.len()).filter(|e| middle(&b.mesh.tets[*e])).collect();
    let folder = tempfile::tempdir().unwrap();
    let surfaces = [("clamp", clamp), ("CHAMBER1", left), ("cavity.right", right)];
    std::fs::write(folder.path().join("bender.inp"), input_file(&b.mesh, &skeleton, &surfaces)).unwrap();
    let path = folder.path().join("actuator.toml");
    let law = "law = \"neo-hookean\"\nmu_mpa = 1300.0\n";
    let parts = format!(
        "[pressure_mpa]\nright = 0.0\n[materials.skeleton]\nbulk_mpa = 4200.0\ndensity_t_per_mm3 = 1.2e-9\n\
         [materials.skeleton.law]\n{law}[mesh]\nfile = \"bender.inp\"\nnames = {{ cavity = \"CHAMBER1\" }}\n"
    );
    std::fs::write(&path, own_mesh(&parts)).unwrap();
    let actuator = Actuator::read(&path).unwrap();
    let mesh = actuator.read_mesh(&path).unwrap();
    assert_eq!(mesh.tet_material.iter().filter(|m| **m == 1).count(), skeleton.len());
    assert!(!skeleton.is_empty() && mesh.cavity.len() == mesh.cavities[0].len());
    // The tip is the middle of the free end, wherever the mesher put its nodes.
    let end = mesh.end_face();
    assert_eq!((end.axis, end.sense, end.is_solid), (0, 1.0, true));
    assert_eq!((end.centroid_mm, end.free_length_mm), ([12.0, 1.5, 4.0], 12.0));
    assert!(end.nodes.iter().all(|n| mesh.nodes_mm[*n as usize][0] == 12.0) && end.nodes.len() > 30);
    let named = actuator.inventory(&path).unwrap();
    let held = |name: &str| named.iter().find(|part| part.name == name).unwrap().encloses_mm3;
    assert!(held("CHAMBER1").is_some_and(|mm3| mm3 > 1.0) && held("clamp").is_none(), "{named:?}");
    // The pressure of a further cavity is a quantity of the actuator, hence an input of lists, databases and models.
    assert_eq!(actuator.quantity("pressure_mpa.right").unwrap(), 0.0);
    assert_eq!(fem::actuator::unit("pressure_mpa.right"), "MPa");
    let problem = Arc::new(Problem::new(mesh, actuator.problem_config()).unwrap());
    let family = Family { actuator, problem };
    let variant = family.variant(&[("pressure_mpa.right".into(), 0.004)]).unwrap();
    assert_eq!(family.problem_of(&variant).unwrap().config().cavities_mpa, [0.004]);
    // What is missing is named with what there is.
    for (text, expected) in [
        (own_mesh(&parts.replace("CHAMBER1", "CHAMBER2")), ["surface cavity", "CHAMBER1"]),
        (
            own_mesh(&parts.replace("[pressure_mpa]\nright = 0.0\n", "")),
            ["surface cavity.right", "[pressure_mpa]"],
        ),
        (own_mesh(&parts.replace("materials.skeleton", "materials.bone")), ["materials.bone", "skeleton"]),
        (own_mesh(&parts).replace("\"clamp\"", "\"grip\""), ["surface grip", "clamp"]),
    ] {
        let actuator = Actuator::parse(&text).unwrap();
        let refused = actuator.read_mesh(&path).unwrap_err().to_string();
        assert!(expected.iter().all(|word| refused.contains(word)), "{refused}");
    }
}

#[test]
fn boxes_without_slots_sheet_and_lower_part_are_meshed() {
    let text = std::fs::read_to_string(model("pneunet/actuator.toml")).unwrap();
    let without = |text: &str, section: &str| {
        let at = text.find(&format!("[{section}]")).unwrap();
        let end = at + 1 + text[at + 1..].find("\n[").unwrap();
        format!("{}{}", &text[..at], &text[end..])
    };
    for (sections, film) in [(vec!["slots"], true), (vec!["slots", "sheet", "channels", "obstacle"], false)] {
        let mut text = sections.iter().fold(text.clone(), |text, section| without(&text, section));
        text = text.replace("lower_mm = 2.0", "lower_mm = 0.0").replace("nodes = 25022", "nodes = 0");
        let actuator = Actuator::parse(&text).unwrap();
        let mesh = actuator.grid_mesh(9.0, 1).unwrap();
        assert_eq!(mesh.slots.len(), 0);
        assert_eq!(mesh.sheet.is_empty(), !film);
        // The sheet lies below: on the surface that touches the obstacle.
        assert!(!film || mesh.sheet.len() == mesh.bottom.len());
        Problem::new(mesh, actuator.problem_config()).unwrap();
    }
}
