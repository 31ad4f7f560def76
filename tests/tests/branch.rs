//! A twin that gets the pressure alone, with a model over volumes whose pressure has two limits: it follows the branch.

use rom::inputs::Parameter;
use rom::snapshots::{Case, Database, FieldKind, FieldSpec, Footprint, RegimeKind, Split};
use std::fmt::Write as _;
use tests::wait::{fresh, states, wait_for};
use tests::{Program, Stage, synthetic};
use train::config::TrainConfig;
use wire::layout::{flags, input_source};

/// Limits, as volumes in cm3.
const LIMITS: [f64; 2] = [0.3, 0.7];

/// Rows of the trace: up to 60 kPa and down again in steps of 1 kPa.
const ROWS: u64 = 121;

/// Pressure of a volume.
fn pressure_mpa(cm3: f64) -> f64 {
    let [a, b] = LIMITS;
    2.0 * cm3 * (cm3 * cm3 / 3.0 - 0.5 * (a + b) * cm3 + a * b)
}

/// A beam that bends with the volume in its chamber.
fn model() -> Vec<u8> {
    let volumes = (0..=24).map(|k| f64::from(k) / 24.0);
    let snapshot = |cm3: f64| {
        let node = move |x0: &[f64; 3]| {
            let s = x0[0] / 110.0;
            let u = 40.0 * cm3 * s * s;
            [x0[0], x0[1] - u, x0[2], u, cm3 * (1.0 - s), pressure_mpa(cm3)].map(|v| v as f32)
        };
        synthetic::mesh().iter().flat_map(node).collect::<Vec<f32>>()
    };
    let case = |(at, cm3): (usize, f64)| Case {
        name: at.to_string(),
        regime: RegimeKind::Free,
        split: Split::Train,
        pressure_mpa: 0.0,
        gap_mm: None,
        contact_force_n: 0.0,
        parameters: vec![1000.0 * cm3],
    };
    let pressure = FieldSpec { name: "pressure".into(), unit: "MPa".into(), kind: FieldKind::Other };
    let mut database = Database {
        actuator: "beam".into(),
        fields: FieldSpec::of_the_paper().into_iter().chain([pressure]).collect(),
        node_count: synthetic::NODES,
        cases: volumes.clone().enumerate().map(case).collect(),
        snapshots: volumes.flat_map(snapshot).collect(),
        undeformed_mm: Some(synthetic::mesh()),
        undeformed_by: Vec::new(),
        surface_triangles: vec![[0, 1, 2], [2, 3, 4]],
        node_sets: Vec::new(),
        obstacle: Footprint::PLATE,
        parameters: vec![Parameter { name: "volume_mm3".into(), unit: "mm3".into(), nominal: 0.0 }],
        sensitivities: None,
        vibrations: Vec::new(),
        hash: [0; 32],
    };
    database.hash = database.content_hash();
    let (model, _) = train::train(&database, &TrainConfig::default(), &mut |_| {}).expect("the beam trains");
    model.to_bytes().expect("a model file")
}

#[test]
fn twin_with_the_pressure_alone_jumps_at_both_limits() {
    let stage = Stage::with_model("branch", &model());
    let mut trace = String::from("t_s,pressure_mpa\n");
    let up = (0..=60).map(f64::from);
    for (row, mpa) in up.clone().chain(up.rev().skip(1)).map(|k| 1e-3 * k).enumerate() {
        writeln!(trace, "{},{mpa}", 0.01 * row as f64).unwrap();
    }
    stage.write("trace.csv", &trace);
    // Again and again: a reader or a twin without processor time may miss some states of one pass, but not of all.
    let scene = stage.whole_finger("kind = \"replay\"\ntrace = \"trace.csv\"\nloop = true");
    let twin = Program::twin(&stage, &scene);
    let reader = states(&stage.bus());
    let _bridge = Program::bridge(&stage, &scene);
    let [highest, lowest] = LIMITS.map(pressure_mpa);
    let (mut snapped, mut last, mut has_snapped) = (0, 0, false);
    wait_for(&reader, "more than a pass with states on both branches", |reader| {
        while let Some(state) = reader.next().unwrap() {
            if state.sensor_seq == 0 || !fresh(&state) || state.sensor_seq <= last {
                continue;
            }
            let pass_and_row = |seq: u64| (seq.saturating_sub(1) / ROWS, seq.saturating_sub(1) % ROWS);
            let (pass, row) = pass_and_row(state.sensor_seq);
            has_snapped &= pass == pass_and_row(last).0;
            last = state.sensor_seq;
            let (mpa, cm3) = (state.pressure_mpa, 1e-3 * state.inputs[0]);
            let is_behind = state.flags & flags::SNAPPED != 0;
            assert!((mpa - 1e-3 * row.min(ROWS - 1 - row) as f64).abs() < 1e-9, "row {row}: {mpa} MPa");
            assert!((pressure_mpa(cm3) - mpa).abs() < 2e-5, "{mpa} MPa: {cm3} cm3");
            assert!(if is_behind { cm3 > LIMITS[1] - 0.02 } else { cm3 < LIMITS[0] + 0.02 }, "{mpa}: {cm3}");
            assert_eq!(state.flags & (flags::BRANCH_UNKNOWN | flags::OUTSIDE_DOMAIN), 0, "{state:?}");
            assert_eq!(state.input_sources[0], input_source::MEASURED);
            // Where the model jumps follows from its pressures: up behind the maximum, down behind the minimum. Between them it is on the way
            // down where it has been above in this pass.
            let is_down = row >= ROWS / 2;
            let must_be = mpa > highest + 1e-4 || is_down && has_snapped && mpa > lowest + 1e-4;
            let may_be = mpa > if is_down { lowest } else { highest } - 1e-4;
            assert!(if is_behind { may_be } else { !must_be }, "row {row}, {mpa} MPa: {is_behind}");
            has_snapped |= is_behind;
            snapped += usize::from(is_behind);
        }
        (last >= ROWS && snapped > 20).then_some(())
    });
    let (_, said) = twin.stop();
    let passed = said.iter().filter(|line| line.contains("the pressure has passed a limit")).count();
    assert!(passed >= 2, "{said:?}");
    // The pressure determines the volume only if nothing else is unknown.
    let text = std::fs::read_to_string(&scene).unwrap().replace(
        "[actuator.source]",
        "[actuator.estimate]\npressure_bias_mpa = { prior = 0.0, sigma = 0.001 }\n[actuator.source]",
    );
    let other = stage.write("estimate.toml", &text);
    let (status, said) = Program::daemon(&stage, &["twin", "--scene", other.to_str().unwrap()]).ended();
    let is_named = said.iter().any(|line| line.contains("expected `volume_mm3`"));
    assert!(status.code() == Some(78) && is_named, "{status} {said:?}");
}
