//! Evaluator and reconstructor on the synthetic actuator: gradients against finite differences, regimes, hysteresis, bad input.

use crate::synthetic;
use proptest::prelude::*;
use rom::branch::BranchState;
use rom::evaluation::{Evaluation, Refusal};
use rom::evaluator::{Evaluator, Query, RegimeLabels};
use rom::halfwidths::HalfWidths;
use rom::hull::DomainStatus;
use rom::inputs::{GAP, Inputs, PRESSURE};
use rom::model::{Model, PressureLimit, Selection};
use rom::model_state::ModelState;
use rom::regime::LastOnset;
use rom::snapshots::{FieldKind, RegimeKind, Split};
use std::sync::OnceLock;
use train::config::{KernelKind, KernelSpec, Tail, TrainConfig};
use train::train;

fn config(kernel: KernelKind, tail: Tail) -> TrainConfig {
    let mut config = TrainConfig::default();
    for regime in [&mut config.free, &mut config.contact] {
        regime.kernels = vec![KernelSpec { kernel, tail }];
        regime.smoothing = vec![1e-9]; // differences need values without the noise of an ill-conditioned system
    }
    config
}

fn model() -> &'static Model {
    static MODEL: OnceLock<Model> = OnceLock::new();
    MODEL.get_or_init(|| {
        train(&synthetic::plate(), &config(KernelKind::Cubic, Tail::Linear), &mut |_| {}).expect("trains").0
    })
}

fn evaluator() -> Evaluator {
    Evaluator::new(&model().header).expect("consistent")
}

fn state() -> ModelState {
    ModelState::new(model(), &Selection::default()).expect("fits")
}

fn ask(evaluator: &Evaluator, pressure_mpa: f64, gap_mm: f64) -> Evaluation {
    let mut evaluation = evaluator.evaluation();
    evaluator.answer(Inputs::new(pressure_mpa, gap_mm), Query::GRADIENTS, &mut evaluation);
    evaluation
}

/// Central difference with one Richardson step: fourth order, good to 1e-8 where the function is smooth.
fn difference(f: impl Fn(f64) -> f64, x: f64, h: f64) -> f64 {
    let central = |h: f64| (f(x + h) - f(x - h)) / (2.0 * h);
    (4.0 * central(h / 2.0) - central(h)) / 3.0
}

fn close(name: &str, analytic: f64, numeric: f64, scale: f64) {
    assert!(
        (analytic - numeric).abs() <= 1e-6 * scale.abs().max(analytic.abs()),
        "{name}: {analytic} is not {numeric}"
    );
}

#[test]
fn gradients_agree_with_finite_differences_for_every_kernel() {
    let kernels = [
        (KernelKind::ThinPlate, Tail::Linear),
        (KernelKind::Cubic, Tail::Linear),
        (KernelKind::Quintic, Tail::Quadratic),
        (KernelKind::Gaussian { shape: 8.0 }, Tail::Constant),
        (KernelKind::Matern72 { length: 1.5 }, Tail::Linear),
        (KernelKind::CubicQuintic { crossover: 0.2 }, Tail::Quadratic),
    ];
    for (kernel, tail) in kernels {
        let (model, _) = train(&synthetic::plate(), &config(kernel, tail), &mut |_| {}).expect("trains");
        let evaluator = Evaluator::new(&model.header).expect("consistent");
        for (p, gap) in [(0.0613, 17.27), (0.0471, 28.61), (0.0331, 12.13), (0.085, 57.31)] {
            let here = ask(&evaluator, p, gap);
            assert_eq!(here.regime, RegimeKind::Contact);
            let at = |p: f64, gap: f64| ask(&evaluator, p, gap);
            let name = kernel.name();
            // Long smooth kernels have large weights that cancel: a difference needs a step above their rounding.
            let step = if matches!(kernel, KernelKind::Matern72 { .. }) { 30.0 } else { 1.0 };
            let (by_p, by_gap) = (1e-5 * step, 1e-3 * step);
            close(
                name,
                here.force_by_pressure_n_per_mpa(),
                difference(|p| at(p, gap).contact_force_n, p, by_p),
                1.0,
            );
            close(
                name,
                here.force_by_gap_n_per_mm(),
                difference(|g| at(p, g).contact_force_n, gap, by_gap),
                1e-2,
            );
            let largest = |v: &[f64]| v.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
            let (scale_p, scale_gap) =
                (largest(here.coefficient_gradient(PRESSURE)), largest(here.coefficient_gradient(GAP)));
            for k in 0..here.coefficients.len() {
                let numeric = difference(|p| at(p, gap).coefficients[k], p, by_p);
                close(name, here.coefficient_gradient(PRESSURE)[k], numeric, scale_p);
                let numeric = difference(|g| at(p, g).coefficients[k], gap, by_gap);
                close(name, here.coefficient_gradient(GAP)[k], numeric, scale_gap);
            }
        }
    }
}

