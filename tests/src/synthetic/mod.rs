//! An actuator made of formulas: a beam that bends with pressure until it meets a plate. Its truth is known everywhere,
//! so that a wrong answer cannot hide. Tests use it where no finite-element database is available.

pub mod design;

use rom::snapshots::{Case, Database, FieldSpec, Footprint, NodeSet, RegimeKind, Split};

/// Nodes: 12 along x, 5 across z, 2 over the height.
pub const NODES: usize = 120;

/// A state to simulate: split, pressure in MPa, gap in mm (none: no plate).
pub type State = (Split, f64, Option<f64>);

/// Undeformed node positions in mm.
pub fn mesh() -> Vec<[f64; 3]> {
    let (xs, zs) = ((0..12).map(|i| f64::from(i) * 10.0), (0..5).map(|i| f64::from(i) * 8.0));
    xs.flat_map(|x| zs.clone().flat_map(move |z| [0.0, 15.0].map(|y| [x, y, z]))).collect()
}

/// Depth of the tip's underside in free air, in mm: 20 under its own weight, more with pressure.
pub fn sag_mm(pressure_mpa: f64) -> f64 {
    20.0 + 600.0 * pressure_mpa - 1500.0 * pressure_mpa * pressure_mpa
}

/// Onset pressure of a gap in MPa: the inverse of [`sag_mm`], negative below the sag.
pub fn onset_mpa(gap_mm: f64) -> f64 {
    (600.0 - (360_000.0 - 6000.0 * (gap_mm - 20.0)).sqrt()) / 3000.0
}

/// Contact force in N: grows from the onset.
pub fn force_n(pressure_mpa: f64, gap_mm: f64) -> f64 {
    let excess = pressure_mpa - onset_mpa(gap_mm);
    (excess * (6.0 + 30.0 * pressure_mpa + 0.02 * gap_mm)).max(0.0)
}

/// Fields x, y, z, |u|, von Mises of one state, node-interleaved.
pub fn snapshot(pressure_mpa: f64, gap_mm: Option<f64>) -> Vec<f32> {
    let free = sag_mm(pressure_mpa);
    let depth = gap_mm.map_or(free, |g| free.min(g));
    let blocked = free - depth;
    let node = |x0: &[f64; 3]| {
        let s = x0[0] / 110.0;
        // The blocked part of the motion bulges the middle instead of sinking the tip.
        let down = depth * s * s + 0.3 * blocked * s * (1.0 - s);
        let x = [x0[0] - down * down / 400.0, x0[1] - down, x0[2] + 0.01 * pressure_mpa * (x0[2] - 16.0)];
        let u = ((x[0] - x0[0]).powi(2) + (x[1] - x0[1]).powi(2) + (x[2] - x0[2]).powi(2)).sqrt();
        let stress = (pressure_mpa * (1.0 + s) + 0.004 * blocked * s * (1.0 - s)) * x0[1] / 15.0;
        [x[0], x[1], x[2], u, stress].map(|v| v as f32)
    };
    mesh().iter().flat_map(node).collect()
}

/// Training states: `free` pressures from 0 to 0.09 MPa, and a sheared `rows x columns` grid of pressures and gaps from
/// 8 to 38 mm in which no two states share a gap.
pub fn training_states(free: usize, rows: usize, columns: usize) -> Vec<State> {
    let along = |i: usize, n: usize| i as f64 / (n.max(2) - 1) as f64;
    let mut states: Vec<State> = (0..free).map(|i| (Split::Train, 0.09 * along(i, free), None)).collect();
    for i in 0..rows {
        for j in 0..columns {
            let gap = 8.0 + 30.0 * along(j, columns) + 0.35 * i as f64;
            states.push((Split::Train, 0.005 + 0.085 * along(i, rows), Some(gap)));
        }
    }
    states
}

/// Free and contact states over the plate, three of them with split `test`.
pub fn plate() -> Database {
    let mut states = training_states(12, 8, 7);
    states.extend([
        (Split::Test, 0.033, None),
        (Split::Test, 0.061, Some(17.3)),
        (Split::Test, 0.047, Some(29.0)),
    ]);
    database(&states)
}

/// A database of the given states.
pub fn database(states: &[State]) -> Database {
    let case = |(i, (split, p, gap)): (usize, &State)| Case {
        name: i.to_string(),
        regime: if gap.is_some() { RegimeKind::Contact } else { RegimeKind::Free },
        split: *split,
        pressure_mpa: *p,
        gap_mm: *gap,
        contact_force_n: gap.map_or(0.0, |g| force_n(*p, g)),
        parameters: Vec::new(),
    };
    let mut database = Database {
        actuator: "beam".into(),
        fields: FieldSpec::of_the_paper(),
        node_count: NODES,
        cases: states.iter().enumerate().map(case).collect(),
        snapshots: states.iter().flat_map(|(_, p, gap)| snapshot(*p, *gap)).collect(),
        undeformed_mm: Some(mesh()),
        undeformed_by: Vec::new(),
        surface_triangles: vec![[0, 1, 2], [2, 3, 4]],
        node_sets: vec![NodeSet { name: "tip".into(), nodes: (110..120).collect() }],
        obstacle: Footprint::PLATE,
        parameters: Vec::new(),
        sensitivities: None,
        vibrations: Vec::new(),
        hash: [0; 32],
    };
    database.hash = database.content_hash();
    database
}
