//! Questions to a twin: what if, which pressure, which gap; in one process and through the tool.

use proptest::prelude::*;
use rom::rng::Rng;
use runtime::config::{ActuatorSpec, Scene};
use runtime::query::{Answerer, QueryService, load_answerers};
use runtime::side_service::SideService;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use tests::{PATIENCE, Program, Stage, synthetic};
use wire::layout::{field_id, flags, pack_name, query_kind, regime};
use wire::{Answer, Bus, Query, QueryClient, QueryStatus, Selector, SelectorError, WireError};

fn scene(stage: &Stage, extra: &str) -> (Scene, PathBuf) {
    let text = format!(
        "name = \"s\"\n[[actuator]]\nname = \"finger\"\nmodel = \"beam.twin\"\n{extra}\n\
         [[actuator.output]]\nnodes = \"all\"\n[[actuator.output]]\nnodes = \"tip\"\nfields = [\"y\"]"
    );
    let path = stage.write("scene.toml", &text);
    (Scene::load(&path).unwrap(), path)
}

fn whatif(pressure_mpa: f64, gap_mm: f64) -> Query {
    Query { kind: query_kind::WHATIF, pressure_mpa, gap_mm, ..Query::default() }
}

fn pressure_for(force_n: f64, gap_mm: f64) -> Query {
    Query { kind: query_kind::PRESSURE, force_n, gap_mm, ..Query::default() }
}

fn gap_for(pressure_mpa: f64, force_n: f64) -> Query {
    Query { kind: query_kind::GAP, pressure_mpa, force_n, ..Query::default() }
}

/// Serves the scene in a thread while `ask` runs.
fn with_service(extra: &str, ask: impl FnOnce(&Bus)) {
    let stage = Stage::new("queries");
    let (scene, path) = scene(&stage, extra);
    let answerers = load_answerers(&scene, &path).unwrap();
    let stop = AtomicBool::new(false);
    let (ready, serving) = std::sync::mpsc::channel();
    std::thread::scope(|scope| {
        let (stop, domain) = (&stop, stage.domain());
        scope.spawn(move || {
            let mut service = QueryService::start(&Bus::open(&domain).unwrap(), answerers).unwrap();
            ready.send(()).unwrap();
            service.run(stop, &std::sync::mpsc::channel().1);
        });
        serving.recv_timeout(PATIENCE).unwrap();
        let bus = stage.bus();
        let result = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| ask(&bus)));
        stop.store(true, Ordering::Relaxed);
        if let Err(cause) = result {
            std::panic::resume_unwind(cause);
        }
    });
}

#[test]
fn what_if_query_returns_state_and_field() {
    with_service("queries = \"fields\"", |bus| {
        let mut client = QueryClient::open(bus, "finger").unwrap();
        let sample = client.ask(&whatif(0.05, 25.0), PATIENCE).unwrap();
        let answer = sample.answer();
        assert_eq!(answer.refusal(), None);
        assert_eq!((answer.regime, answer.domain_status), (regime::CONTACT, 0));
        assert!((answer.contact_force_n - synthetic::force_n(0.05, 25.0)).abs() < 0.01, "{answer:?}");
        assert!(answer.force_by_pressure_n_per_mpa > 0.0 && answer.force_by_gap_n_per_mm < 0.0);
        assert!(sample.values().is_empty());
        drop(sample);

        let all = Query { want_field: 1, ..whatif(0.05, 25.0) };
        for _ in 0..5 {
            let sample = client.ask(&all, PATIENCE).unwrap();
            assert_eq!(sample.values().len(), 5 * synthetic::NODES);
            let ids: Vec<u8> = sample.answer().fields().collect();
            assert_eq!(ids[1], field_id::Y);
            let truth = synthetic::snapshot(0.05, Some(25.0));
            for node in 0..synthetic::NODES {
                let (found, expected) = (sample.values()[synthetic::NODES + node], truth[5 * node + 1]);
                assert!((found - expected).abs() < 0.1, "node {node}: {found} is not {expected}");
            }
        }
        let tip = Query { want_field: 1, node_set: pack_name("tip"), ..whatif(0.05, 25.0) };
        assert_eq!(client.ask(&tip, PATIENCE).unwrap().values().len(), 10);
        let unknown = Query { want_field: 1, node_set: pack_name("heel"), ..whatif(0.05, 25.0) };
        assert_eq!(client.ask(&unknown, PATIENCE).unwrap().answer().status, QueryStatus::NoSuchField.code());
    });
}