#[test]
fn onset_matches_the_formula_without_onset_data() {
    let table = model().header.onset.as_ref().expect("two regimes");
    assert!((table.sag_mm() - synthetic::sag_mm(0.0)).abs() < 0.02, "{} mm", table.sag_mm());
    for gap in [22.0, 30.0, 45.0, 58.0] {
        let found = table.onset(gap).pressure_mpa().expect("within reach");
        assert!((found - synthetic::onset_mpa(gap)).abs() < 1e-4, "gap {gap} mm: {found} MPa");
    }
}

#[test]
fn gap_below_sag_is_contact_and_gap_beyond_reach_is_free() {
    let evaluator = evaluator();
    let touching = ask(&evaluator, 0.0, 15.0);
    assert_eq!((touching.regime, touching.onset_pressure_mpa), (RegimeKind::Contact, Some(0.0)));
    assert!(touching.contact_force_n > 0.0);
    let free = ask(&evaluator, 0.09, 80.0);
    assert_eq!((free.regime, free.onset_pressure_mpa), (RegimeKind::Free, None));
    assert_eq!((free.contact_force_n, free.force_gradient), (0.0, [0.0; 8]));
    assert_eq!(ask(&evaluator, 0.05, f64::INFINITY).regime, RegimeKind::Free);
}

#[test]
fn hysteresis_holds_the_label_but_not_the_values() {
    let evaluator = evaluator();
    let mut labels = RegimeLabels::new(&evaluator);
    let onset = model().header.onset.as_ref().expect("two").onset(30.0).pressure_mpa().expect("reach");
    let margin = model().header.hysteresis_mpa;
    let mut evaluation = evaluator.evaluation();
    let mut say = |offset: f64| {
        evaluator.answer(Inputs::new(onset + offset * margin, 30.0), Query::STATE, &mut evaluation);
        let label = labels.next(&evaluation);
        (label.regime, evaluation.regime, label.held)
    };
    use RegimeKind::{Contact, Free};
    assert_eq!(say(-0.5), (Free, Free, false));
    assert_eq!(say(0.1), (Contact, Contact, false));
    for _ in 0..10 {
        assert_eq!(say(-0.4), (Contact, Free, true), "noise below the onset keeps the label");
        assert_eq!(say(0.4), (Contact, Contact, false));
    }
    assert_eq!(say(-1.1), (Free, Free, false), "a real release drops it");
}

/// `state` and `complete` together are bit-identical to `evaluate`; a part of the fields is bit-identical too.
#[test]
fn state_and_complete_are_bit_identical_to_evaluate() {
    let evaluator = evaluator();
    let stress = model().header.fields.iter().position(|field| field.spec.kind == FieldKind::Stress).unwrap();
    let mut restricted = evaluator.clone();
    restricted.restrict(&[stress]);
    let (mut whole, mut parts, mut some) =
        (evaluator.evaluation(), evaluator.evaluation(), evaluator.evaluation());
    for inputs in [Inputs::new(0.06, 20.0), Inputs::new(0.02, f64::INFINITY), Inputs::new(0.11, 9.0)] {
        evaluator.evaluate(inputs, &mut whole);
        evaluator.answer(inputs, Query::STATE, &mut parts);
        assert!(parts.coefficients.is_empty() && !whole.coefficients.is_empty());
        // As text: outside the training range half-widths are NaN.
        let small = |e: &Evaluation| {
            format!("{:?}", (e.contact_force_n, e.force_gradient, e.halfwidths, e.domain_distance, e.flags))
        };
        assert_eq!(small(&parts), small(&whole));
        evaluator.complete(&mut parts);
        assert_eq!(parts.coefficients, whole.coefficients);
        restricted.evaluate(inputs, &mut some);
        let regime = model().header.regimes.iter().find(|regime| regime.kind == whole.regime).unwrap();
        // One coefficient by itself would be summed in another order: it keeps those it is summed with.
        let own = regime.groups.iter().find(|group| group.fields.contains(&stress)).unwrap();
        for group in &regime.groups {
            let range = group.coefficients.clone();
            let same = some.coefficients[range.clone()] == whole.coefficients[range];
            assert_eq!(same, group.fields.contains(&stress) || own.coefficients.len() == 1, "{}", group.name);
        }
    }
}

