//! A model with inertia of a body in closed form: two masses on a chain of springs; the pressure pushes the outer one onto a plate.

use rom::inertia::data::InertiaModel;
use rom::inputs::Parameter;
use rom::memory::{InputMemory, MemorySpec, PronyTerm, Slopes, filter};
use rom::model::{BlockKind, Model};
use rom::rng::Rng;
use rom::snapshots::{
    Case, Database, FieldKind, FieldSpec, Footprint, NodeSet, RegimeKind, Split, Vibration,
};
use std::sync::OnceLock;
use train::config::{KernelKind, KernelSpec, RegimeConfig, Tail, TrainConfig};
use train::inertia::{Mass, reduce};

/// Name of the inertial load in the model's inputs.
pub const LOAD: &str = "loads.gravity_mm_s2.1";
/// Load at rest, and its range, mm/s2.
pub const REST: f64 = -9810.0;
const RANGE: [f64; 2] = [-60_000.0, 40_000.0];
/// Nodes: frame, inner mass, outer mass.
pub const NODES: usize = 3;
/// Mass of each, t.
const MASS_T: [f64; NODES] = [0.0, 1e-6, 1e-6];
/// Stiffness to the frame and between the masses, N/mm, and force of the pressure, N/MPa.
const STIFFNESS: [f64; 2] = [2e-3, 9e-3];
const PUSH: f64 = 0.2;
const PRESSURES_MPA: [f64; 2] = [0.0, 0.3];
const GAPS_MM: [f64; 2] = [16.0, 28.0];

/// Deflections of both masses (mm) and force on the plate (N).
fn equilibrium(pressure_mpa: f64, gap_mm: f64, load: f64) -> ([f64; 2], f64) {
    let ([k, l], push, weight) = (STIFFNESS, PUSH * pressure_mpa, MASS_T[1] * load);
    // The weight of the outer mass is left out on both sides: only the inner one feels it.
    let first = (weight - push) / k;
    if first - push / l >= -gap_mm {
        return ([first, first - push / l], 0.0);
    }
    let first = (weight - l * gap_mm) / (k + l);
    ([first, -gap_mm], l * (-gap_mm - first) + push)
}

/// x, y and z of all nodes for deflections along y.
fn places(deflections_mm: [f64; 2]) -> [[f64; 3]; NODES] {
    let [first, second] = deflections_mm;
    let at = |x: f64, y0: f64, y: f64| [x + 1e-3 * y, y0 + y, 16.0 + 1e-3 * y];
    [at(0.0, 4.0, 0.0), at(10.0, 2.0, first), at(20.0, 0.0, second)]
}

fn database() -> Database {
    let field = |name: &str, axis| FieldSpec {
        name: name.into(),
        unit: "mm".into(),
        kind: FieldKind::Coordinate(axis),
    };
    let roots = [2.0_f64, 3.0, 5.0].map(f64::sqrt);
    let state = |i: usize| {
        let within =
            |k: usize, [low, high]: [f64; 2]| low + ((i + 1) as f64 * roots[k]).fract() * (high - low);
        let gap_mm = if i.is_multiple_of(3) { f64::INFINITY } else { within(1, GAPS_MM) };
        (within(0, PRESSURES_MPA), gap_mm, within(2, RANGE))
    };
    let corners =
        [(0.0, REST), (0.3, REST), (0.0, RANGE[0]), (0.3, RANGE[0]), (0.0, RANGE[1]), (0.3, RANGE[1])];
    let gaps = [f64::INFINITY, GAPS_MM[0], GAPS_MM[1]];
    let ends = corners.iter().flat_map(|(p, load)| gaps.map(|gap_mm| (*p, gap_mm, *load)));
    let states: Vec<(f64, f64, f64)> = ends.chain((0..90).map(state)).collect();
    let case = |(i, (pressure_mpa, gap_mm, load)): (usize, &(f64, f64, f64))| Case {
        name: i.to_string(),
        regime: if gap_mm.is_finite() { RegimeKind::Contact } else { RegimeKind::Free },
        split: Split::Train,
        pressure_mpa: *pressure_mpa,
        gap_mm: Some(*gap_mm).filter(|gap_mm| gap_mm.is_finite()),
        contact_force_n: equilibrium(*pressure_mpa, *gap_mm, *load).1,
        parameters: vec![*load],
    };
    let snapshot = |(p, gap_mm, load): &(f64, f64, f64)| places(equilibrium(*p, *gap_mm, *load).0);
    let mut database = Database {
        actuator: "chain".into(),
        fields: vec![field("x", 0), field("y", 1), field("z", 2)],
        node_count: NODES,
        cases: states.iter().enumerate().map(case).collect(),
        snapshots: states.iter().flat_map(snapshot).flatten().map(|v| v as f32).collect(),
        undeformed_mm: Some(places([0.0; 2]).to_vec()),
        surface_triangles: vec![[0, 1, 2]],
        node_sets: vec![NodeSet { name: "tip".into(), nodes: vec![2] }],
        obstacle: Footprint { x_mm: [15.0, 25.0], z_mm: [-9.0, 41.0] },
        parameters: vec![Parameter { name: LOAD.into(), unit: "mm/s2".into(), nominal: REST }],
        vibrations: vec![vibration()],
        ..Database::default()
    };
    database.hash = database.content_hash();
    database
}

