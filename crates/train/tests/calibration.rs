//! Half-widths from the errors of held-out states.

use crate::synthetic;
use rom::evaluator::Evaluator;
use rom::hull::DomainStatus;
use rom::inputs::{GAP, Inputs, PRESSURE};
use rom::model::Model;
use rom::rng::Rng;
use rom::snapshots::RegimeKind;
use train::calibration::{CalibrationError, MIN_STATES, UnseenState, calibrate};
use train::config::TrainConfig;
use train::datasheet::DataSheet;
use train::train;

fn plate() -> (Model, DataSheet) {
    let config = TrainConfig::default();
    train(&synthetic::plate(), &config, &mut |_| {}).expect("trains")
}

/// States in contact with errors drawn evenly up to a bound that grows tenfold over the pressure range.
fn states(model: &Model, count: usize, seed: u64) -> Vec<UnseenState> {
    let regime = model.regime(RegimeKind::Contact).expect("contact");
    let evaluator = Evaluator::new(&model.header).expect("a model");
    let mut evaluation = evaluator.evaluation();
    let mut random = Rng::new(seed);
    let state = || {
        let along = random.uniform();
        let value = |range: [f64; 2], share: f64| range[0] + share * (range[1] - range[0]);
        let pressure_mpa = value(regime.inputs.range(PRESSURE).expect("a pressure"), along);
        let gap_mm = value(regime.inputs.range(GAP).expect("a gap"), random.uniform());
        let error = (0.1 + 0.9 * along) * random.uniform();
        UnseenState {
            regime: RegimeKind::Contact,
            inputs: Inputs::new(pressure_mpa, gap_mm),
            domain: DomainStatus::Inside,
            errors: [error, 0.01 * error, 0.001 * error].into(),
        }
    };
    let touches = |state: &UnseenState| {
        evaluator.evaluate(state.inputs, &mut evaluation);
        evaluation.regime == RegimeKind::Contact && evaluation.domain == DomainStatus::Inside
    };
    std::iter::repeat_with(state).filter(touches).take(count).collect()
}

#[test]
fn coverage_of_new_states_is_nominal() {
    let (mut model, mut sheet) = plate();
    let before = model.prediction_hash().expect("a hash");
    let seen = states(&model, 400, 11);
    calibrate(&mut model, &mut sheet, &seen).expect("enough states");
    assert_eq!(model.prediction_hash().expect("a hash"), before, "predictions are unchanged");
    let regime = |kind| sheet.regimes.iter().find(|r| r.kind == kind).expect("a regime").unseen_states;
    assert_eq!([regime(RegimeKind::Contact), regime(RegimeKind::Free)], [400, 0]);

    let evaluator = Evaluator::new(&model.header).expect("a model");
    let mut evaluation = evaluator.evaluation();
    let (mut within, mut widths) = ([[0.0; 3]; 2], [0.0; 2]);
    let (mut counts, fresh) = ([0.0; 2], states(&model, 4000, 2));
    let contact = model.regime(RegimeKind::Contact).expect("contact");
    for state in &fresh {
        evaluator.evaluate(state.inputs, &mut evaluation);
        let half = usize::from(contact.inputs.scale(&state.inputs)[0] > 0.5);
        let h = evaluation.halfwidths;
        counts[half] += 1.0;
        widths[half] += h.displacement_mm;
        for (k, limit) in [h.displacement_mm, h.stress_mpa, h.force_n].into_iter().enumerate() {
            within[half][k] += f64::from(u8::from(state.errors.values()[k] <= limit));
        }
    }
    for (quantity, [low, high]) in ["displacement", "stress", "force"].into_iter().zip(transposed(&within)) {
        let all = (low + high) / fresh.len() as f64;
        let [low, high] = [low / counts[0], high / counts[1]];
        println!("{quantity} within: {all:.3}, at low pressures {low:.3}, at high ones {high:.3}");
        // Standard deviation of a coverage of 0.9 from 400 states: 0.015.
        assert!((0.85..0.95).contains(&all) && low > 0.8 && high > 0.8, "{quantity}: {all} {low} {high}");
    }
    assert!(
        widths[1] / counts[1] > 1.8 * widths[0] / counts[0],
        "wider where errors are larger: {widths:?} {counts:?}"
    );
}

fn transposed([a, b]: &[[f64; 3]; 2]) -> [[f64; 2]; 3] {
    [0, 1, 2].map(|k| [a[k], b[k]])
}

#[test]
fn too_few_states_and_invalid_errors_leave_the_model_unchanged() {
    let (mut model, mut sheet) = plate();
    let (before, sheet_before) = (model.to_bytes().expect("encodes"), sheet.clone());
    let few = states(&model, MIN_STATES - 1, 3);
    let found = MIN_STATES - 1;
    assert_eq!(calibrate(&mut model, &mut sheet, &few), Err(CalibrationError::TooFew { found }));
    // States outside the training range do not count.
    let mut outside = states(&model, MIN_STATES, 3);
    outside[0].domain = DomainStatus::Outside;
    assert_eq!(calibrate(&mut model, &mut sheet, &outside), Err(CalibrationError::TooFew { found }));
    let mut wrong = states(&model, MIN_STATES, 3);
    wrong[7].errors.stress_mpa = -1.0;
    assert_eq!(
        calibrate(&mut model, &mut sheet, &wrong),
        Err(CalibrationError::NoError { state: 7, found: -1.0 })
    );
    wrong[7].errors.stress_mpa = f64::NAN;
    assert!(matches!(
        calibrate(&mut model, &mut sheet, &wrong),
        Err(CalibrationError::NoError { state: 7, .. })
    ));
    assert_eq!((model.to_bytes().expect("encodes"), sheet), (before, sheet_before));
}
