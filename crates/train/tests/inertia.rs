//! Reduced inertia of a body whose motion has a closed form: a lever of many nodes on a torsion spring.

use rom::evaluator::Evaluator;
use rom::inertia::data::InertiaModel;
use rom::inertia::model_motion::ModelMotion;
use rom::inputs::{Inputs, PARAMETERS, Parameter};
use rom::model::{BlockKind, Model};
use rom::snapshots::{Case, Database, FieldKind, FieldSpec, RegimeKind, Split};
use train::TrainError;
use train::config::TrainConfig;
use train::inertia::{Mass, reduce};
use train::train;

const LOAD: &str = "loads.gravity_mm_s2.1";
const REST: f64 = -9810.0;
const NODES: usize = 40;
/// Torsion spring, mJ.
const TORSION: f64 = 0.25;
const BETA_S: f64 = 2e-3;

/// Distance of a node from the hinge, mm, and its mass, t.
fn node(i: usize) -> (f64, f64) {
    (2.5 * i as f64, 1e-9 * (1.0 + 0.02 * i as f64))
}

/// First and second moment of the mass about the hinge.
fn moments() -> [f64; 2] {
    let sum = |power: i32| (0..NODES).map(|i| node(i).1 * node(i).0.powi(power)).sum();
    [sum(1), sum(2)]
}

fn rest_angle(pressure_mpa: f64) -> f64 {
    -6.0 * pressure_mpa
}

fn equilibrium(pressure_mpa: f64, load: f64) -> f64 {
    let [first, _] = moments();
    let mut angle = rest_angle(pressure_mpa);
    for _ in 0..50 {
        let off = TORSION * (angle - rest_angle(pressure_mpa)) - load * first * angle.cos();
        angle -= off / (TORSION + load * first * angle.sin());
    }
    angle
}

/// Free states over pressure and load.
fn database() -> Database {
    let field = |name: &str, axis| FieldSpec {
        name: name.into(),
        unit: "mm".into(),
        kind: FieldKind::Coordinate(axis),
    };
    let states: Vec<(f64, f64)> =
        (0..48).map(|i| (0.06 * (i % 6) as f64 / 5.0, -45_000.0 + 60_000.0 * (i / 6) as f64 / 7.0)).collect();
    let case = |(i, (pressure_mpa, load)): (usize, &(f64, f64))| Case {
        name: i.to_string(),
        regime: RegimeKind::Free,
        split: Split::Train,
        pressure_mpa: *pressure_mpa,
        gap_mm: None,
        contact_force_n: 0.0,
        parameters: vec![*load],
    };
    let snapshot = |(pressure_mpa, load): &(f64, f64)| {
        let (sin, cos) = equilibrium(*pressure_mpa, *load).sin_cos();
        (0..NODES).flat_map(move |i| {
            let along = node(i).0;
            [along * cos, along * sin, 3.0 + 1e-3 * along * sin].map(|v| v as f32)
        })
    };
    let mut database = Database {
        actuator: "lever".into(),
        fields: vec![field("x", 0), field("y", 1), field("z", 2)],
        node_count: NODES,
        cases: states.iter().enumerate().map(case).collect(),
        snapshots: states.iter().flat_map(snapshot).collect(),
        parameters: vec![Parameter { name: LOAD.into(), unit: "mm/s2".into(), nominal: REST }],
        ..Database::default()
    };
    database.hash = database.content_hash();
    database
}

fn times(v: &[f64]) -> Vec<f64> {
    v.iter().enumerate().map(|(i, v)| node(i % NODES).1 * v).collect()
}

fn mass(load: &str) -> Mass<'_> {
    let mut unit_load = vec![0.0; 3 * NODES];
    (0..NODES).for_each(|i| unit_load[NODES + i] = node(i).1);
    Mass {
        loads: vec![(load, unit_load)],
        times: &times,
        damping_s: BETA_S,
        step_ns: 500_000,
        prony: Vec::new(),
    }
}

fn model() -> Model {
    let database = database();
    let (mut model, _) = train(&database, &TrainConfig::default(), &mut |_| {}).expect("a model");
    let reduced = reduce(&model, &database, &mass(LOAD)).expect("inertia");
    model.set_record(BlockKind::Inertia, &reduced.inertia).expect("a record");
    model
}

