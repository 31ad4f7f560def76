//! Models over parameters of material and geometry, on a beam whose formulas know them.

use crate::synthetic::{self, design};
use rom::evaluation::Evaluation;
use rom::evaluator::{Evaluator, Query};
use rom::hull::DomainStatus;
use rom::inputs::{GAP, Inputs, PRESSURE};
use rom::model::{Model, ModelError, Selection};
use rom::model_state::ModelState;
use rom::snapshots::{Database, RegimeKind, Split};
use std::sync::OnceLock;
use train::config::TrainConfig;
use train::datasheet::DataSheet;
use train::{TrainError, train};

const STATES: usize = 240;

fn database(with_derivatives: bool) -> Database {
    few(STATES, with_derivatives)
}

fn quick() -> TrainConfig {
    TrainConfig::default()
}

fn trained() -> &'static (Model, DataSheet) {
    static MODEL: OnceLock<(Model, DataSheet)> = OnceLock::new();
    MODEL.get_or_init(|| train(&database(false), &quick(), &mut |_| {}).expect("trains"))
}

fn evaluator() -> Evaluator {
    Evaluator::new(&trained().0.header).expect("consistent")
}

fn inputs(state: design::State) -> Inputs {
    Inputs::new(state[0], state[1]).with(2, state[2]).with(3, state[3])
}

fn ask(evaluator: &Evaluator, state: design::State) -> Evaluation {
    let mut evaluation = evaluator.evaluation();
    evaluator.answer(inputs(state), Query::GRADIENTS, &mut evaluation);
    evaluation
}

/// Held-out states in the training range.
fn unseen() -> Vec<design::State> {
    let evaluator = evaluator();
    let inside = |s: &design::State| ask(&evaluator, *s).domain == DomainStatus::Inside;
    design::states(5000, 300).into_iter().filter(inside).collect()
}

#[test]
fn forces_of_held_out_states_are_predicted() {
    let (evaluator, unseen) = (evaluator(), unseen());
    assert!(unseen.len() > 200, "only {} of 300 states lie in the training range", unseen.len());
    let largest = unseen.iter().map(|s| design::force_n(*s)).fold(0.0, f64::max);
    let mut errors: Vec<f64> = unseen
        .iter()
        .map(|s| (ask(&evaluator, *s).contact_force_n - design::force_n(*s)).abs() / largest)
        .collect();
    errors.sort_by(f64::total_cmp);
    let p95 = errors[errors.len() * 95 / 100];
    println!("force: 95th percentile {p95:.2e}, largest {:.2e}", errors[errors.len() - 1]);
    assert!(p95 < 0.005, "{p95}");
}

#[test]
fn onset_follows_the_parameters_and_force_is_zero_there() {
    let evaluator = evaluator();
    let mut compared = 0;
    for state in unseen().into_iter().filter(|s| s[1].is_finite()) {
        let truth = design::onset_mpa(state);
        let found = ask(&evaluator, state).onset_pressure_mpa;
        if (1e-3..0.085).contains(&truth) {
            let found = found.expect("within reach");
            assert!((found - truth).abs() < 2e-4, "{state:?}: {found} is not {truth} MPa");
            let at = |p: f64| ask(&evaluator, [p, state[1], state[2], state[3]]);
            let (before, on) = (at(found.next_down()), at(found));
            assert_eq!((before.regime, on.regime), (RegimeKind::Free, RegimeKind::Contact), "{state:?}");
            assert!(before.contact_force_n == 0.0 && on.contact_force_n < 1e-9, "{}", on.contact_force_n);
            compared += 1;
        }
    }
    assert!(compared > 40, "{compared}");
}