/// A regime that was not trained has no coefficients, whatever the evaluation held before.
#[test]
fn states_of_an_untrained_regime_have_no_coefficients() {
    type Call<'a> = &'a dyn Fn(Inputs, &mut Evaluation);
    let mut header = model().header.clone();
    header.regimes.retain(|regime| regime.kind == RegimeKind::Free);
    let evaluator = Evaluator::new(&header).expect("consistent");
    let (free, contact) = (Inputs::new(0.02, f64::INFINITY), Inputs::new(0.06, 20.0));
    let mut out = evaluator.evaluation();
    let calls: [Call<'_>; 3] = [
        &|inputs, out| evaluator.evaluate(inputs, out),
        &|inputs, out| evaluator.answer(inputs, Query::GRADIENTS, out),
        &|inputs, out| {
            evaluator.answer(
                inputs,
                Query { range: false, near: Some(&mut LastOnset::default()), ..Query::GRADIENTS },
                out,
            )
        },
    ];
    for call in calls {
        call(free, &mut out);
        assert!(!out.coefficients.is_empty());
        evaluator.answer(free, Query::GRADIENTS, &mut out);
        call(contact, &mut out);
        assert_eq!(out.regime, RegimeKind::Contact);
        assert!(out.coefficients.is_empty() && out.coefficient_gradient(0).is_empty());
    }
    evaluator.evaluate(contact, &mut out);
    assert!(out.halfwidths.displacement_mm.is_nan());
}

#[test]
fn locating_a_state_leaves_coefficients_and_clears_the_force() {
    let (evaluator, contact) = (evaluator(), Inputs::new(0.06, 20.0));
    let mut out = evaluator.evaluation();
    evaluator.evaluate(contact, &mut out);
    let before = out.clone();
    assert!(before.contact_force_n > 0.0);
    evaluator.answer(contact, Query::REGIME, &mut out);
    assert_eq!((out.regime, out.domain, out.contact_force_n), (before.regime, before.domain, 0.0));
    assert_eq!(out.coefficients, before.coefficients);
    assert!(out.halfwidths.displacement_mm.is_nan(), "half-widths are those of an evaluation");
}

#[test]
fn training_range_is_the_convex_hull() {
    let evaluator = evaluator();
    assert_eq!(ask(&evaluator, 0.05, 20.0).domain, DomainStatus::Inside);
    let corner = ask(&evaluator, 0.09, 8.2); // inside the box of the samples, outside their sheared hull
    assert_ne!(corner.domain, DomainStatus::Inside);
    assert!(corner.flags.extrapolated && corner.domain_distance > 0.0);
    assert_eq!(ask(&evaluator, 0.15, 20.0).domain, DomainStatus::Outside);
}

#[test]
fn outside_the_training_range_nothing_is_said_about_the_error_and_the_input_is_named() {
    let evaluator = evaluator();
    let inside = ask(&evaluator, 0.05, 20.0);
    assert!(inside.halfwidths.displacement_mm > 0.0 && evaluator.outside(&inside).is_none());
    for (pressure_mpa, domain) in [(0.091, DomainStatus::Near), (0.11, DomainStatus::Outside)] {
        let found = ask(&evaluator, pressure_mpa, 20.0);
        let HalfWidths { coverage, displacement_mm, stress_mpa, force_n } = found.halfwidths;
        assert_eq!(found.domain, domain);
        assert!(
            [coverage, displacement_mm, stress_mpa, force_n].iter().all(|width| width.is_nan()),
            "{domain}"
        );
        assert!(found.contact_force_n > 0.0, "an extrapolation has its value");
        let why = evaluator.outside(&found).expect("it is outside");
        assert!(why.contains("pressure_mpa") && why.contains("0.09 MPa"), "{why}");
        let (input, by) = evaluator.farthest_outside(&found).expect("the pressure");
        assert!(input == PRESSURE && (by - (pressure_mpa - 0.09)).abs() < 1e-9, "{input} {by}");
    }
    assert_eq!(evaluator.farthest_outside(&inside), None);
    let (input, by) = evaluator.farthest_outside(&ask(&evaluator, 0.05, 6.0)).expect("the gap");
    assert!(input == GAP && by < 0.0, "{input} {by}");
    // In the box of the samples, not in their hull: no single input is to blame.
    let why = evaluator.outside(&ask(&evaluator, 0.09, 8.2)).expect("it is outside");
    assert!(why.contains("pressure_mpa") && why.contains("gap_mm"), "{why}");
    // Farther outside than the samples are wide there are no numbers.
    let far = ask(&evaluator, 5.0, 20.0);
    assert!(
        far.flags.refusal == Some(Refusal::TooFar)
            && far.contact_force_n.is_nan()
            && far.coefficients.iter().all(|a| a.is_nan())
    );
    let searching = evaluator.for_search();
    assert!(ask(&searching, 5.0, 20.0).contact_force_n.is_finite(), "the steps of a search go on");
}

