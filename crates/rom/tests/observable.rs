//! Observables of a beam that bends to a circle: closed forms, derivatives by differences, definitions that do not suit.

use crate::synthetic::{self, State};
use rom::evaluation::{Evaluation, Refusal};
use rom::evaluator::{Evaluator, Query};
use rom::inputs::Inputs;
use rom::model::{BlockData, BlockKind, Model, ModelFileError, Selection};
use rom::model_state::ModelState;
use rom::observable::{Definition, ObservableKind, Observables, PointSpec};
use rom::probe::{MeshPoint, ProbePosition, Probes};
use rom::rng::Rng;
use rom::snapshots::{Database, FieldSpec, Split};
use std::collections::BTreeMap;
use train::config::{KernelKind, KernelSpec, Precision, Tail, TrainConfig};
use train::measured::{MeasuredError, MeasuredStates};

const LENGTH_MM: f64 = 110.0;
/// Angle of the free end at the largest pressure, radians: beyond 180 degrees.
const LARGEST: f64 = 3.6;

fn angle(pressure_mpa: f64) -> f64 {
    LARGEST * pressure_mpa / 0.09
}

/// The synthetic beam's mesh bent downwards to a circle whose lower fibre keeps its length.
fn circle(pressure_mpa: f64) -> Vec<f32> {
    let curvature = angle(pressure_mpa) / LENGTH_MM;
    let place = |x0: &[f64; 3]| {
        let turned = curvature * x0[0];
        let (x, y) = if curvature > 0.0 {
            let radius = 1.0 / curvature;
            ((radius + x0[1]) * turned.sin(), (radius + x0[1]) * turned.cos() - radius)
        } else {
            (x0[0], x0[1])
        };
        let moved = ((x - x0[0]).powi(2) + (y - x0[1]).powi(2)).sqrt();
        [x, y, x0[2], moved, pressure_mpa].map(|v| v as f32)
    };
    synthetic::mesh().iter().flat_map(place).collect()
}

fn definition(kind: ObservableKind, points: &[[f64; 3]], axis: Option<[f64; 3]>) -> Definition {
    Definition { kind, points: points.iter().map(|at| PointSpec::At(*at)).collect(), axis }
}

fn definitions() -> BTreeMap<String, Definition> {
    let section = |x: f64| [[x, 0.0, 16.0], [x, 15.0, 16.0]];
    let below = |x: f64| [x, 0.0, 16.0];
    let sections = [section(0.0), section(50.0), section(110.0)].concat();
    let line: Vec<[f64; 3]> = (0..12).map(|i| below(f64::from(i) * 10.0)).collect();
    let ends = [below(0.0), below(110.0)];
    let circle = [below(0.0), below(60.0), below(110.0)];
    [
        ("bending_angle_deg", definition(ObservableKind::SectionAngle, &sections, None)),
        ("chord_angle_deg", definition(ObservableKind::ChordAngle, &ends, None)),
        ("curvature_per_mm", definition(ObservableKind::Curvature, &circle, None)),
        ("fibre_mm", definition(ObservableKind::Length, &line, None)),
        ("tip_y_mm", definition(ObservableKind::Position, &ends[1..], Some([0.0, 2.0, 0.0]))),
    ]
    .map(|(name, definition)| (name.to_owned(), definition))
    .into()
}

fn trained() -> Model {
    let states: Vec<State> = (0..40).map(|i| (Split::Train, 0.09 * f64::from(i) / 39.0, None)).collect();
    let mut database = synthetic::database(&states);
    database.snapshots = states.iter().flat_map(|(_, p, _)| circle(*p)).collect();
    database.hash = database.content_hash();
    let config =
        TrainConfig { precision: Precision::F32, observables: definitions(), ..TrainConfig::default() };
    train::train(&database, &config, &mut |_| {}).expect("trains").0
}