/// Largest jumps of a coordinate (mm) and of stress (share of the state's largest) at the onset, over gaps from the sag to the
/// largest one sampled, and beyond it up to the largest one reached.
fn jumps(model: &Model, parameters: [f64; 2]) -> [[f64; 2]; 2] {
    let mut header = model.header.clone();
    let [stiffness, length] = parameters;
    header
        .set_parameters([("elastomer.law.mu_mpa", stiffness), ("chambers.length_mm", length)])
        .expect("known");
    let given = Model { header, blocks: model.blocks.clone() };
    let state = ModelState::new(&given, &Selection::default()).expect("consistent");
    let (mut below, mut above) = (state.clone(), state);
    let evaluator = Evaluator::new(&given.header).expect("consistent");
    let table = evaluator.onset().expect("two regimes").clone();
    let mut found = [[0.0_f64; 2]; 2];
    for k in 0..200 {
        let gap = table.sag_mm() + (table.reach_mm() - table.sag_mm()) * f64::from(k) / 199.0;
        let mut at = evaluator.evaluation();
        evaluator.evaluate(Inputs::new(0.0, gap), &mut at);
        let Some(onset) = at.onset_pressure_mpa.filter(|p| *p > 0.0) else { continue };
        below.update(Inputs::new(onset.next_down(), gap)).expect("both regimes");
        above.update(Inputs::new(onset, gap)).expect("both regimes");
        if below.evaluation().regime == above.evaluation().regime {
            continue;
        }
        let nodes = given.header.node_count;
        let jump = |field: usize| {
            let range = field * nodes..(field + 1) * nodes;
            let pairs = below.fields()[range.clone()].iter().zip(&above.fields()[range]);
            pairs
                .fold([0.0_f32; 2], |[jump, largest], (a, b)| [jump.max((a - b).abs()), largest.max(b.abs())])
        };
        let found = &mut found[usize::from(gap > 38.0)];
        (0..3).for_each(|field| found[0] = found[0].max(jump(field)[0].into()));
        let [stress, largest] = jump(4);
        found[1] = found[1].max(f64::from(stress / largest));
    }
    found
}

#[test]
fn regimes_are_continuous_at_the_onset() {
    // With onset states evenly spread over pressure and cut at the sampled gaps, each of them jumped beyond one of its bounds.
    for (parameters, bounds) in [
        ([0.8, 3.0], [0.01, 0.003]),
        ([0.9, 3.3], [0.01, 0.006]),
        ([0.9, 2.8], [0.02, 0.005]),
        ([0.7, 2.7], [0.02, 0.015]),
        ([0.7, 3.2], [0.05, 0.02]),
    ] {
        for found in jumps(&trained().0, parameters) {
            println!("{parameters:?}: {found:?}");
            assert!(
                found[0] < bounds[0] && found[1] < bounds[1],
                "{parameters:?}: {found:?} beyond {bounds:?}"
            );
            assert!(found[0] > 0.0, "nothing was compared");
        }
    }
}

#[test]
fn gradients_match_differences_for_all_inputs() {
    let evaluator = evaluator();
    let steps = [2e-5, 5e-3, 1e-4, 2e-4];
    let mut below_the_sag = 0;
    let touching = unseen().into_iter().filter(|s| design::force_n(*s) > 0.05).take(60);
    for state in touching {
        let here = ask(&evaluator, state);
        below_the_sag += usize::from(here.onset_pressure_mpa == Some(0.0));
        for input in 0..4 {
            let at = |share: f64| {
                let mut moved = state;
                moved[input] += share * steps[input];
                ask(&evaluator, moved)
            };
            let sides = [at(0.5), at(-0.5), at(1.0), at(-1.0)];
            let same = |e: &Evaluation| {
                e.onset_pressure_mpa.map(|p| p > 0.0) == here.onset_pressure_mpa.map(|p| p > 0.0)
            };
            if !sides.iter().all(same) {
                continue; // across the sag the second derivative jumps
            }
            let difference = |f: &dyn Fn(&Evaluation) -> f64| {
                let central = |a: usize, h: f64| (f(&sides[a]) - f(&sides[a + 1])) / (2.0 * h * steps[input]);
                (4.0 * central(0, 0.5) - central(2, 1.0)) / 3.0
            };
            let scale = [10.0, 0.01, 1.0, 1.0][input];
            let numeric = difference(&|e| e.contact_force_n);
            let found = here.force_gradient[input];
            assert!(
                (found - numeric).abs() < 1e-5 * scale + 1e-5 * numeric.abs(),
                "{state:?}, {input}: {found} {numeric}"
            );
            let largest = here.coefficient_gradient(input).iter().fold(0.0_f64, |m, v| m.max(v.abs()));
            for k in 0..here.coefficients.len() {
                let numeric = difference(&|e| e.coefficients[k]);
                let found = here.coefficient_gradient(input)[k];
                assert!(
                    (found - numeric).abs() < 1e-4 * largest.max(1e-3),
                    "{state:?}, {input}, {k}: {found} {numeric}"
                );
            }
        }
    }
    assert!(below_the_sag > 5, "{below_the_sag}");
}