#[test]
fn models_are_swapped_for_the_same_actuators_only() {
    let stage = Stage::new("swap");
    let (scene, path) = scene(&stage, "");
    let first = load_answerers(&scene, &path).unwrap();
    let second = load_answerers(&scene, &path).unwrap();
    let bus = stage.bus();
    let mut service = QueryService::start(&bus, first).unwrap();
    assert!(service.replace(second), "the same actuators");
    assert!(!service.replace(Vec::new()), "other actuators");
}

#[test]
fn field_queries_are_refused_unless_the_scene_enables_them() {
    with_service("", |bus| {
        let mut client = QueryClient::open(bus, "finger").unwrap();
        let all = Query { want_field: 1, ..whatif(0.05, 25.0) };
        assert_eq!(client.ask(&all, PATIENCE).unwrap().answer().status, QueryStatus::NoSuchField.code());
    });
}

#[test]
fn several_clients_get_their_own_answers() {
    with_service("", |bus| {
        let mut clients: Vec<QueryClient> =
            (0..8).map(|_| QueryClient::open(bus, "finger").unwrap()).collect();
        for round in 0..20 {
            for (number, client) in clients.iter_mut().enumerate() {
                let pressure_mpa = 0.01 + 0.001 * f64::from(round) + 0.002 * number as f64;
                let sample = client.ask(&whatif(pressure_mpa, 25.0), PATIENCE).unwrap();
                assert_eq!(sample.answer().pressure_mpa, pressure_mpa);
            }
        }
    });
}

#[test]
fn query_without_a_twin_is_refused_with_the_cause() {
    let stage = Stage::new("noserver");
    let refused = QueryClient::open(&stage.bus(), "finger").unwrap_err();
    assert!(matches!(refused, WireError::NobodyAnswers { .. }), "{refused}");
    let (scene, path) = scene(&stage, "queries = \"off\"");
    assert!(load_answerers(&scene, &path).unwrap().is_empty());
}

fn beam() -> (Stage, Answerer) {
    let stage = Stage::new("solve");
    let (scene, path) = scene(&stage, "");
    let answerer = load_answerers(&scene, &path).unwrap().remove(0);
    (stage, answerer)
}

fn ask(answerer: &mut Answerer, query: &Query) -> Answer {
    answerer.answer(query, &mut [])
}

#[test]
fn refused_queries_have_a_status_code() {
    let (_stage, mut beam) = beam();
    let cases = [
        (whatif(f64::NAN, 20.0), QueryStatus::NotFinite),
        (pressure_for(0.2, f64::NAN), QueryStatus::NotFinite),
        (pressure_for(50.0, 25.0), QueryStatus::ForceTooHigh),
        (pressure_for(-0.1, 25.0), QueryStatus::ForceTooLow),
        (pressure_for(0.2, 500.0), QueryStatus::OutOfReach),
        (gap_for(0.05, 0.0), QueryStatus::NoContact),
        (gap_for(0.05, 50.0), QueryStatus::ForceTooHigh),
        (gap_for(0.5, 0.3), QueryStatus::OutsideDomain),
        (Query { kind: 77, ..whatif(0.05, 20.0) }, QueryStatus::UnknownKind),
    ];
    for (query, expected) in cases {
        let answer = ask(&mut beam, &query);
        assert_eq!(
            QueryStatus::from_code(answer.status),
            Some(expected),
            "{query:?}: {:?}",
            answer.refusal()
        );
    }
    // The limits are the truth's: the gap that 0.03 MPa just closes, the largest force at a gap.
    let touching = ask(&mut beam, &gap_for(0.03, 0.0)).limit;
    assert!((touching - synthetic::sag_mm(0.03)).abs() < 0.05, "{touching}");
    let most = ask(&mut beam, &pressure_for(50.0, 25.0)).limit;
    assert!((most - synthetic::force_n(0.09, 25.0)).abs() < 0.02, "{most}");
}

