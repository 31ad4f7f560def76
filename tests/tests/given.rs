//! A parameter of the model that a scene gives: state, commands, recording, questions and predictions use it and show it.

use formats::npy;
use serde_json::Value;
use std::path::Path;
use tests::wait::{states, wait_for, wait_state};
use tests::{Program, Stage};
use wire::layout::input_source;
use wire::{FieldReader, SensorSample, SensorWriter, Topic, now_ns};

const MODEL: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../models/pneunet-design/pneunet-design.twin");
const STIFFNESS: &str = "elastomer.law.mu_mpa";
const PRESSURE_MPA: f64 = 0.06;
const GAP_MM: f64 = 40.0;
const NAMES: [&str; 7] = [
    "pressure_mpa",
    "gap_mm",
    STIFFNESS,
    "chambers.length_mm",
    "chambers.width_mm",
    "base.lower_mm",
    "sheet.thickness_mm",
];

/// Values of all inputs at this stiffness: the lengths at their nominal values.
fn inputs(stiffness: f64) -> [f64; 7] {
    [PRESSURE_MPA, GAP_MM, stiffness, 3.0, 14.0, 2.0, 0.1]
}

fn scene(stage: &Stage, inputs: &str) -> std::path::PathBuf {
    let text = format!(
        "name = \"s\"\n[[actuator]]\nname = \"finger\"\nmodel = {MODEL:?}\n[actuator.inputs]\n{inputs}\n\
         [[actuator.output]]\nnodes = \"bottom\"\n"
    );
    stage.write("given.toml", &text)
}

fn run(stage: &Stage, arguments: &[&str]) -> (Option<i32>, String) {
    let (status, said) = Program::tool(stage, arguments).end();
    (status.code(), said.join("\n"))
}

fn json(stage: &Stage, arguments: &[&str]) -> Value {
    let (code, said) = run(stage, arguments);
    assert_eq!(code, Some(0), "{arguments:?}: {said}");
    serde_json::from_str(&said).unwrap_or_else(|error| panic!("{error}: {said}"))
}

/// The model's own answer at this stiffness.
fn predicted(stage: &Stage, stiffness: f64) -> Value {
    let [pressure, gap, set] =
        [PRESSURE_MPA.to_string(), GAP_MM.to_string(), format!("{STIFFNESS}={stiffness}")];
    json(stage, &["predict", MODEL, "--json", "--pressure", &pressure, "--gap", &gap, "--set", &set])
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("not a number: {value}"))
}

fn publish(stage: &Stage, sensor: &mut SensorWriter, seq: u64) {
    let (pressure_mpa, gap_mm) = (PRESSURE_MPA, GAP_MM);
    let (boot_id, t_sensor_ns) = (1, now_ns());
    let reading = SensorSample { boot_id, seq, t_sensor_ns, pressure_mpa, gap_mm, ..SensorSample::default() };
    let reader = states(&stage.bus());
    sensor.publish(reading).expect("published");
    wait_state(&reader, "the state of the reading", |state| state.sensor_seq == seq);
}