#[test]
fn unset_parameters_take_defaults_that_can_be_set_by_name() {
    let mut header = trained().0.header.clone();
    let nominal = Evaluator::new(&header).expect("consistent");
    let plain = |evaluator: &Evaluator| {
        let mut evaluation = evaluator.evaluation();
        evaluator.evaluate(Inputs::new(0.06, 20.0), &mut evaluation);
        evaluation
    };
    let said = ask(&nominal, [0.06, 20.0, 0.8, 3.0]);
    let unsaid = plain(&nominal);
    assert_eq!(said.contact_force_n, unsaid.contact_force_n);
    assert_eq!(unsaid.inputs.values()[..4], [0.06, 20.0, 0.8, 3.0]);
    header.set_parameters([("elastomer.law.mu_mpa", 0.7)]).expect("known");
    let given = Evaluator::new(&header).expect("consistent");
    assert_eq!(plain(&given).contact_force_n, ask(&nominal, [0.06, 20.0, 0.7, 3.0]).contact_force_n);
    // The table shown is that of the values given, and the solver agrees with it.
    let table = given.onset().expect("two regimes");
    assert_eq!(Some(table), header.onset.as_ref());
    assert!((table.sag_mm() - design::depth_mm([0.0, 0.0, 0.7, 3.0])).abs() < 0.05, "{}", table.sag_mm());
    let refused = header.set_parameters([("elastomer.law.mu_mp", 0.7)]).expect_err("unknown");
    assert!(refused.to_string().contains("\"elastomer.law.mu_mpa\""), "{refused}");
    let refused = header.set_parameters([("chambers.length_mm", f64::NAN)]).expect_err("NaN");
    assert!(matches!(refused, ModelError::NotFinite { .. }));
    assert_eq!(header.inputs[2].value, Some(0.7), "nothing was taken from a refused call");
}

/// A model that was loaded also has the shapes that its body can have, which a trained one gets from its file.
fn assert_survives_the_file(model: &Model) {
    let mut loaded = Model::from_bytes(&model.to_bytes().expect("encodes")).expect("loads");
    loaded.header.body = None;
    assert!(loaded == *model, "another model came back");
}

#[test]
fn parameters_survive_the_file() {
    let (model, _) = trained();
    assert_survives_the_file(model);
    let bytes = model.to_bytes().expect("encodes");
    for cut in [100, bytes.len() / 2, bytes.len() - 1] {
        assert!(Model::from_bytes(&bytes[..cut]).is_err());
    }
}

#[test]
fn constant_parameter_is_dropped_and_other_values_are_outside() {
    let mut database = database(false);
    database.cases.iter_mut().for_each(|case| case.parameters[1] = 3.0);
    // The snapshots were made with other lengths: what matters here is which inputs are taken.
    let (model, _) = train(&database, &quick(), &mut |_| {}).expect("trains");
    for regime in &model.header.regimes {
        assert_eq!(regime.inputs.range(3), Some([3.0, 3.0]));
        assert!(regime.inputs.axes.iter().all(|axis| axis.input != 3));
    }
    let evaluator = Evaluator::new(&model.header).expect("consistent");
    assert_eq!(ask(&evaluator, [0.06, 20.0, 0.8, 3.3]).domain, DomainStatus::Outside);
    assert_ne!(ask(&evaluator, [0.06, 20.0, 0.8, 3.0]).domain, DomainStatus::Outside);
}

#[test]
fn inseparable_inputs_are_refused_by_name() {
    let mut database = database(false);
    database.cases.iter_mut().for_each(|case| case.parameters[1] = 1.0 + 2.5 * case.parameters[0]);
    let refused = train(&database, &quick(), &mut |_| {}).expect_err("refused");
    let TrainError::Database(problems) = &refused else { panic!("{refused}") };
    assert!(
        problems[0].contains("elastomer.law.mu_mpa") && problems[0].contains("chambers.length_mm"),
        "{refused}"
    );
}