#[test]
fn state_outside_the_training_range_is_flagged() {
    let (_stage, mut beam) = beam();
    let names_the_pressure = |answer: &Answer, by_mpa: f64| {
        let [pressure, gap, ..] = answer.outside_by;
        let which = answer.outside().expect("an input");
        (pressure - by_mpa).abs() < 1e-9 && gap == 0.0 && which.contains("pressure_mpa")
    };
    let answer = ask(&mut beam, &whatif(0.1, 25.0));
    assert!(names_the_pressure(&answer, 0.01), "{:?}", answer.outside());
    assert_eq!((answer.refusal(), answer.domain_status), (None, 2));
    assert_ne!(answer.flags & flags::OUTSIDE_DOMAIN, 0);
    assert!(answer.force_halfwidth_n.is_nan() && answer.displacement_halfwidth_mm.is_nan(), "{answer:?}");
    let answer = ask(&mut beam, &whatif(0.2, 25.0));
    assert_eq!(answer.status, QueryStatus::TooFar.code(), "{:?}", answer.refusal());
    assert!(names_the_pressure(&answer, 0.11), "{:?}", answer.outside());
    assert!(answer.limit > 0.25 && answer.contact_force_n.is_nan(), "{answer:?}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Both inverses undo the what-if; their half-widths are the force's, divided by the gradient.
    #[test]
    fn inverses_undo_the_what_if(pressure_mpa in 0.03..0.085, gap_mm in 12.0..34.0) {
        let (_stage, mut beam) = beam();
        let there = ask(&mut beam, &whatif(pressure_mpa, gap_mm));
        prop_assume!(there.contact_force_n > 0.01 && there.domain_status == 0);
        let back = ask(&mut beam, &pressure_for(there.contact_force_n, gap_mm));
        prop_assert_eq!(back.refusal(), None);
        prop_assert!((back.pressure_mpa - pressure_mpa).abs() < 1e-6, "{} is not {}", back.pressure_mpa, pressure_mpa);
        prop_assert!((back.contact_force_n - there.contact_force_n).abs() < 1e-8);
        let bar_n = f64::from(there.force_halfwidth_n);
        let slope = back.force_by_pressure_n_per_mpa.abs();
        prop_assert!((back.uncertainty - bar_n / slope).abs() <= 1e-5 * back.uncertainty);
        prop_assert!(back.low <= back.pressure_mpa && back.pressure_mpa <= back.high);
        let known = Query { force_halfwidth_n: 0.02, ..gap_for(pressure_mpa, there.contact_force_n) };
        let back = ask(&mut beam, &known);
        prop_assert_eq!(back.refusal(), None);
        prop_assert!((back.gap_mm - gap_mm).abs() < 1e-4, "{} is not {}", back.gap_mm, gap_mm);
        let expected = bar_n.hypot(0.02) / back.force_by_gap_n_per_mm.abs();
        prop_assert!((back.uncertainty - expected).abs() <= 1e-5 * expected);
    }
}

#[test]
fn shipped_model_is_inverted_over_its_training_range() {
    let mut finger = committed();
    let mut solved = 0;
    for step in 0..12 {
        let gap_mm = 12.0 + 3.0 * f64::from(step);
        for force_n in [0.02, 0.1, 0.3, 0.6] {
            let answer = ask(&mut finger, &pressure_for(force_n, gap_mm));
            if answer.refusal().is_none() {
                assert!((answer.contact_force_n - force_n).abs() < 1e-7, "{gap_mm} mm: {answer:?}");
                assert_eq!(answer.domain_status, 0);
                solved += 1;
            } else {
                // More force than 0.09 MPa gives there, or less than the weight alone does.
                let known = [QueryStatus::ForceTooHigh.code(), QueryStatus::ForceTooLow.code()];
                assert!(known.contains(&answer.status), "{gap_mm} mm, {force_n} N: {:?}", answer.refusal());
            }
        }
    }
    assert!(solved >= 30, "only {solved} of 48 were solved");
}

/// A finger with the committed model.
fn committed() -> Answerer {
    let model = Path::new(env!("CARGO_MANIFEST_DIR")).join("../models/pneunet/pneunet.twin");
    Answerer::load(&toml_actuator(&model), &model).unwrap()
}

fn within(random: &mut Rng, low: f64, high: f64) -> f64 {
    low + (high - low) * random.uniform()
}

/// An answer, evaluated, gives the requested force at a contact state inside the training range.
fn assert_answers(query: &Query, answer: &Answer) {
    let residual_n = (answer.contact_force_n - query.force_n).abs();
    assert!(residual_n <= 1e-7, "{query:?} is off by {residual_n} N: {answer:?}");
    assert_eq!((answer.domain_status, answer.regime), (0, regime::CONTACT), "{query:?}: {answer:?}");
    let (value, given) = match query.kind {
        query_kind::GAP => (answer.gap_mm, answer.pressure_mpa == query.pressure_mpa),
        _ => (answer.pressure_mpa, answer.gap_mm == query.gap_mm),
    };
    assert!(given && answer.low <= value && value <= answer.high, "{query:?}: {answer:?}");
}

/// Both gave a gap whose force was not the asked one: 71.9 mm with 0 N, and the far end of the samples.
#[test]
fn unconverged_search_is_refused() {
    let mut finger = committed();
    let outside = gap_for(0.05, 0.15);
    let answer = ask(&mut finger, &outside);
    if answer.refusal().is_some() {
        assert_eq!(answer.status, QueryStatus::ForceTooLow.code(), "{:?}", answer.refusal());
        assert!(answer.limit > 0.15, "{answer:?}");
    } else {
        assert_answers(&outside, &answer);
    }
    let inside = gap_for(0.00779, 0.00126);
    let answer = ask(&mut finger, &inside);
    assert_eq!(answer.refusal(), None);
    assert_answers(&inside, &answer);
    assert!((answer.gap_mm - 35.05).abs() < 0.1, "{answer:?}");
}

#[test]
fn inverse_answers_reproduce_the_force_and_refusals_have_limits() {
    let (mut finger, mut random) = (committed(), Rng::new(2026));
    let (mut answered, mut refused) = (0, 0);
    for turn in 0..4000 {
        // Inside and outside of the training range, in pressure, gap and force.
        let force_n = within(&mut random, -0.1, 1.3);
        let query = match turn % 2 {
            0 => gap_for(within(&mut random, -0.01, 0.11), force_n),
            _ => pressure_for(force_n, within(&mut random, 0.0, 90.0)),
        };
        let answer = ask(&mut finger, &query);
        match answer.refusal() {
            None => {
                assert_answers(&query, &answer);
                answered += 1;
            }
            Some(reason) => {
                assert!(answer.limit.is_finite(), "{query:?}: {reason}");
                refused += 1;
            }
        }
    }
    assert!(answered > 500 && refused > 500, "{answered} answered, {refused} refused");
}

#[test]
fn query_made_from_a_contact_state_is_answered() {
    let (mut finger, mut random) = (committed(), Rng::new(7));
    let mut asked = 0;
    while asked < 2000 {
        // Half of them where the weight alone is nearly enough to touch.
        let highest_mpa = if asked % 2 == 0 { 0.09 } else { 0.01 };
        let there =
            ask(&mut finger, &whatif(within(&mut random, 0.0, highest_mpa), within(&mut random, 10.0, 72.0)));
        if (there.regime, there.domain_status) != (regime::CONTACT, 0) || there.contact_force_n <= 1e-6 {
            continue;
        }
        asked += 1;
        for query in [
            gap_for(there.pressure_mpa, there.contact_force_n),
            pressure_for(there.contact_force_n, there.gap_mm),
        ] {
            let answer = ask(&mut finger, &query);
            assert_eq!(answer.refusal(), None, "{query:?} from {there:?}");
            assert_answers(&query, &answer);
        }
    }
}

fn toml_actuator(model: &Path) -> ActuatorSpec {
    let stage = Stage::new("spec");
    let text = format!("name = \"s\"\n[[actuator]]\nname = \"finger\"\nmodel = \"{}\"", model.display());
    Scene::load(&stage.write("scene.toml", &text)).unwrap().actuators.remove(0)
}

#[test]
fn zenoh_selectors_are_parsed() {
    let selector = Selector::parse("softtwin/finger/whatif?pressure_mpa=0.05;gap_mm=30;field=tip").unwrap();
    assert_eq!(selector.actuator(), Some("finger"));
    let questions = selector.questions("finger");
    let [question] = questions.as_slice() else { panic!("one question was asked: {questions:?}") };
    assert_eq!(
        (question.kind, question.want_field, question.node_set),
        (query_kind::WHATIF, 1, pack_name("tip"))
    );
    assert_eq!((question.pressure_mpa, question.gap_mm), (0.05, 30.0));
    assert!(question.force_n.is_nan());
    assert!(selector.questions("thumb").is_empty());
    let both = Selector::parse("softtwin/*/*?pressure_mpa=0.05&force_n=0.3").unwrap();
    assert_eq!(both.actuator(), None);
    assert_eq!(both.questions("thumb").len(), 3);
    for (text, expected) in [
        ("softtwin/finger/state", "asks nothing"),
        ("softtwin//whatif", "empty chunk"),
        ("softtwin/finger/whatif?gap_mm=30", "needs pressure_mpa"),
        ("softtwin/finger/gap", "needs pressure_mpa and force_n"),
        ("softtwin/finger/whatif?pressure_mpa=x", "finite number"),
        ("softtwin/finger/whatif?pressure_mpa=0.1;pressure_mpa=0.2", "twice"),
        (
            "softtwin/finger/gap?pressure=0.1;force_n=0.3",
            "needs pressure_mpa; taken for parameters of the model: pressure",
        ),
        ("softtwin/finger/whatif?pressure_mpa=0.1;=3", "expected name=value"),
        ("softtwin/finger/whatif?pressure_mpa=0.1;field=a b", "node set"),
    ] {
        let error: SelectorError = Selector::parse(text).unwrap_err();
        assert!(error.to_string().contains(expected), "{text}: {error}");
    }
}

#[test]
fn get_command_queries_a_running_twin() {
    let stage = Stage::new("get");
    let scene = stage.write(
        "finger.toml",
        "name = \"s\"\n[[actuator]]\nname = \"finger\"\nmodel = \"beam.twin\"\nqueries = \"fields\"\n\
         [[actuator.output]]\nnodes = \"all\"",
    );
    let get = |arguments: &[&str]| {
        let (status, said) = Program::tool(&stage, &[&["get"], arguments].concat()).end();
        (status.code(), said)
    };
    let selector = "softtwin/finger/whatif?pressure_mpa=0.05;gap_mm=25;field=all";
    let (code, said) = get(&[selector]);
    assert_eq!(code, Some(1), "{said:?}");
    let twin = Program::twin(&stage, &scene);
    let file = stage.path("state.npy").display().to_string();
    let (code, said) = get(&[selector, "--json", "--out", &file]);
    assert_eq!(code, Some(0), "{said:?}");
    let answer: Value = serde_json::from_str(&said[0]).unwrap();
    assert_eq!((&answer["kind"], &answer["field"]["nodes"]), (&"whatif".into(), &synthetic::NODES.into()));
    let bytes = std::fs::read(&file).unwrap();
    assert_eq!(&bytes[..6], b"\x93NUMPY");
    let (code, said) = get(&["softtwin/*/pressure?force_n=0.2;gap_mm=25"]);
    assert_eq!(code, Some(0), "{said:?}");
    assert!(said[0].contains("P = 0.0") && said[0].contains("+-"), "{said:?}");
    let (code, said) = get(&["softtwin/finger/pressure?force_n=50;gap_mm=25"]);
    assert_eq!(code, Some(1), "{said:?}");
    let (code, said) = get(&["softtwin/finger/nothing"]);
    assert_eq!(code, Some(2), "{said:?}");
    let (status, said) = twin.stop();
    assert!(status.success(), "{said:?}");
    assert_eq!(stage.leftovers(), Vec::<String>::new());
}
