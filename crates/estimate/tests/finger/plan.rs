//! Predictions of the plan compared with the filter's results.

use crate::model::{Finger, GAP, PRESSURE, Random, STIFFNESS, Truth, setup};
use estimate::{
    Filter, MAX_INPUTS, Measurement, Model, Predicted, Symmetric, choose, expected_fit, information,
};

const READINGS: usize = 200;

/// Pressures from 0 to 0.1 MPa at three gaps.
fn states() -> Vec<[f64; MAX_INPUTS]> {
    let at = |gap: f64, step: usize| {
        let mut inputs = [f64::NAN; MAX_INPUTS];
        (inputs[PRESSURE], inputs[GAP], inputs[STIFFNESS]) = (0.1 * step as f64 / 20.0, gap, 0.8);
        inputs
    };
    [30.0, 40.0, 50.0].into_iter().flat_map(|gap| (0..=20).map(move |step| at(gap, step))).collect()
}

fn holds(blocks: u32) -> Vec<Symmetric> {
    let one =
        |inputs: &[f64; MAX_INPUTS]| information(&setup(true), inputs, READINGS, 1, blocks, &mut Finger);
    states().iter().map(|inputs| one(inputs).expect("finite")).collect()
}

#[test]
fn chosen_holds_have_the_largest_determinant() {
    let setup = setup(true);
    let holds: Vec<Symmetric> = holds(0b11).into_iter().step_by(4).collect();
    let chosen = choose(&setup, &holds, 3);
    let size = |set: &[usize]| {
        let fit = expected_fit(&setup, &holds, set).expect("a covariance");
        let sigma = |at: usize| fit.estimates[at].sigma;
        let c = |a, b| fit.correlation(a, b);
        // ln det of the covariance of three unknowns.
        let of_correlation =
            1.0 + 2.0 * c(0, 1) * c(0, 2) * c(1, 2) - c(0, 1).powi(2) - c(0, 2).powi(2) - c(1, 2).powi(2);
        2.0 * (sigma(0) * sigma(1) * sigma(2)).ln() + of_correlation.ln()
    };
    let least = size(&chosen);
    for a in 0..holds.len() {
        for b in a + 1..holds.len() {
            for c in b + 1..holds.len() {
                assert!(size(&[a, b, c]) > least - 1e-6, "{:?} tells more than {chosen:?}", [a, b, c]);
            }
        }
    }
}

#[test]
fn plan_and_filter_agree_on_identifiability_and_deviations() {
    let setup = setup(true);
    let force = holds(0b1);
    let all: Vec<usize> = (0..force.len()).collect();
    let both = holds(0b11);
    let chosen = choose(&setup, &both, 4);
    let fit_by_both = expected_fit(&setup, &both, &chosen).expect("a covariance");
    let fit_by_force = expected_fit(&setup, &force, &chosen).expect("a covariance");
    assert!(fit_by_both.estimates.iter().all(|estimate| estimate.identifiable), "{fit_by_both:?}");
    assert!(fit_by_both.rank == 3 && fit_by_both.condition < 1e6, "{fit_by_both:?}");
    assert!(fit_by_force.estimates.iter().any(|estimate| !estimate.identifiable), "{fit_by_force:?}");
    assert!(fit_by_force.condition > 10.0 * fit_by_both.condition, "{fit_by_force:?}");
    assert!(expected_fit(&setup, &force, &all).expect("a covariance").rank >= fit_by_force.rank);

    // The same holds, read: the filter's standard deviations are those predicted.
    let truth = Truth { gap: 40.0, bias: 0.0, stiffness: 0.8 };
    let (mut filter, mut random) = (Filter::new(setup).expect("a valid setup"), Random(23));
    let states = states();
    let mut reading = Measurement::at(0.0);
    for inputs in chosen.iter().map(|at| &states[*at]).filter(|inputs| inputs[GAP] == truth.gap) {
        for _ in 0..READINGS {
            reading.t_s += 0.005;
            let mut predicted = [Predicted::default(); 3];
            Finger.predict(inputs, &mut predicted);
            reading.inputs[PRESSURE] = inputs[PRESSURE] + 0.0005 * random.normal();
            for (row, sigma) in [0.005, 0.2, 0.2].into_iter().enumerate() {
                reading.rows[row] = predicted[row].value + sigma * random.normal();
            }
            filter.update(&reading, &mut Finger);
        }
    }
    let own: Vec<usize> = chosen.into_iter().filter(|at| states[*at][GAP] == truth.gap).collect();
    let predicted = expected_fit(filter.setup(), &both, &own).expect("a covariance");
    for (found, predicted) in filter.estimates().zip(&predicted.estimates) {
        let ratio = found.sigma / predicted.sigma;
        assert!((0.8..1.25).contains(&ratio), "{found:?}, predicted {predicted:?}");
    }
    assert!(!own.is_empty());
}