/// Pressure that rises in 20 ms and falls again.
fn pressure_mpa(t_s: f64) -> f64 {
    0.015 + 0.03 * ((t_s / 0.02).min(1.0) - ((t_s - 0.4) / 0.02).clamp(0.0, 1.0))
}

/// Angles every 5 ms by the equation of motion of the lever.
fn truth() -> Vec<f64> {
    let [first, second] = moments();
    let rhs = |t_s: f64, [angle, rate]: [f64; 2]| {
        let off = TORSION * (angle - rest_angle(pressure_mpa(t_s)));
        let load = off / (first * angle.cos());
        let stiffness = TORSION + load * first * angle.sin();
        [rate, (-off + REST * first * angle.cos() - BETA_S * stiffness * rate) / second]
    };
    let (h, mut y, mut angles) = (2.5e-5, [equilibrium(pressure_mpa(0.0), REST), 0.0], Vec::new());
    for i in 0..32_000 {
        let t_s = f64::from(i) * h;
        let along = |k: [f64; 2], by: f64| [y[0] + by * k[0], y[1] + by * k[1]];
        let a = rhs(t_s, y);
        let b = rhs(t_s + 0.5 * h, along(a, 0.5 * h));
        let c = rhs(t_s + 0.5 * h, along(b, 0.5 * h));
        let d = rhs(t_s + h, along(c, h));
        y = std::array::from_fn(|i| y[i] + h / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]));
        if (i + 1) % 200 == 0 {
            angles.push(y[0]);
        }
    }
    angles
}

#[test]
fn trained_model_moves_as_the_equation_of_motion_and_rests_as_the_static_model() {
    let model = Model::from_bytes(&model().to_bytes().expect("bytes")).expect("the file is read back");
    let mut motion = ModelMotion::new(&model).expect("inertia fits").expect("it moves");
    let mut evaluation = motion.evaluation();
    let first =
        motion.advance(0, Inputs::new(pressure_mpa(0.0), f64::INFINITY), &mut evaluation).expect("a reading");
    assert!(first.at_rest);
    let evaluator = Evaluator::new(&model.header).expect("evaluator");
    let mut still = evaluator.evaluation();
    evaluator.evaluate(Inputs::new(pressure_mpa(0.0), f64::INFINITY), &mut still);
    assert_eq!(evaluation.coefficients, still.coefficients);
    let (mut square, truth) = (0.0, truth());
    for (i, exact) in (1..).zip(&truth) {
        let t_s = 5e-3 * f64::from(i);
        let reading = Inputs::new(pressure_mpa(t_s), f64::INFINITY);
        let moved = motion
            .advance(u64::try_from(i).unwrap_or(0) * 5_000_000, reading, &mut evaluation)
            .expect("a reading");
        assert!(moved.load_distance == 0.0 && !moved.at_rest, "{moved:?}");
        let angle = equilibrium(pressure_mpa(t_s), evaluation.inputs.values()[PARAMETERS]);
        square += (angle - exact).powi(2) / truth.len() as f64;
    }
    let (low, high) =
        truth.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), a| (l.min(*a), h.max(*a)));
    assert!(square.sqrt() < 0.005 * (high - low), "{} of {}", square.sqrt(), high - low);
}

#[test]
fn model_without_inertia_does_not_move_and_a_cut_inertia_is_refused() {
    let mut model = model();
    let refused = reduce(&model, &database(), &mass("loads.gravity_mm_s2.0"));
    assert!(matches!(refused, Err(TrainError::Database(_))));
    let mut inertia: InertiaModel = model.record(BlockKind::Inertia).expect("its bytes").expect("inertia");
    inertia.regimes[0].mean.pop();
    model.set_record(BlockKind::Inertia, &inertia).expect("a record");
    assert!(ModelMotion::new(&model).is_err());
    model.set_record(BlockKind::Inertia, &1_u8).expect("a record");
    assert!(ModelMotion::new(&model).is_err());
    model.blocks.retain(|(kind, _)| *kind != BlockKind::Inertia);
    assert!(ModelMotion::new(&model).expect("a static model").is_none());
}