#[test]
fn a_body_stretched_beyond_its_limit_is_refused_outside_and_the_limit_is_named() {
    let mut model = model().clone();
    let reason = "the silicone ends here".to_owned();
    model.header.limit = Some(PressureLimit { pressure_mpa: 0.09, reason, stretch: 1.0 });
    let model = Model::from_bytes(&model.to_bytes().expect("encodes")).expect("loads");
    let mut state = ModelState::new(&model, &Selection::default()).expect("fits");
    state.update(Inputs::new(0.05, 20.0)).expect("a trained state");
    assert_eq!(state.update(Inputs::new(0.15, 20.0)), Err(Refusal::Impossible.into()));
    let why = state.evaluator().refusal(state.evaluation()).expect("it is refused");
    assert!(why.contains("the silicone ends here"), "{why}");
}

#[test]
fn nan_inputs_are_flagged_without_panic() {
    let mut state = state();
    for (p, gap) in [(f64::NAN, 20.0), (0.05, f64::NAN), (f64::INFINITY, 20.0), (-1.0, 20.0), (0.05, -1e300)]
    {
        assert_eq!(state.update(Inputs::new(p, gap)), Err(Refusal::TooFar.into()), "({p}, {gap})");
        let evaluation = state.evaluation();
        assert_eq!(evaluation.domain, DomainStatus::Outside, "({p}, {gap})");
        assert!(evaluation.flags.extrapolated, "({p}, {gap})");
    }
}

#[test]
fn test_states_are_predicted() {
    let database = synthetic::plate();
    let cases: Vec<usize> = database.of_split(Split::Test).collect();
    let report = train::evaluate::evaluate(model(), &database, &cases).expect("evaluates");
    assert_eq!(report.cases.len(), 3);
    for case in &report.cases {
        for field in &case.fields {
            assert!(field.normalised < 5e-3, "case {}, {}: {}", case.case, field.field, field.normalised);
            if let (Some(t), Some(i)) = (field.truncation_max, field.interpolation_max) {
                assert!(field.max <= t + i + 1e-5, "{}: {} > {t} + {i}", field.field, field.max);
            }
        }
        assert!((case.force_n - case.force_true_n).abs() < 2e-3, "case {}", case.case);
    }
}

#[test]
fn halfwidths_follow_the_error_and_are_positive_in_contact() {
    let evaluator = evaluator();
    let contact = model().regime(RegimeKind::Contact).expect("contact");
    let everywhere = contact.halfwidths;
    let (mut least, mut most) = (f64::INFINITY, 0.0_f64);
    for i in 0..=20 {
        for j in 0..=20 {
            let found = ask(&evaluator, 0.0045 * f64::from(i), 8.0 + 1.6 * f64::from(j));
            if found.regime == RegimeKind::Contact && found.domain == DomainStatus::Inside {
                let halfwidths = found.halfwidths;
                assert!(halfwidths.force_n > 0.0 && halfwidths.coverage == everywhere.coverage, "{found:?}");
                least = least.min(halfwidths.displacement_mm);
                most = most.max(halfwidths.displacement_mm);
            }
        }
    }
    assert!(least < everywhere.displacement_mm && everywhere.displacement_mm < most, "{least} .. {most} mm");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn stress_and_force_are_never_negative(p in 0.0..0.12_f64, gap in 0.0..90.0_f64) {
        let mut state = state();
        state.update(Inputs::new(p, gap)).expect("length");
        prop_assert!(state.evaluation().contact_force_n >= 0.0);
        prop_assert!(state.fields()[4 * state.reconstructor().rows()..].iter().all(|s| *s >= 0.0));
    }

    #[test]
    fn displacement_is_the_distance_from_the_undeformed_mesh(p in 0.0..0.09_f64, gap in 8.0..60.0_f64) {
        let mut state = state();
        state.update(Inputs::new(p, gap)).expect("length");
        let (n, out) = (state.reconstructor().rows(), state.fields());
        for (i, x0) in synthetic::mesh().iter().enumerate() {
            let square: f64 = (0..3).map(|axis| (f64::from(out[axis * n + i]) - x0[axis]).powi(2)).sum();
            prop_assert!((f64::from(out[3 * n + i]) - square.sqrt()).abs() < 1e-4, "node {}", i);
        }
    }
}

/// Behind the last limit the evaluation is that of the limit, where the model is known; the state is not.
#[test]
fn state_behind_the_last_limit_has_no_half_width() {
    let mut evaluation = ask(&evaluator(), 0.05, 20.0);
    assert!(evaluation.domain == DomainStatus::Inside && evaluation.halfwidths.displacement_mm > 0.0);
    let behind =
        BranchState { pressure_mpa: 0.06, volume_mm3: 1.0, branch: 0, is_behind: true, is_unknown: false };
    behind.apply_to(&mut evaluation);
    assert!(evaluation.domain == DomainStatus::Outside && evaluation.flags.extrapolated);
    let widths = evaluation.halfwidths;
    assert!([widths.force_n, widths.displacement_mm, widths.stress_mpa].iter().all(|width| width.is_nan()));
}
