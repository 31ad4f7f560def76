//! Regimes with names of the user's own: one set of modes for each, a boundary that decides between them.

use rom::evaluator::Evaluator;
use rom::hull::DomainStatus;
use rom::inputs::{Inputs, PARAMETERS};
use rom::model::{Model, ModelFileError, Selection, VERSION};
use rom::model_state::ModelState;
use rom::names::MAX_REGIMES;
use rom::snapshots::{Database, RegimeKind, Split};
use rom::synthetic::{self, strip};
use std::sync::OnceLock;
use train::config::{KernelKind, KernelSpec, Tail, TrainConfig};
use train::datasheet::DataSheet;
use train::evaluate::{DEFAULT_FLOOR, EvaluateError, evaluate};
use train::{TrainError, train};

fn config() -> TrainConfig {
    let mut config = TrainConfig { full_leave_one_out: false, ..TrainConfig::default() };
    let kernel = |kernel, tail| KernelSpec { kernel, tail };
    config.free.kernels =
        vec![kernel(KernelKind::Linear, Tail::Constant), kernel(KernelKind::Cubic, Tail::Linear)];
    config
}

fn data() -> Database {
    strip::database(&strip::states(120))
}

fn trained() -> &'static (Model, DataSheet) {
    static TRAINED: OnceLock<(Model, DataSheet)> = OnceLock::new();
    TRAINED.get_or_init(|| train(&data(), &config(), &mut |_| {}).expect("trains"))
}

fn at(load_n: f64, imperfection_mm: f64) -> Inputs {
    Inputs::new(0.0, f64::INFINITY).with(PARAMETERS, load_n).with(PARAMETERS + 1, imperfection_mm)
}

fn refused(database: &Database) -> String {
    match train(database, &config(), &mut |_| {}) {
        Err(TrainError::Database(problems)) => problems.join("\n"),
        other => panic!("expected problems of the database, found {:?}", other.map(|_| "a model")),
    }
}

#[test]
fn states_held_back_are_found_in_their_regime_with_its_fields() {
    let (model, sheet) = trained();
    let data = data();
    let tests: Vec<usize> = data.of_split(Split::Test).collect();
    let report = evaluate(model, &data, &tests, DEFAULT_FLOOR).expect("evaluates");
    let names: Vec<&str> = report.regimes.iter().map(train::evaluate::Summary::name).collect();
    assert_eq!(names, strip::REGIMES);
    for summary in &report.regimes {
        assert!(summary.cases >= 4, "{}", summary.cases);
        assert!(
            summary.in_regime.is_some_and(|share| share >= 0.8),
            "{}: {:?}",
            summary.name(),
            summary.in_regime
        );
    }
    for case in
        report.cases.iter().filter(|case| case.regime == case.sampled && case.domain != DomainStatus::Outside)
    {
        let height = &case.fields[1];
        assert!(height.max < 0.05, "case {}: y is {} mm off", case.case, height.max);
    }
    let border = sheet.border.as_ref().expect("three regimes");
    assert_eq!(border.states, data.of_split(Split::Train).count());
    assert!((border.wrong_share - border.wrong.len() as f64 / border.states as f64).abs() < 1e-12);
    assert!(border.wrong_share < 0.2, "{}", border.wrong_share);
    for wrong in &border.wrong {
        assert!(
            wrong.regime != wrong.assigned && strip::REGIMES.contains(&wrong.assigned.as_str()),
            "{wrong:?}"
        );
    }
}

#[test]
fn training_states_are_in_their_own_regime_and_those_at_the_boundary_are_marked() {
    let (model, _) = trained();
    let evaluator = Evaluator::new(&model.header).expect("consistent");
    let (data, mut out) = (data(), evaluator.evaluation());
    for i in data.of_split(Split::Train) {
        evaluator.evaluate(data.cases[i].inputs(), &mut out);
        assert_eq!(out.regime, data.cases[i].regime, "case {}", data.cases[i].name);
    }
    // Between the sides, far from the load at which it buckles: at some imperfection the scores are the same.
    let (mut near, mut sides) = (0, Vec::new());
    for step in 0..=400 {
        evaluator.evaluate(at(16.0, -0.2 + 0.001 * f64::from(step)), &mut out);
        near += usize::from(out.domain == DomainStatus::Near);
        sides.push(out.regime);
    }
    assert!((1..200).contains(&near), "{near} of 401 states are near the boundary");
    assert_eq!((sides[0], sides[400]), (RegimeKind::Named(2), RegimeKind::Named(1)));
    assert!(sides.windows(2).filter(|pair| pair[0] != pair[1]).count() == 1, "{sides:?}");
    assert_eq!(evaluator.regime_name(sides[0]), "down");
    assert_eq!((out.contact_force_n, out.onset_pressure_mpa), (0.0, None));
    evaluator.evaluate(at(f64::NAN, 0.1).with(PARAMETERS, f64::INFINITY), &mut out);
    assert_eq!(out.domain, DomainStatus::Outside);
}