#[test]
fn circle_gives_closed_forms_and_derivatives_of_differences() {
    let model = Model::from_bytes(&trained().to_bytes().expect("encodes")).expect("loads");
    let observables = Observables::of(&model).expect("fits");
    let names: Vec<&str> = observables.names().collect();
    let evaluator = Evaluator::new(&model.header).expect("evaluator");
    let mut evaluation = evaluator.evaluation();
    for pressure_mpa in [0.011, 0.043, 0.0871] {
        let turned = angle(pressure_mpa);
        let radius = LENGTH_MM / turned;
        let expected = [
            turned.to_degrees(),
            (turned / 2.0).to_degrees(),
            1.0 / radius,
            22.0 * radius * (turned / 22.0).sin(),
            radius * (turned.cos() - 1.0),
        ];
        for (at, expected) in expected.into_iter().enumerate() {
            let mut value = |pressure_mpa: f64| {
                evaluator.answer(Inputs::new(pressure_mpa, f64::INFINITY), Query::GRADIENTS, &mut evaluation);
                (observables.value(at, &evaluation), observables.gradient(at, &evaluation)[0])
            };
            let (observed, by_pressure) = value(pressure_mpa);
            let name = names[at];
            let close = |a: f64, b: f64| (a - b).abs() <= 2e-4 * b.abs();
            assert!(close(observed.value, expected), "{name}: {} for {expected}", observed.value);
            let step = 1e-6;
            let slope =
                (value(pressure_mpa + step).0.value - value(pressure_mpa - step).0.value) / (2.0 * step);
            assert!(
                (by_pressure - slope).abs() <= 1e-5 * slope.abs() + 1e-4,
                "{name}: {by_pressure} {slope}"
            );
            let off = (observed.value - expected).abs();
            // A half-width holds for nine of ten.
            assert!(1.1 * observed.halfwidth >= off, "{name}: {} for {off}", observed.halfwidth);
        }
    }
}

#[test]
fn half_width_is_at_most_the_bound_and_covers_left_out_states() {
    let model = trained();
    let observables = Observables::of(&model).expect("fits");
    let evaluator = Evaluator::new(&model.header).expect("evaluator");
    let mut evaluation = evaluator.evaluation();
    let bound = Observables::define(&model, &definitions()).expect("defines");
    let (mut covered, mut count) = (0, 0);
    for step in 1..200 {
        let pressure_mpa = 0.09 * f64::from(step) / 200.0;
        evaluator.evaluate(Inputs::new(pressure_mpa, f64::INFINITY), &mut evaluation);
        for (at, name) in observables.names().enumerate() {
            let (found, most) = (observables.value(at, &evaluation), bound.value(at, &evaluation).halfwidth);
            assert!(found.halfwidth <= 1.0001 * most && found.halfwidth > 0.0, "{name}: {found:?} {most}");
            if name == "bending_angle_deg" {
                count += 1;
                covered +=
                    u32::from((found.value - angle(pressure_mpa).to_degrees()).abs() <= found.halfwidth);
            }
        }
    }
    assert!(10 * covered >= 8 * count, "{covered} of {count}");
}