#[test]
fn irrelevant_and_equivalent_inputs_are_reported() {
    let count = 150;
    let mut database = few(count, false);
    let mut third = rom::inputs::Parameter { name: "sheet.colour".into(), unit: "1".into(), nominal: 0.5 };
    for (i, case) in database.cases.iter_mut().enumerate() {
        case.parameters.push((i as f64 * 0.324_717_957).fract());
    }
    database.parameters.push(third.clone());
    let (_, sheet) = train(&database, &quick(), &mut |_| {}).expect("trains");
    assert!(sheet.remarks.iter().any(|r| r.starts_with("sheet.colour")), "{:?}", sheet.remarks);
    assert!(!sheet.remarks.iter().any(|r| r.starts_with("elastomer.law.mu_mpa")), "{:?}", sheet.remarks);
    // The same softness by two parameters: only their sum is seen.
    third.name = "elastomer.law.twin_mpa".into();
    let mut states = design::states(0, count);
    let shares: Vec<f64> = (0..count).map(|i| (i as f64 * 0.324_717_957).fract()).collect();
    let own: Vec<f64> = states.iter().map(|s| s[2]).collect();
    states.iter_mut().zip(&shares).for_each(|(s, share)| s[2] += 0.2 * (share - 0.5));
    let states: Vec<_> = states.into_iter().map(|s| (Split::Train, s)).collect();
    let mut database = design::database(&states, false);
    for ((case, own), share) in database.cases.iter_mut().zip(own).zip(shares) {
        case.parameters[0] = own;
        case.parameters.push(share);
    }
    database.parameters.push(third);
    let (_, sheet) = train(&database, &quick(), &mut |_| {}).expect("trains");
    let reported = |r: &String| r.contains("mu_mpa") && r.contains("twin_mpa");
    assert!(sheet.remarks.iter().any(reported), "{:?}", sheet.remarks);
}

#[test]
fn pressure_and_gap_keep_their_positions() {
    let (model, _) = trained();
    let keys: Vec<String> = model.header.inputs.iter().map(|i| i.key()).collect();
    assert_eq!(keys, ["pressure_mpa", "gap_mm", "elastomer.law.mu_mpa", "chambers.length_mm"]);
    let contact = model.regime(RegimeKind::Contact).expect("trained");
    let axes: Vec<usize> = contact.inputs.axes.iter().map(|a| a.input).collect();
    assert_eq!(axes, [PRESSURE, GAP, 2, 3]);
}

/// Mean error of contact forces over the largest, on held-out states.
fn force_error(model: &Model) -> f64 {
    let evaluator = Evaluator::new(&model.header).expect("consistent");
    let unseen = unseen();
    let error = |s: &design::State| (ask(&evaluator, *s).contact_force_n - design::force_n(*s)).abs();
    unseen.iter().map(error).sum::<f64>() / unseen.len() as f64 / 1.2
}

fn few(count: usize, with_derivatives: bool) -> Database {
    let states: Vec<_> = design::states(0, count).into_iter().map(|s| (Split::Train, s)).collect();
    design::database(&states, with_derivatives)
}

fn uses_derivatives(sheet: &DataSheet) -> bool {
    let fits = sheet.regimes.iter().flat_map(|r| r.groups.iter().chain(&r.force));
    fits.clone().any(|fit| fit.candidates[0].kernel.ends_with("derivatives"))
}

#[test]
fn derivatives_halve_the_error_of_few_states_and_survive_the_file() {
    let (plain, _) = train(&few(80, false), &quick(), &mut |_| {}).expect("trains");
    let (with, sheet) = train(&few(80, true), &quick(), &mut |_| {}).expect("trains");
    assert!(uses_derivatives(&sheet));
    let errors = [force_error(&plain), force_error(&with)];
    println!("80 states: force without derivatives {:.2e}, with {:.2e} of the largest", errors[0], errors[1]);
    assert!(errors[1] < 0.5 * errors[0], "{errors:?}");
    assert_survives_the_file(&with);
}

