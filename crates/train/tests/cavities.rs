//! Two cavities over a plate, one of which lifts the beam: contact begins and ends by either pressure.

use crate::synthetic;
use rom::evaluation::Evaluation;
use rom::evaluator::Evaluator;
use rom::inputs::{Inputs, Parameter};
use rom::rng::Rng;
use rom::snapshots::{Case, Database, RegimeKind, Split};
use train::config::{ModeChoice, TrainConfig};
use train::{OnsetError, TrainError, train};

/// Pressure of one cavity that has the effect of both, by that of `cavity` and of `cavity.other`.
type Effect = fn(f64, f64) -> f64;

fn database(effect: Effect) -> Database {
    database_from(Vec::new(), effect)
}

/// The same, after the given states (pressures in MPa and gap).
fn database_from(mut states: Vec<[f64; 3]>, effect: Effect) -> Database {
    let mut random = Rng::new(5);
    while states.len() < 160 {
        let [a, b, c] = [random.uniform(), random.uniform(), random.uniform()];
        let (p, q) = (0.09 * a, 0.04 * b);
        let gap = if states.len().is_multiple_of(3) { f64::INFINITY } else { 8.0 + 30.0 * c };
        // A state that would touch nothing is a free one.
        let touches = gap.is_infinite() || synthetic::force_n(effect(p, q), gap) > 0.0;
        states.extend(touches.then_some([p, q, gap]));
    }
    let case = |(at, [p, q, gap]): (usize, &[f64; 3])| Case {
        name: at.to_string(),
        regime: if gap.is_finite() { RegimeKind::Contact } else { RegimeKind::Free },
        split: Split::Train,
        pressure_mpa: *p,
        gap_mm: Some(*gap).filter(|gap| gap.is_finite()),
        contact_force_n: if gap.is_finite() { synthetic::force_n(effect(*p, *q), *gap) } else { 0.0 },
        parameters: vec![*q],
    };
    let snapshot = |[p, q, gap]: &[f64; 3]| {
        synthetic::snapshot(effect(*p, *q), Some(*gap).filter(|gap| gap.is_finite()))
    };
    let mut database = Database {
        cases: states.iter().enumerate().map(case).collect(),
        snapshots: states.iter().flat_map(snapshot).collect(),
        parameters: vec![Parameter { name: "pressure_mpa.other".into(), unit: "MPa".into(), nominal: 0.0 }],
        ..synthetic::plate()
    };
    database.hash = database.content_hash();
    database
}

#[test]
fn contact_begins_and_ends_by_the_pressure_of_the_cavity_that_lifts() {
    let (model, _) =
        train(&database(|p, q| p - 0.5 * q), &TrainConfig::default(), &mut |_| {}).expect("trains");
    let evaluator = Evaluator::new(&model.header).expect("consistent");
    let ask = |p: f64, q: f64, gap: f64| -> Evaluation {
        let mut evaluation = evaluator.evaluation();
        evaluator.evaluate(Inputs::new(p, gap).with(2, q), &mut evaluation);
        evaluation
    };
    // 18 mm are touched by the weight alone, the others by pressure.
    for (p, gap) in [(0.001, 18.0), (0.02, 25.0), (0.03, 30.0), (0.044, 34.0)] {
        let lifts_at = 2.0 * (p - synthetic::onset_mpa(gap));
        assert!(lifts_at > 0.002 && lifts_at < 0.04, "{lifts_at}");
        let mut last_n = f64::INFINITY;
        for k in 0..=40 {
            let q = 0.001 * f64::from(k);
            let found = ask(p, q, gap);
            if (q - lifts_at).abs() > 4e-4 {
                let expected = if q < lifts_at { RegimeKind::Contact } else { RegimeKind::Free };
                assert_eq!(found.regime, expected, "{p} MPa, {q} MPa, {gap} mm, lifts at {lifts_at} MPa");
            }
            let truth_n = synthetic::force_n(p - 0.5 * q, gap);
            assert!((found.contact_force_n - truth_n).abs() < 0.01, "{} {truth_n} N", found.contact_force_n);
            assert!(found.contact_force_n <= last_n + 1e-3, "{q}");
            last_n = found.contact_force_n;
        }
    }
}

#[test]
fn first_cavity_that_lifts_is_refused_by_name() {
    let error = train(&database(|p, q| 2.0 * q - 0.3 * p), &TrainConfig::default(), &mut |_| {}).unwrap_err();
    assert!(matches!(error, TrainError::Onset(OnsetError::Lifts { by_mm }) if by_mm > 0.0), "{error}");
}

/// Neither too few modes nor smoothing moves the state without any pressure.
#[test]
fn the_rest_state_of_the_training_is_given_exactly() {
    let data = database_from(vec![[0.0, 0.0, f64::INFINITY]], |p, q| p - 0.5 * q);
    let mut config = TrainConfig::default();
    config.free.modes = ModeChoice::Fixed(1);
    config.free.smoothing = vec![1e-2];
    let (model, _) = train(&data, &config, &mut |_| {}).expect("trains");
    let worst = |case: usize| {
        let report = train::evaluate::evaluate(&model, &data, &[case]).expect("evaluates");
        report.regimes[0].fields.iter().map(|field| field.normalised[2]).fold(0.0, f64::max)
    };
    let (rest, other) = (worst(0), (1..10).map(worst).fold(0.0, f64::max));
    assert!(rest < 1e-5 && other > 1e-3, "rest {rest:.1e}, another state {other:.1e}");
}
