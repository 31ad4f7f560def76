//! Cost of an update in model predictions, and the result if they are used up before the search converges.

use crate::model::{Finger, Random, STIFFNESS, Truth, readings, setup, truth};
use estimate::{Filter, MAX_INPUTS, MAX_PREDICTIONS, Model, Predicted, Status};

/// Finger that counts its predictions.
struct Counted<M> {
    of: M,
    calls: u32,
}

impl<M: Model> Model for Counted<M> {
    fn predict(&mut self, inputs: &[f64; MAX_INPUTS], out: &mut [Predicted]) -> bool {
        self.calls += 1;
        self.of.predict(inputs, out)
    }

    fn predict_free(&mut self, inputs: &[f64; MAX_INPUTS], out: &mut [Predicted]) {
        self.calls += 1;
        self.of.predict_free(inputs, out);
    }

    fn onset_gap_mm(&mut self, inputs: &[f64; MAX_INPUTS]) -> Option<f64> {
        self.of.onset_gap_mm(inputs)
    }
}

#[test]
fn update_takes_one_prediction_and_two_near_the_onset() {
    let mut random = Random(42);
    let mut calls = Vec::new();
    for _ in 0..5 {
        let readings = readings(truth(&mut random), &mut random);
        let mut filter = Filter::new(setup(true)).expect("a valid setup");
        for reading in &readings {
            let mut finger = Counted { of: Finger, calls: 0 };
            let update = filter.update(reading, &mut finger);
            assert!(update.status != Status::Used || update.converged, "{update:?}");
            calls.push(finger.calls);
        }
    }
    calls.sort_unstable();
    let at = |percent: usize| calls[calls.len() * percent / 100];
    assert_eq!((at(50), at(90)), (1, 1), "{:?}", calls.last());
    assert!(at(99) <= 3 && calls.last() <= Some(&MAX_PREDICTIONS), "{} {:?}", at(99), calls.last());
}

/// Finger whose derivatives are five times too large, so that every step is five times too short.
struct Misleading;

impl Model for Misleading {
    fn predict(&mut self, inputs: &[f64; MAX_INPUTS], out: &mut [Predicted]) -> bool {
        let touches = Finger.predict(inputs, out);
        out.iter_mut().flat_map(|row| &mut row.gradient).for_each(|by| *by *= 5.0);
        touches
    }

    fn onset_gap_mm(&mut self, inputs: &[f64; MAX_INPUTS]) -> Option<f64> {
        Finger.onset_gap_mm(inputs)
    }
}

#[test]
fn unconverged_search_is_bounded_and_reported() {
    let truth = Truth { gap: 40.0, bias: 0.0, stiffness: 0.7 };
    let readings = readings(truth, &mut Random(9));
    let mut filter = Filter::new(setup(true)).expect("a valid setup");
    let mut said = 0;
    for reading in &readings {
        let mut finger = Counted { of: Misleading, calls: 0 };
        let update = filter.update(reading, &mut finger);
        assert!(finger.calls <= MAX_PREDICTIONS, "{}", finger.calls);
        said += u32::from(update.status == Status::Used && !update.converged);
    }
    assert!(said > 0, "no search was ended by its bound");
}

/// An unknown at the end of its range stays there while the others are fitted.
#[test]
fn unknown_at_the_end_of_its_range_does_not_bias_the_others() {
    let mut random = Random(21);
    let truth = Truth { gap: 40.0, bias: 0.0005, stiffness: 0.8 };
    let mut setup = setup(true);
    setup.unknowns[STIFFNESS].range = [0.8, 1.3];
    let mut filter = Filter::new(setup).expect("a valid setup");
    let mut most = 0;
    for reading in &readings(truth, &mut random) {
        let mut finger = Counted { of: Finger, calls: 0 };
        filter.update(reading, &mut finger);
        most = most.max(finger.calls);
    }
    let found: Vec<_> = filter.estimates().collect();
    assert!((found[0].value - 40.0).abs() < 0.1 && (found[2].value - 0.8).abs() < 0.01, "{found:?}");
    assert!((found[1].value - 0.0005).abs() < 0.0003 && most < MAX_PREDICTIONS, "{found:?} {most}");
}