#[test]
fn contradictory_derivatives_are_left_out() {
    let mut database = few(80, true);
    let clean = force_error(&train(&database, &quick(), &mut |_| {}).expect("trains").0);
    let known = database.sensitivities.as_mut().expect("made");
    let touching = known.rows.iter().position(|row| row.contact_force_n_per_unit != 0.0 && row.input > 1);
    let case = known.rows[touching.expect("some touch")].case;
    // The tangent of another set of nodes in contact.
    for row in known.rows.iter_mut().filter(|row| row.case == case) {
        row.contact_force_n_per_unit *= -3.0;
    }
    let (model, _) = train(&database, &quick(), &mut |_| {}).expect("trains");
    let spoiled = force_error(&model);
    println!("force: clean {clean:.2e}, one state with other derivatives {spoiled:.2e}");
    assert!(spoiled < 3.0 * clean.max(1e-4), "{spoiled} after {clean}");
}

#[test]
fn derivatives_without_rank_are_accepted() {
    let mut database = few(80, true);
    let known = database.sensitivities.as_mut().expect("made");
    // Stiffness and length act alike as far as the derivatives say, and pressure not at all.
    let entries = known.values.len() / known.rows.len();
    for (row, values) in known.rows.iter_mut().zip(known.values.chunks_exact_mut(entries)) {
        if row.input == 0 {
            row.contact_force_n_per_unit = 0.0;
            values.fill(0.0);
        }
    }
    let (model, _) = train(&database, &quick(), &mut |_| {}).expect("trains");
    assert!(force_error(&model) < 0.05, "{}", force_error(&model));
}

#[test]
fn duplicate_state_with_other_derivatives_is_trained_without_them() {
    let mut states: Vec<_> = design::states(0, 80).into_iter().map(|s| (Split::Train, s)).collect();
    let twice = states.iter().position(|(_, s)| design::force_n(*s) > 0.1).expect("some touch");
    states.push(states[twice]);
    let mut database = design::database(&states, true);
    let known = database.sensitivities.as_mut().expect("made");
    let entries = known.values.len() / known.rows.len();
    let at = known.rows.iter().position(|row| row.case == 80 && row.input == 2).expect("differentiated");
    known.values[at * entries..(at + 1) * entries].iter_mut().for_each(|v| *v *= 2.0);
    let (_, sheet) = train(&database, &quick(), &mut |_| {}).expect("trains");
    let names = [twice, 80].map(|case| database.cases[case].name.as_str());
    let named = sheet.remarks.iter().filter(|r| names.iter().all(|name| r.contains(name))).count();
    assert_eq!(named, 2, "merged, and without derivatives: {:?}", sheet.remarks);
}

/// Nominal coverage of 90 %: overall and in every quarter of pressure and stiffness.
#[test]
fn coverage_is_nominal_in_every_quarter() {
    let evaluator = evaluator();
    let touching: Vec<_> = unseen().into_iter().filter(|s| design::force_n(*s) > 0.0).collect();
    let covered = |s: &design::State| {
        let found = ask(&evaluator, *s);
        (found.contact_force_n - design::force_n(*s)).abs() <= found.halfwidths.force_n
    };
    let share =
        |states: &[design::State]| states.iter().filter(|s| covered(s)).count() as f64 / states.len() as f64;
    let quarter = |high_pressure: bool, stiff: bool| -> Vec<design::State> {
        touching.iter().copied().filter(|s| (s[0] > 0.05) == high_pressure && (s[2] > 0.8) == stiff).collect()
    };
    let quarters: Vec<(usize, f64)> = [(false, false), (false, true), (true, false), (true, true)]
        .map(|(p, q)| quarter(p, q))
        .map(|states| (states.len(), share(&states)))
        .to_vec();
    println!("force covered: {:.3} of {}, by quarter {quarters:?}", share(&touching), touching.len());
    assert!(share(&touching) >= 0.85, "{}", share(&touching));
    assert!(quarters.iter().all(|(count, share)| *count > 10 && *share >= 0.8), "{quarters:?}");
}

