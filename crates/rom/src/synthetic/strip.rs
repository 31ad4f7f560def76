//! A strip of formulas under an axial load: straight up to a load, then buckled to one of two sides, by the sign of an
//! imperfection. No pressure, no gap, no obstacle; three regimes with names of their own.

use crate::inputs::Parameter;
use crate::snapshots::{Case, Database, FieldSpec, Footprint, RegimeKind, Split};
use std::f64::consts::PI;

/// The regimes, in the order in which [`database`] names them.
pub const REGIMES: [&str; 3] = ["straight", "up", "down"];
/// Load at which the strip buckles, N.
pub const CRITICAL_N: f64 = 8.0;
/// Ranges of load (N) and imperfection (mm).
pub const RANGES: [[f64; 2]; 2] = [[2.0, 20.0], [-0.5, 0.5]];
const LENGTH_MM: f64 = 100.0;

/// Undeformed node positions in mm: 21 along x, 2 across z.
pub fn mesh() -> Vec<[f64; 3]> {
    (0..21).flat_map(|i| [0.0, 10.0].map(|z| [LENGTH_MM * f64::from(i) / 20.0, 0.0, z])).collect()
}

/// Place of the regime at a load and an imperfection.
pub fn regime(load_n: f64, imperfection_mm: f64) -> u8 {
    match load_n < CRITICAL_N {
        true => 0,
        false if imperfection_mm > 0.0 => 1,
        false => 2,
    }
}

/// Height of the middle in mm.
pub fn height_mm(load_n: f64, imperfection_mm: f64) -> f64 {
    let beyond = load_n - CRITICAL_N;
    let buckled = 5.0 + 0.8 * beyond - 0.02 * beyond * beyond;
    match regime(load_n, imperfection_mm) {
        0 => imperfection_mm * load_n / (2.0 * CRITICAL_N),
        1 => buckled + 2.0 * imperfection_mm,
        _ => 2.0 * imperfection_mm - buckled,
    }
}

/// Fields x, y, z, |u|, von Mises of a state, node-interleaved.
pub fn snapshot(load_n: f64, imperfection_mm: f64) -> Vec<f32> {
    let height_mm = height_mm(load_n, imperfection_mm);
    let node = |x0: &[f64; 3]| {
        let shape = (PI * x0[0] / LENGTH_MM).sin();
        let x = [x0[0] * (1.0 - 1e-4 * load_n), height_mm * shape, x0[2]];
        let u = (x[0] - x0[0]).hypot(x[1]);
        [x[0], x[1], x[2], u, 0.01 * load_n + 0.02 * height_mm.abs() * shape].map(|v| v as f32)
    };
    mesh().iter().flat_map(node).collect()
}

/// So many states over both ranges, spread by golden ratios; every fifth is kept aside as a test.
pub fn states(count: usize) -> Vec<(Split, [f64; 2])> {
    let ratios = [0.754_877_666_246_693, 0.569_840_290_998_053]; // the plastic number's
    let value = |i: usize, k: usize| {
        let [low, high] = RANGES[k];
        low + (high - low) * (0.5 + (i + 1) as f64 * ratios[k]).fract()
    };
    let split = |i: usize| if i % 5 == 4 { Split::Test } else { Split::Train };
    (0..count).map(|i| (split(i), [value(i, 0), value(i, 1)])).collect()
}

/// A database of these states.
pub fn database(states: &[(Split, [f64; 2])]) -> Database {
    let case = |(i, (split, [load, imperfection])): (usize, &(Split, [f64; 2]))| Case {
        name: i.to_string(),
        regime: RegimeKind::Named(regime(*load, *imperfection)),
        split: *split,
        pressure_mpa: 0.0,
        gap_mm: None,
        contact_force_n: 0.0,
        parameters: vec![*load, *imperfection],
    };
    let parameter =
        |name: &str, unit: &str, nominal| Parameter { name: name.into(), unit: unit.into(), nominal };
    let mut database = Database {
        actuator: "strip".into(),
        fields: FieldSpec::of_the_paper(),
        node_count: mesh().len(),
        cases: states.iter().enumerate().map(case).collect(),
        snapshots: states
            .iter()
            .flat_map(|(_, [load, imperfection])| snapshot(*load, *imperfection))
            .collect(),
        undeformed_mm: Some(mesh()),
        undeformed_by: Vec::new(),
        surface_triangles: vec![[0, 1, 2]],
        node_sets: Vec::new(),
        obstacle: Footprint::PLATE,
        parameters: vec![parameter("load_n", "N", 10.0), parameter("imperfection_mm", "mm", 0.1)],
        regime_names: REGIMES.map(String::from).to_vec(),
        sensitivities: None,
        hash: [0; 32],
    };
    database.hash = database.content_hash();
    database
}