#[test]
fn the_file_has_a_version_of_its_own_and_survives_the_round_trip() {
    let (model, _) = trained();
    let bytes = model.to_bytes().expect("encodes");
    assert_eq!(bytes[8..12], VERSION.to_le_bytes());
    assert_eq!(*model, Model::from_bytes(&bytes).expect("loads"));
}

/// A kept file, and what it answered: `SOFTTWIN_KEEP=1 cargo test -p rom --test regimes` writes both anew.
#[test]
fn a_kept_model_is_read_and_answers_as_it_did() {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../rom/tests/data/version6.twin");
    if std::env::var_os("SOFTTWIN_KEEP").is_some() {
        let (model, _) = train(&strip::database(&strip::states(40)), &config(), &mut |_| {}).expect("trains");
        std::fs::write(&path, model.to_bytes().expect("encodes")).expect("written");
        std::fs::write(path.with_extension("txt"), answers(&model).join("\n")).expect("written");
    }
    let bytes = std::fs::read(&path).expect("SOFTTWIN_KEEP=1 writes it; commit it");
    assert_eq!(bytes[8..12], 6_u32.to_le_bytes());
    let kept = std::fs::read_to_string(path.with_extension("txt")).expect("beside the model");
    for (found, kept) in answers(&Model::from_bytes(&bytes).expect("loads")).iter().zip(kept.lines()) {
        let [(name, value), (kept_name, kept_value)] =
            [found.as_str(), kept].map(|line| line.split_once(' ').expect("a name and a number"));
        let [value, kept_value]: [f64; 2] = [value, kept_value].map(|text| text.parse().expect("a number"));
        assert!(
            name == kept_name && (value - kept_value).abs() <= 1e-6 * kept_value.abs(),
            "{found} is not {kept}"
        );
    }
}

fn answers(model: &Model) -> Vec<String> {
    let mut state = ModelState::new(model, &Selection::default()).expect("fits");
    let middle = 20; // the node at half the length
    let mut answer = |load_n, imperfection_mm| {
        state.update(at(load_n, imperfection_mm)).expect("has every regime");
        let name = model.header.regime_name(state.evaluation().regime);
        format!("{name} {:?}", state.fields()[strip::mesh().len() + middle])
    };
    [(5.0, 0.2), (14.0, 0.3), (14.0, -0.3)]
        .map(|(load_n, imperfection_mm)| answer(load_n, imperfection_mm))
        .to_vec()
}

#[test]
fn a_header_that_contradicts_itself_is_refused() {
    let (model, _) = trained();
    let spoilt = |change: &dyn Fn(&mut rom::model::NamedRegimes)| {
        let mut model = model.clone();
        change(model.header.named.as_mut().expect("named"));
        match model.to_bytes() {
            Err(ModelFileError::Header(reason)) => reason,
            other => panic!("expected a refusal, found {:?}", other.map(|bytes| bytes.len())),
        }
    };
    assert!(spoilt(&|named| named.names[1] = "straight".into()).contains("twice"));
    assert!(spoilt(&|named| named.names[1] = "a b".into()).contains("letters"));
    assert!(spoilt(&|named| named.names.truncate(2)).contains("do not belong together"));
    assert!(spoilt(&|named| named.border = None).contains("nothing decides"));
    let with = |change: &dyn Fn(&mut rom::model::Border)| {
        spoilt(&|named| change(named.border.as_mut().expect("three regimes")))
    };
    assert!(with(&|border| border.scores.outputs = 2).contains("other regimes"));
    assert!(with(&|border| border.scores.weights.truncate(1)).contains("cut"));
    assert!(with(&|border| border.inputs.axes[0].input = 70).contains("missing input"));
    assert!(with(&|border| border.doubt = f64::NAN).contains("doubt"));
    let mut unnamed = model.clone();
    unnamed.header.named = None;
    assert!(unnamed.to_bytes().is_err_and(|error| error.to_string().contains("has no name")));
}

#[test]
fn one_name_alone_is_a_model_of_that_regime() {
    let states: Vec<_> =
        strip::states(60).into_iter().filter(|(_, [load, _])| *load < strip::CRITICAL_N).collect();
    let mut data = strip::database(&states);
    data.regime_names.truncate(1);
    let (model, sheet) = train(&data, &config(), &mut |_| {}).expect("trains");
    assert_eq!((model.header.regime_names(), sheet.border), (vec!["straight"], None));
    let loaded = Model::from_bytes(&model.to_bytes().expect("encodes")).expect("loads");
    let mut state = ModelState::new(&loaded, &Selection::default()).expect("fits");
    state.update(at(15.0, 0.2)).expect("the regime there is");
    assert_eq!(state.evaluation().regime, RegimeKind::Named(0));
    assert_eq!(state.evaluation().domain, DomainStatus::Outside);
}

