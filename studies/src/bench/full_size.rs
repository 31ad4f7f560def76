//! A model of full size from formulas: the costs of a twin do not depend on what the numbers mean.

use anyhow::Context;
use rom::model::Model;
use rom::snapshots::{Case, Database, FieldSpec, Footprint, NodeSet, RegimeKind, Split};
use train::config::{KernelKind, KernelSpec, ModeChoice, RegimeConfig, Tail, TrainConfig};

/// Nodes of the reference actuator.
pub const NODES: usize = 25_022;
/// Modes of each field.
pub const MODES: usize = 6;
const FREE_CASES: usize = 17;
const CONTACT_CASES: usize = 85;
const LENGTH_MM: f64 = 115.0;

/// Trains a model with as many nodes, modes and centres as the paper's: 17 free and 85 contact states.
pub fn model() -> anyhow::Result<Model> {
    let kernel = KernelSpec { kernel: KernelKind::Cubic, tail: Tail::Linear };
    let regime = RegimeConfig {
        modes: ModeChoice::Fixed(MODES),
        kernels: vec![kernel],
        anisotropy: vec![1.0],
        shear: vec![0.0],
        ..RegimeConfig::default()
    };
    let config = TrainConfig { free: regime.clone(), contact: regime, ..TrainConfig::default() };
    let (model, _) = train::train(&database(), &config, &mut |_| {})
        .context("the synthetic model could not be trained")?;
    Ok(model)
}

/// Undeformed nodes: layers along the actuator, so that neighbours in number are neighbours in space.
fn mesh() -> Vec<[f64; 3]> {
    let node = |i: usize| {
        let (layer, within) = (i / 36, i % 36);
        let x = LENGTH_MM * layer as f64 / (NODES / 36) as f64;
        [x, 19.0 * (within / 6) as f64 / 5.0, 32.0 * (within % 6) as f64 / 5.0]
    };
    (0..NODES).map(node).collect()
}

/// Depth of the free tip in mm: 20 from its weight, more with pressure.
fn sag_mm(pressure_mpa: f64) -> f64 {
    20.0 + 600.0 * pressure_mpa - 1500.0 * pressure_mpa * pressure_mpa
}

/// Coordinates, displacement and stress of one node. The sines move with the inputs, so that the snapshots have more
/// independent shapes than the model keeps modes.
fn node_state(x0: &[f64; 3], pressure_mpa: f64, gap_mm: Option<f64>) -> [f32; 5] {
    let free = sag_mm(pressure_mpa);
    let depth = gap_mm.map_or(free, |gap| free.min(gap));
    let blocked = free - depth;
    let s = x0[0] / LENGTH_MM;
    let ripple = (8.0 * s + 40.0 * pressure_mpa + 0.05 * blocked).sin();
    let down = depth * s * s + 0.3 * blocked * s * (1.0 - s);
    let x = [
        x0[0] - down * down / 400.0 + 0.5 * s * (1.0 - s) * ripple,
        x0[1] - down,
        x0[2] + 10.0 * pressure_mpa * (x0[2] - 16.0) / 16.0 * (1.0 + 0.2 * ripple),
    ];
    let displacement = (0..3).map(|axis| (x[axis] - x0[axis]).powi(2)).sum::<f64>().sqrt();
    let stress = pressure_mpa * (1.5 + ripple) + 0.004 * blocked * s * (1.0 - s);
    [x[0], x[1], x[2], displacement, stress].map(|value| value as f32)
}

/// Low-discrepancy states over the paper's ranges: no two share a pressure or a gap.
fn cases() -> Vec<Case> {
    let spread = |i: usize, ratio: f64| (0.5 + i as f64 * ratio).fract();
    let case = |i: usize, pressure_mpa: f64, gap_mm: Option<f64>, contact_force_n: f64| Case {
        name: i.to_string(),
        regime: if gap_mm.is_some() { RegimeKind::Contact } else { RegimeKind::Free },
        split: Split::Train,
        pressure_mpa,
        gap_mm,
        contact_force_n,
        parameters: Vec::new(),
    };
    let free = (0..FREE_CASES).map(|i| case(i, 0.09 * i as f64 / (FREE_CASES - 1) as f64, None, 0.0));
    let contact = (0..CONTACT_CASES).map(|i| {
        let (pressure, gap) = (0.03 + 0.06 * spread(i, 0.754_877_666), 8.0 + 27.0 * spread(i, 0.569_840_291));
        case(FREE_CASES + i, pressure, Some(gap), 0.01 * (sag_mm(pressure) - gap).max(0.0))
    });
    free.chain(contact).collect()
}

fn database() -> Database {
    let mesh = mesh();
    let cases = cases();
    let state = |case: &Case| {
        let (pressure, gap) = (case.pressure_mpa, case.gap_mm);
        mesh.iter().flat_map(move |x0| node_state(x0, pressure, gap)).collect::<Vec<f32>>()
    };
    let snapshots = cases.iter().flat_map(state).collect();
    let set = |name: &str, keep: &dyn Fn(usize) -> bool| NodeSet {
        name: name.into(),
        nodes: (0..NODES).filter(|&i| keep(i)).map(|i| i as u32).collect(),
    };
    let node_sets = vec![set("tip", &|i| i >= NODES - 500), set("surface", &|i| i % 36 < 20)];
    let mut database = Database {
        actuator: "synthetic".into(),
        fields: FieldSpec::of_the_paper(),
        node_count: NODES,
        cases,
        snapshots,
        undeformed_mm: Some(mesh),
        undeformed_by: Vec::new(),
        surface_triangles: Vec::new(),
        node_sets,
        obstacle: Footprint::PLATE,
        parameters: Vec::new(),
        sensitivities: None,
        vibrations: Vec::new(),
        hash: [0; 32],
    };
    database.hash = database.content_hash();
    database
}