/// A cube with a cubic chamber whose edges grow by this fraction at the largest pressure, and which moves with it.
fn hollow(growth: f64) -> Database {
    let corner = |k: usize| [0, 1, 2].map(|axis| if k >> axis & 1 == 1 { 1.0 } else { -1.0 });
    let chamber_mm = |pressure_mpa: f64| 3.0 * (1.0 + growth * pressure_mpa / 0.09);
    let place = |node: usize, pressure_mpa: f64| -> [f64; 3] {
        let size = if node < 8 { 10.0 } else { chamber_mm(pressure_mpa) };
        corner(node % 8).map(|c| size * c + 20.0 * pressure_mpa)
    };
    let pressures: Vec<f64> = (0..12).map(|i| 0.09 * f64::from(i) / 11.0).collect();
    let values =
        pressures.iter().flat_map(|p| (0..16).flat_map(move |node| place(node, *p).map(|v| v as f32)));
    let fields = FieldSpec::of_the_paper().into_iter().take(3).collect();
    let mut database = Database::free("hollow", fields, &pressures, values.collect());
    database.undeformed_mm = Some((0..16).map(|node| place(node, 0.0)).collect());
    // Two triangles on each face of a cube, normals outwards.
    let faces: [[u32; 4]; 6] =
        [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let cube: Vec<[u32; 3]> = faces.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect();
    let inner = cube.iter().map(|[a, b, c]| [a + 8, c + 8, b + 8]);
    database.surface_triangles = cube.iter().copied().chain(inner).collect();
    database
}

#[test]
fn volume_of_a_chamber_is_the_closed_form_with_its_derivative() {
    let volume = |points| Definition { kind: ObservableKind::Volume, points, axis: None };
    let config = TrainConfig {
        precision: Precision::F32,
        observables: [
            ("all_mm3".to_owned(), volume(vec![])),
            ("one_mm3".into(), volume(vec![PointSpec::Node(9)])),
        ]
        .into(),
        ..TrainConfig::default()
    };
    let model = train::train(&hollow(0.5), &config, &mut |_| {}).expect("trains").0;
    let model = Model::from_bytes(&model.to_bytes().expect("encodes")).expect("loads");
    let observables = Observables::of(&model).expect("fits");
    let evaluator = Evaluator::new(&model.header).expect("evaluator");
    let mut evaluation = evaluator.evaluation();
    for pressure_mpa in [0.01, 0.05, 0.08] {
        evaluator.answer(Inputs::new(pressure_mpa, f64::INFINITY), Query::GRADIENTS, &mut evaluation);
        let growth = 1.0 + 0.5 * pressure_mpa / 0.09;
        let expected = 216.0 * growth.powi(3);
        for at in [0, 1] {
            let found = observables.value(at, &evaluation).value;
            assert!((found / expected - 1.0).abs() < 1e-4, "{found} for {expected}");
            let (slope, by) =
                (observables.gradient(at, &evaluation)[0], 216.0 * 3.0 * growth.powi(2) * 0.5 / 0.09);
            assert!((slope / by - 1.0).abs() < 1e-3, "{slope} for {by}");
        }
    }
    let outside = BTreeMap::from([("v_mm3".to_owned(), volume(vec![PointSpec::Node(3)]))]);
    assert!(Observables::define(&model, &outside).expect_err("no chamber")[0].contains("v_mm3"));
}

#[test]
fn a_chamber_that_would_turn_inside_out_is_refused_by_every_way_of_evaluation() {
    let volume = Definition { kind: ObservableKind::Volume, points: vec![], axis: None };
    let mut config =
        TrainConfig { observables: [("v_mm3".to_owned(), volume)].into(), ..TrainConfig::default() };
    config.free.kernels = vec![KernelSpec { kernel: KernelKind::Cubic, tail: Tail::Linear }];
    let model = train::train(&hollow(-0.7), &config, &mut |_| {}).expect("trains").0;
    let model = Model::from_bytes(&model.to_bytes().expect("encodes")).expect("loads");
    let evaluator = Evaluator::new(&model.header).expect("evaluator");
    let mut restricted = evaluator.clone();
    restricted.restrict(&[]);
    let mut out = evaluator.evaluation();
    for (pressure_mpa, refusal) in [(0.05, None), (0.11, None), (0.17, Some(Refusal::Impossible))] {
        let inputs = Inputs::new(pressure_mpa, f64::INFINITY);
        let calls: [&dyn Fn(&mut Evaluation); 4] = [
            &|out| evaluator.evaluate(inputs, out),
            &|out| evaluator.answer(inputs, Query::GRADIENTS, out),
            &|out| evaluator.answer(inputs, Query::STATE, out),
            &|out| restricted.answer(inputs, Query::STATE, out),
        ];
        for (way, call) in calls.iter().enumerate() {
            call(&mut out);
            assert_eq!(out.flags.refusal, refusal, "{pressure_mpa} MPa, way {way}");
            let is_finite = out.coefficients.iter().all(|c| c.is_finite());
            assert!(is_finite || refusal.is_some(), "{pressure_mpa} MPa");
        }
    }
}

#[test]
fn measured_offset_is_learned_where_measured_and_zero_elsewhere() {
    let mut model = trained();
    let plain = Observables::of(&model).expect("fits");
    let evaluator = Evaluator::new(&model.header).expect("evaluator");
    let mut evaluation = evaluator.evaluation();
    let at = plain.names().position(|name| name == "bending_angle_deg").expect("defined");
    let mut rng = Rng::new(5);
    let offset = |pressure_mpa: f64| 6.0 + 4.0 * (60.0 * pressure_mpa).sin();
    let mut measured = |states: usize, evaluation: &mut Evaluation| -> Vec<(f64, f64)> {
        let mut one = || {
            let pressure_mpa = 0.045 * rng.uniform();
            evaluator.evaluate(Inputs::new(pressure_mpa, f64::INFINITY), evaluation);
            let noise = 0.3 * (rng.uniform() + rng.uniform() + rng.uniform() - 1.5);
            (pressure_mpa, plain.value(at, evaluation).value + offset(pressure_mpa) + noise)
        };
        (0..states).map(|_| one()).collect()
    };
    let rows = measured(300, &mut evaluation);
    let run = MeasuredStates {
        states: rows.iter().map(|(p, _)| Some(Inputs::new(*p, f64::INFINITY))).collect(),
        outputs: vec![rows.iter().map(|(_, v)| *v).collect()],
    };
    let names = ["bending_angle_deg".to_owned()];
    let found = train::measured::correct(&mut model, &names, &[run], &mut Vec::new()).expect("learns");
    assert!(found.modes[0].is_kept || found.offsets[0].is_kept, "{found:?}");
    assert!(found.offsets[0].rms > 5.0 && found.offsets[0].rms_left_out < 0.3, "{found:?}");
    let model = Model::from_bytes(&model.to_bytes().expect("encodes")).expect("loads");
    let observables = Observables::of(&model).expect("fits");
    let rows = measured(200, &mut evaluation);
    let evaluator = Evaluator::new(&model.header).expect("evaluator");
    let mut covered = 0;
    for (pressure_mpa, value) in rows {
        evaluator.evaluate(Inputs::new(pressure_mpa, f64::INFINITY), &mut evaluation);
        let found = observables.value(at, &evaluation);
        assert!((found.offset - offset(pressure_mpa)).abs() < 0.4, "{found:?} {}", offset(pressure_mpa));
        covered += u32::from((found.value - value).abs() <= found.halfwidth);
    }
    assert!((165..=198).contains(&covered), "{covered} of 200");
    let mut value = |pressure_mpa: f64| {
        evaluator.answer(Inputs::new(pressure_mpa, f64::INFINITY), Query::GRADIENTS, &mut evaluation);
        (observables.value(at, &evaluation), observables.gradient(at, &evaluation)[0])
    };
    let (step, (_, slope)) = (1e-6, value(0.02));
    let by = (value(0.02 + step).0.value - value(0.02 - step).0.value) / (2.0 * step);
    assert!((slope / by - 1.0).abs() < 1e-4, "{slope} {by}");
    let ((near, _), (far, _), (outside, _)) = (value(0.02), value(0.089), value(0.118));
    assert!(far.halfwidth > 3.0 * near.halfwidth, "nothing was measured there: {far:?}");
    assert!(outside.offset == 0.0 && outside.halfwidth.is_nan(), "outside the training range: {outside:?}");
}

/// A beam that bends by 14 % more than its model, measured at three quantities over the lower third of the pressures.
#[test]
fn measured_markers_move_the_whole_field_where_measured_and_nowhere_else() {
    let plain = trained();
    let mut model = plain.clone();
    let truth = |pressure_mpa: f64| circle(pressure_mpa * 8.0 / 7.0);
    let mut rng = Rng::new(11);
    let names = ["bending_angle_deg", "curvature_per_mm", "tip_y_mm"].map(str::to_owned);
    let mut run = MeasuredStates { states: Vec::new(), outputs: vec![Vec::new(); 3] };
    for step in 0..120 {
        let pressure_mpa = 0.015 * (1.0 - (0.2 * f64::from(step)).cos());
        let turned = angle(pressure_mpa * 8.0 / 7.0).max(1e-9);
        let radius = LENGTH_MM / turned;
        let mut noise = |width: f64| width * (rng.uniform() - 0.5);
        run.states.push(Some(Inputs::new(pressure_mpa, f64::INFINITY)));
        let values = [
            turned.to_degrees() + noise(0.5),
            1.0 / radius + noise(1e-4),
            radius * (turned.cos() - 1.0) + noise(0.2),
        ];
        run.outputs.iter_mut().zip(values).for_each(|(column, value)| column.push(value));
    }
    let found = train::measured::correct(&mut model, &names, &[run], &mut Vec::new()).expect("learns");
    assert!(
        found.modes[0].is_kept && found.modes[0].rms_left_out_mm < 0.2 * found.modes[0].rms_mm,
        "{found:?}"
    );
    let bytes = model.to_bytes().expect("encodes");
    let loaded = Model::from_bytes(&bytes).expect("loads");
    assert!(loaded.to_bytes().expect("encodes") == bytes, "another model came back");
    let coordinates = synthetic::mesh().len() * 3;
    let fields = |model: &Model, pressure_mpa: f64| {
        let mut state = ModelState::new(model, &Selection::default()).expect("a state");
        state.update(Inputs::new(pressure_mpa, f64::INFINITY)).expect("answers");
        state.fields()[..coordinates].to_vec()
    };
    // The truth has all fields of a node together, a state field after field.
    let exact = |pressure_mpa: f64| -> Vec<f32> {
        let all = truth(pressure_mpa);
        (0..3).flat_map(|axis| all.chunks_exact(5).map(move |node| node[axis])).collect()
    };
    let rms = |a: &[f32], b: &[f32]| {
        let square = a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>();
        (square / a.len() as f64).sqrt()
    };
    for pressure_mpa in [0.008, 0.0173, 0.0261] {
        let (before, after) = (fields(&plain, pressure_mpa), fields(&model, pressure_mpa));
        let exact = exact(pressure_mpa);
        let errors = [rms(&before, &exact), rms(&after, &exact)];
        // Near rest, the modes that the measurements move are those of a bent body and fit less well.
        let share = if pressure_mpa < 0.01 { 0.9 } else { 0.65 };
        assert!(errors[1] < share * errors[0], "{pressure_mpa}: {errors:?}");
    }
    assert_eq!(fields(&plain, 0.118), fields(&model, 0.118), "nothing was measured there");
    // Points of the mesh are those of the field, with its derivatives.
    let node = synthetic::mesh().len() as u32 - 1;
    let probes = Probes::new(&model, &[MeshPoint::node(&model, node).expect("a node")]).expect("probes");
    let (mut scratch, mut at) = (probes.evaluation(), [ProbePosition::default()]);
    let mut place = |pressure_mpa: f64| {
        probes.answer(Inputs::new(pressure_mpa, f64::INFINITY), Query::GRADIENTS, &mut scratch, &mut at);
        (at[0].position_mm[1], at[0].gradient[1][0])
    };
    let (y, slope) = place(0.02);
    let by = (place(0.02 + 1e-6).0 - place(0.02 - 1e-6).0) / 2e-6;
    let field = f64::from(fields(&model, 0.02)[synthetic::mesh().len() + node as usize]);
    assert!((y - field).abs() < 1e-3 && (slope / by - 1.0).abs() < 1e-4, "{y} {field} {slope} {by}");
    // The part of the half-width, and a difference of other lengths.
    let evaluator = Evaluator::new(&model.header).expect("evaluator");
    let mut evaluation = evaluator.evaluation();
    let mut width = |pressure_mpa: f64| {
        evaluator.evaluate(Inputs::new(pressure_mpa, f64::INFINITY), &mut evaluation);
        evaluation.halfwidths.displacement_mm
    };
    assert!(width(0.02) < 0.5 * width(0.09), "{} {}", width(0.02), width(0.09));
    model.header.regimes[0].difference.as_mut().expect("kept").weights.pop();
    assert!(matches!(model.to_bytes(), Err(ModelFileError::Header(_))));
}

#[test]
fn measured_values_of_nothing_in_the_model_are_refused() {
    let (mut model, state) = (trained(), Some(Inputs::new(0.05, f64::INFINITY)));
    let before = model.clone();
    let mut refused = |name: &str, value: f64, states: usize| {
        let run = MeasuredStates { states: vec![state; states], outputs: vec![vec![value; states]] };
        train::measured::correct(&mut model, &[name.to_owned()], &[run], &mut Vec::new())
    };
    let unknown = refused("torsion_deg", 1.0, 50);
    assert!(matches!(unknown, Err(MeasuredError::NoSuchOutput { .. })), "{unknown:?}");
    let few = refused("bending_angle_deg", 1.0, 5);
    assert!(matches!(few, Err(MeasuredError::NoDifference { .. })), "{few:?}");
    assert_eq!(model, before);
}

#[test]
fn definitions_that_do_not_suit_are_refused_by_name() {
    let model = trained();
    let at = |x: f64| PointSpec::At([x, 0.0, 16.0]);
    let wrong = |kind, points: Vec<PointSpec>, axis| Definition { kind, points, axis };
    let refused = [
        ("bending_angle", wrong(ObservableKind::ChordAngle, vec![at(0.0), at(110.0)], None)),
        ("a_deg", wrong(ObservableKind::SectionAngle, vec![at(0.0), at(50.0), at(110.0)], None)),
        ("b_mm", wrong(ObservableKind::Position, vec![at(0.0)], None)),
        ("c_mm", wrong(ObservableKind::Length, vec![at(0.0), at(500.0)], None)),
        ("d_mm", wrong(ObservableKind::Length, vec![at(0.0), PointSpec::Set("nowhere".into())], None)),
        ("e_mm", wrong(ObservableKind::Length, vec![at(0.0), PointSpec::Node(120)], None)),
        ("f_deg", wrong(ObservableKind::ChordAngle, vec![at(0.0), at(110.0)], Some([1.0, 0.0, 0.0]))),
        ("g_deg", wrong(ObservableKind::ChordAngle, vec![at(0.0), at(110.0)], Some([0.0; 3]))),
    ]
    .map(|(name, definition)| (name.to_owned(), definition));
    for (name, definition) in &refused {
        let one = BTreeMap::from([(name.clone(), definition.clone())]);
        let problems = Observables::define(&model, &one).expect_err(name);
        assert!(problems.len() == 1 && problems[0].starts_with(name.as_str()), "{problems:?}");
    }
    let all = Observables::define(&model, &BTreeMap::from(refused)).expect_err("all of them");
    assert_eq!(all.len(), 8);
}

#[test]
fn rows_of_another_model_are_refused() {
    let (mut other, plate) = (trained(), synthetic::plate());
    let (mut model, _) = train::train(&plate, &TrainConfig::default(), &mut |_| {}).expect("trains");
    let record = other.blocks.pop().expect("the record is the last block");
    assert_eq!(record.0, BlockKind::Observables);
    model.blocks.push(record);
    assert!(matches!(Observables::of(&model), Err(ModelFileError::Header(_))));
    model.blocks.pop();
    model.blocks.push((BlockKind::Observables, BlockData::Record(vec![7; 40])));
    assert!(matches!(Observables::of(&model), Err(ModelFileError::Header(_))));
    model.blocks.pop();
    assert_eq!(Observables::of(&model).expect("none").count(), 0);
}