#[test]
fn given_parameter_is_used_by_every_command() {
    let stage = Stage::new("given");
    let scene = scene(&stage, &format!("\"{STIFFNESS}\" = 0.72"));
    let twin = Program::twin(&stage, &scene);
    let mut sensor = SensorWriter::create(&stage.bus(), &Topic::sensor("finger").unwrap()).unwrap();
    let fields = FieldReader::attach(&stage.bus(), &Topic::field("finger", Some("bottom")).unwrap()).unwrap();
    let run_file = stage.path("run.mcap").display().to_string();
    let mut recorder = Program::tool(&stage, &["record", "--out", &run_file, "--seconds", "2", "--json"]);
    publish(&stage, &mut sensor, 1);
    let expected = predicted(&stage, 0.72);
    let state = json(&stage, &["echo", "softtwin/finger/state", "--once", "--json"])["sample"].clone();
    assert_eq!(state["input_names"], serde_json::json!(NAMES), "{state}");
    assert_eq!(state["inputs"], serde_json::json!(inputs(0.72)), "{state}");
    let force = number(&expected["contact_force_n"]);
    assert!(force > 0.1 && (number(&state["contact_force_n"]) - force).abs() < 1e-12 * force, "{expected}");
    for (at, name) in NAMES.iter().enumerate() {
        let (found, exact) = (number(&state["force_by_input"][at]), number(&expected["dforce"][name]));
        assert!((found - exact).abs() <= 1e-12 * exact.abs() && exact != 0.0, "{name}: {found}, {exact}");
    }
    let mut sources = vec!["measured", "measured", "given"];
    sources.resize(NAMES.len(), "nominal");
    assert_eq!(state["input_sources"], serde_json::json!(sources), "{state}");
    // A field says by itself which inputs it was made for.
    let field = wait_for(&fields, "the field of the reading", |reader| reader.newest().expect("readable"));
    let of_field: Vec<_> = field.header().inputs().map(|i| (i.name, i.value, i.source)).collect();
    let mut sources = vec![input_source::MEASURED, input_source::MEASURED, input_source::GIVEN];
    sources.resize(NAMES.len(), input_source::NOMINAL);
    let known = NAMES.iter().zip(inputs(0.72)).zip(sources);
    let known = known.map(|((name, value), source)| ((*name).to_owned(), value, source));
    assert_eq!(of_field, known.collect::<Vec<_>>());
    for (arguments, text) in [
        (&["echo", "softtwin/finger/state", "--once"][..], "elastomer.law.mu_mpa 0.72000 (given, dF "),
        (&["top", "--once"], "elastomer.law.mu_mpa 0.72000 (given, dF "),
        (&["inspect", "given.toml", "--json"], r#""value":0.72,"from":"given""#),
        (&["inspect", MODEL, "--json"], r#""nominal":0.8"#),
    ] {
        let (code, said) = run(&stage, arguments);
        assert!(code == Some(0) && said.contains(text), "{arguments:?}: {said}");
    }
    let top = json(&stage, &["top", "--once", "--json"]);
    assert_eq!(top[0]["inputs"][STIFFNESS], 0.72, "{top}");
    assert_eq!(top[0]["input_sources"][STIFFNESS], "given", "{top}");
    publish(&stage, &mut sensor, 2);
    let (status, said) = recorder.end();
    assert!(status.success(), "{said:?}");
    the_recording_has_the_value(&stage, &run_file);
    let said = twin.stop();
    assert!(said.0.success(), "{said:?}");
}

/// Tables carry the value, and a model that is evaluated for recorded states takes it.
fn the_recording_has_the_value(stage: &Stage, recording: &str) {
    let tables = stage.path("tables").display().to_string();
    let (code, said) = run(stage, &["export", recording, "--out", &tables]);
    assert_eq!(code, Some(0), "{said}");
    let table = std::fs::read_to_string(Path::new(&tables).join("softtwin.finger.state.csv")).unwrap();
    assert!(table.contains(&NAMES.join(" ")), "{table}");
    assert!(
        table.contains("0.06 40.0 0.72 3.0") && table.contains("measured measured given nominal"),
        "{table}"
    );
    let [replayed, exact] = ["replayed.npy", "exact.npy"].map(|name| stage.path(name).display().to_string());
    let (code, said) =
        run(stage, &["export", recording, "--model", MODEL, "--every", "1000000", "--out", &replayed]);
    assert_eq!(code, Some(0), "{said}");
    let state = ["--pressure", "0.06", "--gap", "40", "--set", "elastomer.law.mu_mpa=0.72", "--out", &exact];
    let (code, said) = run(stage, &[&["predict", MODEL, "--json"], &state[..]].concat());
    assert_eq!(code, Some(0), "{said}");
    let [replayed, exact] = [replayed, exact].map(|path| npy::read_f32(Path::new(&path)).unwrap().data);
    assert!(replayed == exact && exact.len() == 5 * 25022, "{} and {} values", replayed.len(), exact.len());
}

#[test]
fn queries_take_parameters_and_return_their_gradients() {
    let stage = Stage::new("given-asked");
    let twin = Program::twin(&stage, &scene(&stage, &format!("\"{STIFFNESS}\" = 0.72")));
    let ask = |parameters: &str| {
        let selector = format!("softtwin/finger/{parameters}");
        json(&stage, &["get", &selector, "--json"])
    };
    let whatif = |stiffness: f64| {
        ask(&format!("whatif?pressure_mpa={PRESSURE_MPA};gap_mm={GAP_MM};{STIFFNESS}={stiffness}"))
    };
    let force = |answer: &Value| number(&answer["contact_force_n"]);
    let answer = whatif(0.9);
    let expected = predicted(&stage, 0.9);
    assert_eq!(answer["inputs"], serde_json::json!(inputs(0.9)), "{answer}");
    assert!((force(&answer) - force(&expected)).abs() < 1e-12, "{answer}, {expected}");
    // The gradient is what a small step of the parameter does.
    let step = 1e-5;
    let by_step = (force(&whatif(0.9 + step)) - force(&whatif(0.9 - step))) / (2.0 * step);
    let by = number(&answer["force_by_input"][2]);
    assert!((by - by_step).abs() < 1e-5 * by.abs(), "{by} is not {by_step}");
    // A question without the parameter is one about the scene's value, also after one with it.
    let own = ask(&format!("whatif?pressure_mpa={PRESSURE_MPA};gap_mm={GAP_MM}"));
    assert_eq!(own["inputs"][2], 0.72, "{own}");
    assert!((force(&own) - force(&predicted(&stage, 0.72))).abs() < 1e-12, "{own}");
    // The inverses work at the parameter too.
    let n = force(&answer);
    let back = ask(&format!("pressure?force_n={n};gap_mm={GAP_MM};{STIFFNESS}=0.9"));
    assert!((number(&back["pressure_mpa"]) - PRESSURE_MPA).abs() < 1e-6, "{back}");
    let back = ask(&format!("gap?force_n={n};pressure_mpa={PRESSURE_MPA};{STIFFNESS}=0.9"));
    assert!((number(&back["gap_mm"]) - GAP_MM).abs() < 1e-4, "{back}");
    let (code, said) = run(&stage, &["get", "softtwin/finger/whatif?pressure_mpa=0.06;elastomer.law.mu=0.9"]);
    let known = format!("no input of this model, which has {}", NAMES.join(", "));
    assert!(code == Some(1) && said.contains(&known), "{said}");
    // A parameter's name needs no dot. The refusal contains the nearest known name.
    for name in ["mu_mpa", "elastomer.law.mu", "elastomr.law.mu_mpa"] {
        let question = format!("softtwin/finger/whatif?pressure_mpa=0.06;gap_mm=40;{name}=0.9");
        for form in [&["get", &question][..], &["get", &question, "--json"]] {
            let (code, said) = run(&stage, form);
            assert!(code == Some(1) && said.contains(STIFFNESS), "{form:?}: {said}");
        }
    }
    let text =
        run(&stage, &["get", &format!("softtwin/finger/whatif?pressure_mpa=0.06;gap_mm=40;{STIFFNESS}=0.9")])
            .1;
    assert!(text.contains("elastomer.law.mu_mpa 0.90000 (dF "), "{text}");
    assert!(twin.stop().0.success());
}

#[test]
fn unknown_given_parameter_is_refused_with_the_nearest_name() {
    let stage = Stage::new("given-wrong");
    let path = scene(&stage, "\"elastomer.law.mu\" = 0.72").display().to_string();
    let (status, said) = Program::daemon(&stage, &["twin", "--scene", &path]).ended();
    let said = said.join("\n");
    assert!(status.code() == Some(78) && said.contains(STIFFNESS), "{said}");
}
