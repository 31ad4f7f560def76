//! A small actuator for tests: a bar of 10-node tetrahedra that bends down with pressure and stops at the plate.
#![allow(dead_code)] // each test file uses its part

use formats::results::{NodalQuantity, Run, Wanted};
use rom::snapshots::{Case, Database, FieldSpec, Footprint, RegimeKind, Split};
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// Corners of the six tetrahedra of a unit cube, positively oriented.
const SIX: [[usize; 4]; 6] =
    [[0, 1, 3, 7], [0, 5, 1, 7], [0, 4, 5, 7], [0, 3, 2, 7], [0, 6, 4, 7], [0, 2, 6, 7]];
const EDGES: [[usize; 2]; 6] = [[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]];

/// Points and tetrahedra of a bar of `cubes` cubes along x, 10 mm each.
pub fn bar(cubes: usize) -> (Vec<[f64; 3]>, Vec<[u32; 10]>) {
    let corner = |cube: usize, i: usize| [cube + (i & 1), i >> 1 & 1, i >> 2];
    let (mut points, mut ids, mut tets) = (Vec::new(), HashMap::new(), Vec::new());
    for cube in 0..cubes {
        for tet in SIX {
            let corners = tet.map(|i| corner(cube, i).map(|c| c as f64 * 10.0));
            let mids = EDGES.map(|[a, b]| [0, 1, 2].map(|k| 0.5 * (corners[a][k] + corners[b][k])));
            let mut nodes = [0_u32; 10];
            for (node, p) in nodes.iter_mut().zip(corners.iter().chain(&mids)) {
                *node = *ids.entry(p.map(|v| v as i64)).or_insert_with(|| {
                    points.push(*p);
                    points.len() as u32 - 1
                });
            }
            tets.push(nodes);
        }
    }
    (points, tets)
}

/// Database of the bar with one snapshot per case.
pub fn database(cases: Vec<Case>) -> (Database, Vec<[u32; 10]>) {
    let (points, tets) = bar(3);
    let mut snapshots = Vec::new();
    for case in &cases {
        for p in &points {
            let down = case.pressure_mpa * 100.0 * (p[0] / 30.0).powi(2);
            let y = p[1] - down.min(case.gap_mm.unwrap_or(f64::INFINITY));
            let stress = case.pressure_mpa * (1.0 + p[0]);
            snapshots.extend([p[0], y, p[2], p[1] - y, stress].map(|v| v as f32));
        }
    }
    let mut database = Database {
        actuator: "bar".into(),
        fields: FieldSpec::of_the_paper(),
        node_count: points.len(),
        cases,
        snapshots,
        undeformed_mm: Some(points),
        undeformed_by: Vec::new(),
        surface_triangles: vec![],
        node_sets: vec![],
        obstacle: Footprint::PLATE,
        parameters: vec![],
        sensitivities: None,
        vibrations: vec![],
        hash: [0; 32],
    };
    database.hash = database.content_hash();
    (database, tets)
}

/// A case of the bar.
pub fn case(name: &str, split: Split, pressure_mpa: f64, gap_mm: Option<f64>) -> Case {
    let regime = if gap_mm.is_some() { RegimeKind::Contact } else { RegimeKind::Free };
    let contact_force_n = gap_mm.map_or(0.0, |gap| (pressure_mpa * 100.0 - gap).max(0.0));
    Case { name: name.into(), regime, split, pressure_mpa, gap_mm, contact_force_n, parameters: vec![] }
}

/// A file of another program.
pub fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(name)
}

/// A quantity of a step of a run.
pub fn quantity<'a>(run: &'a Run, step: usize, name: &str) -> &'a NodalQuantity {
    run.steps[step].quantities.iter().find(|quantity| quantity.name == name).expect("the quantity")
}

/// A state without pressure of which nothing else is known.
pub fn at_rest(name: &str) -> Case {
    case(name, Split::Train, 0.0, None)
}

/// Coordinates and stress of a run in mm and MPa.
pub fn wanted() -> Wanted {
    Wanted { length_mm: 1.0, stress_mpa: Some(1.0), displacement: None, stress: None, fields: vec![] }
}