#[test]
fn what_cannot_be_trained_is_named_with_what_would_do() {
    let mut few = data();
    let down: Vec<usize> =
        few.of_split(Split::Train).filter(|&i| few.cases[i].regime == RegimeKind::Named(2)).collect();
    down.iter().skip(2).for_each(|&i| few.cases[i].split = Split::Check);
    let found = refused(&few);
    assert!(found.contains("regime down: expected at least 4 training states"), "{found}");

    let mut mixed = data();
    mixed.cases[7].regime = RegimeKind::Free;
    let found = refused(&mixed);
    assert!(found.contains("case 0 is of the regime") && found.contains("case 7 of free"), "{found}");

    let mut many = data();
    many.regime_names = (0..=MAX_REGIMES).map(|i| format!("r{i}")).collect();
    assert!(refused(&many).contains("at most 16 names, found 17"));

    let mut bad = data();
    bad.regime_names = vec!["straight".into(), "up/down".into(), "Contact".into()];
    let found = refused(&bad);
    assert!(found.contains("\"up/down\"") && found.contains("`contact` means something already"), "{found}");

    let mut beyond = data();
    beyond.regime_names.pop();
    assert!(refused(&beyond).contains("its regime has no name"));

    let mut gaps = data();
    gaps.cases[3].gap_mm = Some(10.0);
    assert!(refused(&gaps).contains("case 3 has a gap_mm, case 0 has none"));

    // Bistable: the same inputs, two regimes.
    let mut states = strip::states(60);
    states.push(states[0]);
    let mut twins = strip::database(&states);
    let last = twins.cases.len() - 1;
    twins.cases[last].regime = RegimeKind::Named((strip::regime(states[0].1[0], states[0].1[1]) + 1) % 3);
    let found = refused(&twins);
    assert!(
        found.contains("cases 0 (") && found.contains("have the same inputs, which alone decide"),
        "{found}"
    );
}

#[test]
fn model_and_database_must_have_the_same_regimes() {
    let (model, _) = trained();
    let mut data = data();
    data.regime_names = ["up", "straight", "down"].map(String::from).to_vec(); // another order
    for case in &mut data.cases {
        case.regime = RegimeKind::Named(strip::regime(case.parameters[0], case.parameters[1]));
        case.regime = [RegimeKind::Named(1), RegimeKind::Named(0), RegimeKind::Named(2)]
            [case.regime.number() as usize - 3];
    }
    let all: Vec<usize> = data.of_split(Split::Train).collect();
    let report = evaluate(model, &data, &all, DEFAULT_FLOOR).expect("the same names");
    assert!(report.regimes.iter().all(|summary| summary.in_regime == Some(1.0)), "{:?}", report.regimes);
    data.regime_names[0] = "upwards".into();
    let other = evaluate(model, &data, &all, DEFAULT_FLOOR);
    assert!(
        matches!(other, Err(EvaluateError::Mismatch { found, .. }) if found == "the regimes upwards, straight, down")
    );
}

#[test]
fn a_gap_is_an_input_as_any_other_and_a_force_is_trained_where_there_is_one() {
    let mut data = data();
    for case in &mut data.cases {
        case.gap_mm = Some(10.0 + case.parameters[1]);
        case.contact_force_n = 1.0 + 0.1 * case.parameters[0];
        case.parameters.truncate(1);
    }
    data.parameters.truncate(1);
    let (model, _) = train(&data, &config(), &mut |_| {}).expect("trains");
    let evaluator = Evaluator::new(&model.header).expect("consistent");
    let mut out = evaluator.evaluation();
    evaluator.evaluate(Inputs::new(0.0, 10.3).with(PARAMETERS, 14.0), &mut out);
    assert_eq!(evaluator.regime_name(out.regime), "up");
    assert!((out.contact_force_n - 2.4).abs() < 0.01, "{} N", out.contact_force_n);
    assert!(evaluator.onset().is_none());
}

#[test]
fn names_change_nothing_about_free_and_contact() {
    let plain = synthetic::plate();
    assert!(plain.regime_names.is_empty());
    let (model, sheet) = train(&plain, &config(), &mut |_| {}).expect("trains");
    assert!(model.header.named.is_none() && sheet.border.is_none() && sheet.regime_names.is_empty());
    let numbers: Vec<u32> = model.header.regimes.iter().map(|regime| regime.kind.number()).collect();
    assert_eq!((numbers, model.header.regime_names()), (vec![1, 2], vec!["free", "contact"]));
}
