//! Inputs for a goal, on the beam of formulas: the formulas themselves judge the answer.

use crate::synthetic::design;
use rom::evaluator::Evaluator;
use rom::goal::{Residual, Solution, reach};
use rom::inputs::{Inputs, MAX_INPUTS};
use rom::snapshots::Split;
use std::sync::OnceLock;
use train::config::TrainConfig;
use train::train;

fn evaluator() -> Evaluator {
    static MODEL: OnceLock<Evaluator> = OnceLock::new();
    let made = || {
        let states: Vec<_> = design::states(0, 60).into_iter().map(|state| (Split::Train, state)).collect();
        let config = TrainConfig::default();
        let (model, _) = train(&design::database(&states, true), &config, &mut |_| {}).expect("trains");
        Evaluator::new(&model.header).expect("consistent")
    };
    MODEL.get_or_init(made).clone()
}

const WITHIN: [(usize, [f64; 2]); 2] = [(2, [0.6, 1.0]), (3, [2.6, 3.4])];

fn for_force(force_n: f64, within: &[(usize, [f64; 2])]) -> Solution {
    let evaluator = evaluator();
    let mut evaluation = evaluator.evaluation();
    let start = Inputs::new(0.06, 25.0).with(2, 0.8).with(3, 3.0);
    let mut at = |inputs: Inputs| {
        evaluator.evaluate(inputs, &mut evaluation);
        let (value, gradient) = (evaluation.contact_force_n - force_n, evaluation.force_gradient);
        Some(vec![Residual { value, tolerance: 1e-4, gradient }])
    };
    reach(within, start, &mut at).expect("an answer")
}

#[test]
fn force_within_reach_is_found_and_matches_the_formula() {
    for force_n in [0.25, 0.3, 0.35] {
        let found = for_force(force_n, &WITHIN);
        let v = found.inputs.values();
        println!("{force_n} N: {v:?}, {} evaluations", found.evaluations);
        assert!(found.is_met() && (0.6..=1.0).contains(&v[2]) && (2.6..=3.4).contains(&v[3]), "{found:?}");
        assert_eq!([v[0], v[1]], [0.06, 25.0]);
        let truth = design::force_n([v[0], v[1], v[2], v[3]]);
        assert!((truth - force_n).abs() < 0.01 * force_n, "{truth} N, asked for {force_n} N");
    }
}

#[test]
fn unreachable_goal_returns_its_residual_at_the_bound() {
    // Bounds inside the samples: at their edge the model's own maximum may lie a little before it.
    let found = for_force(5.0, &[(2, [0.65, 1.0]), (3, [2.6, 3.3])]);
    assert!(!found.is_met(), "{found:?}");
    let v = found.inputs.values();
    // Softer and longer chambers press more: the best is that corner.
    assert!((v[2] - 0.65).abs() < 1e-9 && (v[3] - 3.3).abs() < 1e-9, "{v:?}");
    let left = found.residuals[0].value;
    assert!((left + 5.0 - design::force_n([v[0], v[1], v[2], v[3]])).abs() < 0.02, "{left}");
}

#[test]
fn several_starts_escape_a_local_minimum() {
    // Two valleys of (x^2 - 1)^2 + tilt: the one that begins nearer is the worse one.
    let mut at = |inputs: Inputs| {
        let x = inputs.values()[0];
        let mut gradient = [[0.0; MAX_INPUTS]; 2];
        (gradient[0][0], gradient[1][0]) = (4.0 * x.powi(3) - 4.0 * x, 0.1);
        let [valley, tilt] = [(x * x - 1.0).powi(2), 0.1 * (x - 1.0)];
        Some(vec![
            Residual { value: valley, tolerance: 1e-3, gradient: gradient[0] },
            Residual { value: tilt, tolerance: 1e-3, gradient: gradient[1] },
        ])
    };
    let found = reach(&[(0, [-2.0, 2.0])], Inputs::new(-1.2, 0.0), &mut at).expect("an answer");
    assert!(found.is_met() && (found.inputs.values()[0] - 1.0).abs() < 0.02, "{found:?}");
}
