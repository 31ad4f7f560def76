//! Observables of a beam that bends to a circle: closed forms, derivatives by differences, definitions that do not suit.

use crate::synthetic::{self, State};
use rom::evaluator::Evaluator;
use rom::inputs::Inputs;
use rom::model::{BlockData, BlockKind, Model, ModelFileError};
use rom::observable::{Definition, ObservableKind, Observables, Place};
use rom::snapshots::Split;
use std::collections::BTreeMap;
use train::config::{Precision, TrainConfig};

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
    Definition { kind, points: points.iter().map(|at| Place::At(*at)).collect(), axis }
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
                evaluator.differentiate(Inputs::new(pressure_mpa, f64::INFINITY), &mut evaluation);
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
            assert!(observed.halfwidth >= off, "{name}: {} for {off}", observed.halfwidth);
        }
    }
}

#[test]
fn half_width_of_a_position_is_that_of_the_displacement() {
    let model = trained();
    let observables = Observables::of(&model).expect("fits");
    let evaluator = Evaluator::new(&model.header).expect("evaluator");
    let mut evaluation = evaluator.evaluation();
    evaluator.evaluate(Inputs::new(0.05, f64::INFINITY), &mut evaluation);
    let at = observables.names().position(|name| name == "tip_y_mm").expect("defined");
    let found = observables.value(at, &evaluation).halfwidth;
    assert!((found - evaluation.halfwidths.displacement_mm).abs() < 1e-12 * found, "{found}");
}

#[test]
fn definitions_that_do_not_suit_are_refused_by_name() {
    let model = trained();
    let at = |x: f64| Place::At([x, 0.0, 16.0]);
    let wrong = |kind, points: Vec<Place>, axis| Definition { kind, points, axis };
    let refused = [
        ("bending_angle", wrong(ObservableKind::ChordAngle, vec![at(0.0), at(110.0)], None)),
        ("a_deg", wrong(ObservableKind::SectionAngle, vec![at(0.0), at(50.0), at(110.0)], None)),
        ("b_mm", wrong(ObservableKind::Position, vec![at(0.0)], None)),
        ("c_mm", wrong(ObservableKind::Length, vec![at(0.0), at(500.0)], None)),
        ("d_mm", wrong(ObservableKind::Length, vec![at(0.0), Place::Set("nowhere".into())], None)),
        ("e_mm", wrong(ObservableKind::Length, vec![at(0.0), Place::Node(120)], None)),
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