/// Cost of an evaluation with two parameters and with derivatives: cargo test -- --nocapture.
#[test]
fn repeated_evaluations_are_equal() {
    let plain = train(&synthetic::plate(), &quick(), &mut |_| {}).expect("trains").0;
    let with = train(&few(80, true), &quick(), &mut |_| {}).expect("trains").0;
    for (name, model) in
        [("pressure and gap", &plain), ("two parameters", &trained().0), ("80 states, derivatives", &with)]
    {
        let evaluator = Evaluator::new(&model.header).expect("consistent");
        let mut evaluation = evaluator.evaluation();
        let at = |i: usize| Inputs::new(0.05 + 1e-5 * i as f64, 20.0);
        // The fastest of many batches: others use this processor too.
        let mut fastest_us = |run: &dyn Fn(Inputs, &mut Evaluation)| {
            let mut batch = |_| {
                let begin = std::time::Instant::now();
                (0..100).for_each(|i| run(at(i), &mut evaluation));
                begin.elapsed().as_secs_f64() * 1e6 / 100.0
            };
            (0..50).map(&mut batch).fold(f64::INFINITY, f64::min)
        };
        let us = fastest_us(&|x, out| evaluator.evaluate(x, out));
        let gradients_us = fastest_us(&|x, out| evaluator.answer(x, Query::GRADIENTS, out));
        let terms = model.regime(RegimeKind::Contact).map_or(0, |r| r.groups[0].surrogate.centre_count());
        println!(
            "{name}: {us:.2} us, {gradients_us:.2} us with all gradients, {} coefficients, {terms} centres",
            evaluation.coefficients.len()
        );
        assert!(evaluation.contact_force_n > 0.0);
    }
}

/// A displacement measured from a mesh that parameters move is not the distance from the nominal one.
#[test]
fn independent_magnitude_is_interpolated_separately() {
    let mut database = few(80, false);
    let derived = |database: &Database| {
        let (model, _) = train(database, &quick(), &mut |_| {}).expect("trains");
        let field =
            model.header.fields.iter().position(|field| field.spec.name == "displacement").expect("there");
        (model.header.fields[field].magnitude_of, model.header.regimes[0].halfwidths.displacement_mm)
    };
    assert_eq!(derived(&database).0, Some([0, 1, 2]));
    // All nodes of the undeformed body lie 1 mm higher for each mm of length beyond the nominal one.
    let mesh = database.undeformed_mm.clone().expect("there");
    for (case, snapshot) in database.cases.iter().zip(database.snapshots.chunks_exact_mut(5 * mesh.len())) {
        let up = case.parameters[1] - 3.0;
        for (node, x0) in snapshot.as_chunks_mut::<5>().0.iter_mut().zip(&mesh) {
            let u = [0, 1, 2].map(|k| f64::from(node[k]) - x0[k] - if k == 1 { up } else { 0.0 });
            node[3] = u.iter().map(|u| u * u).sum::<f64>().sqrt() as f32;
        }
    }
    let (found, halfwidth_mm) = derived(&database);
    assert_eq!(found, None);
    assert!(halfwidth_mm > 0.0 && halfwidth_mm.is_finite(), "{halfwidth_mm}");
    // With the movement of the mesh in the database the displacement is correct again, also on held-out states.
    database.undeformed_by = vec![vec![[0.0; 3]; mesh.len()], vec![[0.0, 1.0, 0.0]; mesh.len()]];
    let (model, _) = train(&database, &quick(), &mut |_| {}).expect("trains");
    let model = Model::from_bytes(&model.to_bytes().expect("writes")).expect("loads");
    assert_eq!(model.header.fields[3].magnitude_of, Some([0, 1, 2]));
    let mut predicted = ModelState::new(&model, &Selection::default()).expect("fits");
    let nodes = mesh.len();
    for state in design::states(500, 20) {
        predicted.update(inputs(state)).expect("trained");
        let fields = predicted.fields();
        for (n, x0) in mesh.iter().enumerate() {
            let moved = [x0[0], x0[1] + state[3] - 3.0, x0[2]];
            let u = [0, 1, 2].map(|k| f64::from(fields[k * nodes + n]) - moved[k]);
            let length = u.iter().map(|u| u * u).sum::<f64>().sqrt();
            let found = f64::from(fields[3 * nodes + n]);
            assert!((found - length).abs() < 1e-3, "node {n} of {state:?}: {found} is not {length} mm");
        }
    }
}