/// The faster vibration of the free chain.
fn vibration() -> Vibration {
    let [k, l] = STIFFNESS;
    // Upper eigenvector of [[k + l, -l], [-l, l]].
    let stiffness = 0.5 * (k + 2.0 * l + (k * k + 4.0 * l * l).sqrt());
    let ratio = l / (l - stiffness);
    let first = 1.0 / (MASS_T[1] * (1.0 + ratio * ratio)).sqrt();
    let along = [0.0, first, first * ratio];
    let shape_mm = [1e-3, 1.0, 1e-3].iter().flat_map(|by| along.map(|y| by * y)).collect();
    Vibration {
        regime: RegimeKind::Free,
        rate_rad_s: (stiffness / MASS_T[1]).sqrt(),
        shape_mm,
        reaction_n: 0.0,
    }
}

/// Model file with inertia; trained once per test program.
///
/// # Panics
/// If it cannot be trained.
pub fn model_bytes() -> &'static [u8] {
    static BYTES: OnceLock<Vec<u8>> = OnceLock::new();
    BYTES.get_or_init(|| {
        let regime = || RegimeConfig {
            kernels: vec![KernelSpec { kernel: KernelKind::Cubic, tail: Tail::Linear }],
            ..RegimeConfig::default()
        };
        let config = TrainConfig { free: regime(), contact: regime(), ..TrainConfig::default() };
        let database = database();
        let (mut model, _) = train::train(&database, &config, &mut |_| {}).expect("the chain trains");
        let times = |v: &[f64]| v.iter().enumerate().map(|(i, v)| MASS_T[i % NODES] * v).collect();
        // Only the inner mass is loaded: the family is then that of one load.
        let unit_load = vec![0.0, 0.0, 0.0, 0.0, MASS_T[1], 0.0, 0.0, 0.0, 0.0];
        let mass = Mass {
            loads: vec![(LOAD, unit_load)],
            times: &times,
            damping_s: 0.02,
            step_ns: 1_000_000,
            prony: Vec::new(),
        };
        let mut reduced = reduce(&model, &database, &mass).expect("its mass can be reduced");
        reduced.inertia.widths.past = [1.0, 0.0, 0.0];
        model.set_record(BlockKind::Inertia, &reduced.inertia).expect("a record");
        model.to_bytes().expect("the chain can be written")
    })
}

/// The same of a relaxing elastomer, whose pressure acts behind the load filter of its series.
///
/// # Panics
/// If the model cannot be written.
pub fn relaxing_bytes() -> Vec<u8> {
    let mut model = Model::from_bytes(model_bytes()).expect("a model");
    let mut inertia: InertiaModel =
        model.record(BlockKind::Inertia).expect("a record").expect("a model with inertia");
    inertia.prony = vec![PronyTerm { ratio: 0.25, time_s: 0.05 }];
    let pressure = InputMemory {
        input: 0,
        range: PRESSURES_MPA,
        line: None,
        orifice: None,
        play: Vec::new(),
        creep: filter(&inertia.prony).expect("a series"),
        slopes: Slopes::default(),
    };
    let memory = MemorySpec { inputs: vec![pressure], max_gap_s: 1.0 };
    model.set_record(BlockKind::Inertia, &inertia).expect("a record");
    model.set_record(BlockKind::Memory, &memory).expect("a record");
    model.to_bytes().expect("a file")
}

/// What a sensor of the beam sends.
#[derive(Clone, Copy, Debug)]
pub struct BeamReading {
    /// The actuator was switched off and on again before it.
    pub restarts: bool,
    /// Time of the measurement, ns.
    pub t_ns: u64,
    /// The pressure; not always a number that a body can have.
    pub pressure_mpa: f64,
}

/// Random readings: most 1 to 20 ms apart, some after a gap that is bridged, held or too long for a motion to go on, some late, some not a
/// number, some after a restart.
pub fn readings(seed: u64) -> Vec<BeamReading> {
    let (mut random, mut t_ns) = (Rng::new(seed), 0);
    let mut reading = |k: usize| {
        let kind = if k < 3 { 99 } else { random.below(40) };
        let before_ns = t_ns;
        t_ns += match kind {
            0 => 200_000_000,
            1 => 400_000_000,
            2 => 1_500_000_000,
            _ => 1_000_000 + random.below(19_000_001) as u64,
        };
        let pressure_mpa = match kind {
            3 | 4 => f64::NAN,
            5 => 1e200,
            _ => 0.15 * random.uniform(),
        };
        let late_ns = before_ns - (random.below(20) as u64).min(before_ns);
        BeamReading { restarts: kind == 6, t_ns: if kind == 7 { late_ns } else { t_ns }, pressure_mpa }
    };
    (0..400).map(&mut reading).collect()
}
