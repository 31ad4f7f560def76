//! The shipped model over pressure, gap and five parameters: its inputs, gradients and what mechanics demands of it.

use rom::evaluation::Evaluation;
use rom::evaluator::{Evaluator, Query};
use rom::hull::DomainStatus;
use rom::inputs::{GAP, Inputs, PRESSURE};
use rom::model::Model;
use rom::snapshots::RegimeKind;

/// Parameters with the ranges in which the model is valid.
const PARAMETERS: [(&str, f64, f64); 5] = [
    ("elastomer.law.mu_mpa", 0.6, 1.0),
    ("chambers.length_mm", 2.6, 3.4),
    ("chambers.width_mm", 13.0, 15.0),
    ("base.lower_mm", 1.6, 2.4),
    ("sheet.thickness_mm", 0.08, 0.12),
];

fn shipped() -> Model {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../models/pneunet-design/pneunet-design.twin");
    Model::from_bytes(&std::fs::read(path).expect("in the repository")).expect("loads")
}

/// A state at shares of all ranges, by golden-ratio steps.
fn state(number: usize) -> Inputs {
    let share = |k: usize| ((number + 1) as f64 * 0.618_033_988_749_895_f64.powi(k as i32 + 1)).fract();
    let inputs = Inputs::new(0.02 + 0.06 * share(0), 12.0 + 35.0 * share(1));
    let parameters = PARAMETERS.iter().enumerate();
    parameters
        .fold(inputs, |inputs, (k, (_, low, high))| inputs.with(2 + k, low + (high - low) * share(2 + k)))
}

fn ask(evaluator: &Evaluator, inputs: Inputs) -> Evaluation {
    let mut evaluation = evaluator.evaluation();
    evaluator.answer(inputs, Query::GRADIENTS, &mut evaluation);
    evaluation
}

#[test]
fn shipped_design_model_has_its_inputs_and_mesh() {
    let model = shipped();
    assert_eq!(model.header.node_count, 25_022);
    let (evaluator, regimes) = (Evaluator::new(&model.header).expect("consistent"), &model.header.regimes);
    for (k, (name, low, high)) in PARAMETERS.iter().enumerate() {
        let position = evaluator.inputs().iter().position(|spec| spec.key() == *name);
        assert_eq!(position, Some(2 + k), "{name}");
        for regime in regimes {
            let [from, to] = regime.inputs.range(2 + k).expect("a range");
            let margin = 0.06 * (high - low);
            assert!(from <= low + margin && to >= high - margin, "{name}: {from} to {to}");
        }
    }
}

#[test]
fn gradients_match_differences() {
    let model = shipped();
    let evaluator = Evaluator::new(&model.header).expect("consistent");
    let steps = [2e-5, 5e-3, 1e-4, 2e-4, 5e-4, 2e-4, 1e-5];
    let mut compared = 0;
    for inputs in (0..200).map(state) {
        let here = ask(&evaluator, inputs);
        if here.domain != DomainStatus::Inside || here.contact_force_n < 0.05 {
            continue;
        }
        for (input, step) in steps.iter().enumerate() {
            let at = |h: f64| {
                let value = inputs.values()[input] + h * step;
                ask(&evaluator, inputs.with(input, value)).contact_force_n
            };
            let central = |h: f64| (at(h) - at(-h)) / (2.0 * h * step);
            let difference = (4.0 * central(0.5) - central(1.0)) / 3.0;
            let found = here.force_gradient[input];
            let scale = 0.01 / step * 1e-4;
            assert!(
                (found - difference).abs() < scale + 1e-4 * difference.abs(),
                "{inputs:?}, {input}: {found}, {difference}"
            );
            compared += 1;
        }
    }
    assert!(compared > 300, "{compared}");
}

#[test]
fn softer_silicone_touches_earlier_with_more_force() {
    let model = shipped();
    let evaluator = Evaluator::new(&model.header).expect("consistent");
    let mut touching = 0;
    for inputs in (0..200).map(state) {
        let here = ask(&evaluator, inputs);
        let softer = ask(&evaluator, inputs.with(2, inputs.values()[2] - 0.05));
        if [&here, &softer]
            .iter()
            .any(|e| e.domain != DomainStatus::Inside || e.regime != RegimeKind::Contact)
        {
            continue;
        }
        assert!(softer.contact_force_n > here.contact_force_n, "{inputs:?}");
        assert!(softer.onset_pressure_mpa < here.onset_pressure_mpa || here.onset_pressure_mpa == Some(0.0));
        assert!(here.force_gradient[PRESSURE] > 0.0 && here.force_gradient[GAP] < 0.0, "{inputs:?}");
        touching += 1;
    }
    assert!(touching > 40, "{touching}");
}
