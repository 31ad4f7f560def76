//! Bad databases and configurations: every problem is named, all of them at once, and nothing is trained.

use crate::synthetic::{self, database, training_states};
use rom::snapshots::{Database, RegimeKind, Split};
use train::config::{KernelKind, KernelSpec, ModeChoice, Tail, TrainConfig};
use train::{TrainError, train};

fn quick() -> TrainConfig {
    let mut config = TrainConfig::default();
    for regime in [&mut config.free, &mut config.contact] {
        regime.kernels = vec![KernelSpec { kernel: KernelKind::Cubic, tail: Tail::Linear }];
    }
    config
}

fn problems(database: &Database) -> Vec<String> {
    match train(database, &quick(), &mut |_| {}) {
        Err(TrainError::Database(problems)) => problems,
        other => panic!("expected problems of the database, found {:?}", other.map(|_| "a model")),
    }
}

#[test]
fn one_nan_is_found_and_located() {
    let mut data = synthetic::plate();
    let at = 3 * data.entries() + 17 * 5 + 4;
    data.snapshots[at] = f32::NAN;
    assert_eq!(problems(&data), ["case 3: 1 non-finite values, the first (NaN) at node 17, field von_mises"]);
}

#[test]
fn all_errors_are_reported_together() {
    let mut data = synthetic::plate();
    data.cases[0].pressure_mpa = -1.0;
    data.cases[1].pressure_mpa = f64::INFINITY;
    data.cases[20].gap_mm = None;
    data.cases[21].contact_force_n = f64::NAN;
    data.snapshots[5] = f32::INFINITY;
    let found = problems(&data);
    assert_eq!(found.len(), 5, "{found:#?}");
    for (problem, part) in found.iter().zip([
        "case 0: pressure",
        "case 1: pressure",
        "case 20:",
        "case 21:",
        "case 0: 1 non-finite",
    ]) {
        assert!(problem.contains(part), "{problem}");
    }
}

#[test]
fn mismatched_counts_are_refused_before_anything_is_read() {
    let mut data = synthetic::plate();
    data.snapshots.truncate(1000);
    data.undeformed_mm.as_mut().expect("mesh").pop();
    data.node_sets[0].nodes.push(999_999);
    let found = problems(&data).join("\n");
    for part in ["snapshots: expected", "found 1000", "mesh: expected 120 nodes, found 119", "node set tip"] {
        assert!(found.contains(part), "{part} is missing in\n{found}");
    }
}

#[test]
fn database_without_training_cases_is_refused() {
    let mut data = synthetic::plate();
    data.cases.iter_mut().for_each(|c| c.split = Split::Test);
    let found = problems(&data);
    assert!(found.len() == 1 && found[0].contains("71"), "{found:?}");
}

#[test]
fn test_and_check_cases_do_not_change_the_model() {
    let data = synthetic::plate();
    let mut other = data.clone();
    let entries = other.entries();
    for (i, case) in data.cases.iter().enumerate().filter(|(_, c)| c.split != Split::Train) {
        other.snapshots[i * entries..(i + 1) * entries].fill(7.0);
        other.cases[i].contact_force_n = case.contact_force_n + 1.0;
    }
    let (a, b) = (train(&data, &quick(), &mut |_| {}), train(&other, &quick(), &mut |_| {}));
    assert_eq!(a.expect("trains").0, b.expect("trains").0);
}

#[test]
fn equal_duplicate_is_merged_and_contradiction_is_refused() {
    let mut states = training_states(9, 5, 5);
    states.push(states[12]);
    let mut data = database(&states);
    let (_, sheet) = train(&data, &quick(), &mut |_| {}).expect("merges");
    let merged = format!("case {} ", data.cases[states.len() - 1].name);
    assert!(sheet.remarks.iter().any(|remark| remark.contains(&merged)), "{:?}", sheet.remarks);
    let last = data.snapshots.len() - data.entries();
    data.snapshots[last..].iter_mut().for_each(|v| *v *= 1.2);
    let (found, last) = (problems(&data), &data.cases[states.len() - 1].name);
    assert!(found.iter().any(|problem| problem.contains(last.as_str())), "{found:?}, {last}");
}

#[test]
fn single_regime_is_trained() {
    let free = database(&training_states(8, 0, 0));
    let (model, sheet) = train(&free, &quick(), &mut |_| {}).expect("trains");
    assert_eq!((model.header.regimes.len(), sheet.sag_mm), (1, None));
    assert!(model.regime(RegimeKind::Contact).is_none());
    let states = training_states(0, 5, 9); // of these, keep the gaps that the weight alone closes
    let touching: Vec<_> = states.into_iter().filter(|s| s.2.is_some_and(|g| g < 20.0)).collect();
    let (model, _) = train(&database(&touching), &quick(), &mut |_| {}).expect("trains");
    assert!(model.regime(RegimeKind::Free).is_none() && model.header.onset.is_none());
}

#[test]
fn two_regimes_without_coordinates_are_refused() {
    let mut data = synthetic::plate();
    data.fields[1].kind = rom::snapshots::FieldKind::Other;
    let error = train(&data, &quick(), &mut |_| {}).expect_err("refused");
    assert!(matches!(error, TrainError::Onset(_)), "{error}");
}

#[test]
fn invalid_configuration_is_refused_with_all_reasons() {
    let mut config = quick();
    config.coverage = 1.5;
    config.hysteresis_mpa = f64::NAN;
    config.free.kernels.clear();
    config.contact.modes = ModeChoice::Fixed(0);
    config.contact.kernels =
        vec![KernelSpec { kernel: KernelKind::Gaussian { shape: -1.0 }, tail: Tail::None }];
    config.contact.smoothing = vec![-1.0];
    let Err(TrainError::Config(found)) = train(&synthetic::plate(), &config, &mut |_| {}) else {
        panic!("refused")
    };
    assert_eq!(found.len(), 6, "{found:#?}");
}

#[test]
fn modes_can_be_fixed_or_chosen_by_energy() {
    for (choice, check) in [(ModeChoice::Fixed(3), 3..=3), (ModeChoice::Energy(1e-8), 1..=8)] {
        let mut config = quick();
        (config.free.modes, config.contact.modes) = (choice, choice);
        let (_, sheet) = train(&synthetic::plate(), &config, &mut |_| {}).expect("trains");
        for group in sheet.regimes.iter().flat_map(|r| &r.groups) {
            assert!(
                check.contains(&group.modes) || group.truncation_error < 1e-12,
                "{}: {}",
                group.name,
                group.modes
            );
            if let ModeChoice::Energy(limit) = choice {
                assert!(group.truncation_error <= limit, "{}: {:e}", group.name, group.truncation_error);
            }
        }
    }
}
