//! A structure that is no actuator: results of another program become a model, and a twin serves it from readings of a load. Beside
//! the twin, the bridge, the recorder: what they publish is what `predict` says.

use formats::npy;
use serde_json::Value;
use std::path::PathBuf;
use std::sync::OnceLock;
use tests::cantilever::{beam, simulations};
use tests::wait::{wait_for, wait_state, wait_until};
use tests::{Program, Stage};
use wire::layout::{flags, input_source};
use wire::{FieldReader, HealthReader, KeyExpr, Outcome, State, StateReader, Topic, WireError};

/// Readings of the trace and their outcomes; the scene's range is 0.5 to 4 N.
const LOADS: [(&str, Outcome); 6] = [
    ("1.2", Outcome::Published),
    ("2.6", Outcome::Published),
    ("nan", Outcome::HeldNotFinite),
    ("9", Outcome::HeldInputOutsideScene),
    ("-inf", Outcome::HeldNotFinite),
    ("3.75", Outcome::Published),
];
const THICKNESS_MM: f64 = 7.3;
/// A node at the end of the beam.
const MARKER: usize = 20;

fn run(stage: &Stage, arguments: &[&str]) -> String {
    let (status, said) = Program::tool(stage, arguments).end();
    assert!(status.success(), "{arguments:?}: {said:?}");
    said.join("\n")
}

/// The cantilever's model from its simulations; made once per test program.
fn model_bytes() -> &'static [u8] {
    static BYTES: OnceLock<Vec<u8>> = OnceLock::new();
    BYTES.get_or_init(|| {
        let stage = Stage::with_model("structure-train", &[]);
        let names = simulations(stage.folder.path());
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        let pattern = ["--pattern", "beam_f{load_n}_t{thickness_mm}.vtu", "--out", "db"];
        let units = ["--length-unit", "m", "--stress-unit", "pa"];
        run(&stage, &[&["import", "results"], &names[..], &pattern, &units].concat());
        run(&stage, &["train", "--database", "db", "--out", "part.twin"]);
        std::fs::read(stage.path("part.twin")).expect("a model")
    })
}

/// A stage with that model and a scene in which a bridge replays a load.
fn stage(label: &str) -> (Stage, PathBuf) {
    let stage = Stage::with_model(label, &[]);
    std::fs::write(stage.path("part.twin"), model_bytes()).expect("writable");
    let rows = LOADS.iter().enumerate().map(|(at, (load, _))| format!("{},{load}\n", 0.01 * at as f64));
    stage.write("load.csv", &format!("t_s,load_n\n{}", rows.collect::<String>()));
    let scene = stage.write(
        "part.toml",
        "name = \"bench\"\n[[actuator]]\nname = \"part\"\nmodel = \"part.twin\"\nbacklog = 64\n\
         [actuator.inputs]\nload_n = { min = 0.5, max = 4 }\nthickness_mm = 7.3\n\
         [actuator.source]\nkind = \"replay\"\ntrace = \"load.csv\"\n[[actuator.output]]\n",
    );
    (stage, scene)
}

struct Readers {
    states: StateReader,
    fields: FieldReader,
}

impl Readers {
    fn attach(stage: &Stage) -> Result<Self, WireError> {
        let bus = stage.bus();
        let states = StateReader::attach(&bus, &Topic::state("part")?)?;
        Ok(Self { states, fields: FieldReader::attach(&bus, &Topic::field("part", None)?)? })
    }

    /// The states of all readings of the trace, in order, and the field of each that was published.
    fn follow(&self) -> (Vec<State>, Vec<Vec<f32>>) {
        let mut states = Vec::new();
        wait_state(&self.states, "the last reading's state", |state| {
            let is_of_a_reading = state.flags & (flags::NO_DATA | flags::STALE) == 0;
            states.extend(is_of_a_reading.then_some(*state));
            is_of_a_reading && state.inputs().any(|input| input.name == "load_n" && input.value == 3.75)
        });
        let mut fields = Vec::new();
        let published = LOADS.iter().filter(|(_, outcome)| *outcome == Outcome::Published).count();
        wait_for(&self.fields, "the fields", |reader| {
            while let Some(field) = reader.next().expect("readable") {
                fields.push(field.values().to_vec());
            }
            (fields.len() == published).then_some(())
        });
        (states, fields)
    }
}

/// The model's own field at a load, field by field as on the wire, and its answer.
fn predicted(stage: &Stage, load_n: f64) -> (Value, Vec<f32>) {
    let set = [format!("load_n={load_n}"), format!("thickness_mm={THICKNESS_MM}")];
    let out = stage.path("state.npy").display().to_string();
    let said =
        run(stage, &["predict", "part.twin", "--json", "--set", &set[0], "--set", &set[1], "--out", &out]);
    let array = npy::read_f32(&stage.path("state.npy")).expect("an array");
    let (nodes, fields) = (array.shape[0], array.shape[1]);
    let by_field = (0..fields).flat_map(|k| (0..nodes).map(move |node| node * fields + k));
    (serde_json::from_str(&said).expect("JSON"), by_field.map(|at| array.data[at]).collect())
}

/// Neither pressure, gap, force nor onset is in a state of a model without them.
fn absent(state: &State) {
    let State { pressure_mpa, gap_mm, contact_force_n, onset_pressure_mpa, .. } = state;
    let State { force_by_pressure_n_per_mpa, force_by_gap_n_per_mm, .. } = state;
    let values = [pressure_mpa, gap_mm, contact_force_n, onset_pressure_mpa];
    let slopes = [force_by_pressure_n_per_mpa, force_by_gap_n_per_mm];
    assert!(values.into_iter().chain(slopes).all(|value| value.is_nan()), "{state:?}");
    assert!(state.inputs().all(|input| input.force_by.is_nan() && input.is_parameter()), "{state:?}");
    let json = serde_json::to_value(recording::message::Json::new(wire::Payload::view(state))).expect("JSON");
    let of_force = json.as_object().expect("an object").iter().filter(|(key, _)| {
        key.contains("pressure")
            || key.contains("gap")
            || key.contains("force_n")
            || key.contains("force_half")
    });
    assert_eq!(of_force.map(|(_, value)| assert!(value.is_null(), "{json}")).count(), 8);
}

/// Published states and fields of the trace equal the model's.
fn check(stage: &Stage, states: &[State], fields: &[Vec<f32>]) {
    let found: Vec<u32> = states.iter().map(|state| state.outcome).collect();
    assert_eq!(found, LOADS.map(|(_, outcome)| outcome.code()));
    let mut fields = fields.iter();
    let mut last_n = f64::NAN;
    for (state, (load, outcome)) in states.iter().zip(LOADS) {
        let is_good = outcome == Outcome::Published;
        assert_eq!(state.flags & flags::HELD != 0, !is_good, "{load} N");
        last_n = if is_good { load.parse().expect("a load") } else { last_n };
        let inputs: Vec<(String, f64, u8)> = state.inputs().map(|i| (i.name, i.value, i.source)).collect();
        let own = |name: &str, value, source| (name.to_owned(), value, source);
        // A value that was refused is neither used nor cut to the range: the last good one stands.
        assert_eq!(inputs.len(), 2, "{inputs:?}");
        absent(state);
        assert!(inputs.contains(&own("load_n", last_n, input_source::MEASURED)), "{load} N: {inputs:?}");
        let thickness = own("thickness_mm", THICKNESS_MM, input_source::GIVEN);
        assert!(inputs.contains(&thickness), "{inputs:?}");
        if !is_good {
            continue;
        }
        let (answer, exact) = predicted(stage, last_n);
        assert!(answer["in_domain"] == true && state.domain_status == 0, "{answer} {state:?}");
        let field = fields.next().expect("a field for every good reading");
        assert_eq!(field.len(), exact.len());
        let largest = exact.iter().fold(0.0_f32, |largest, value| largest.max(value.abs()));
        let off = field.iter().zip(&exact).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(off <= 2.0 * f32::EPSILON * largest, "{load} N: off by {off} of {largest}");
    }
}

#[test]
fn cantilever_is_served_from_readings_of_its_load() {
    let (stage, scene) = stage("structure");
    // Three bad readings in a row are no silence, however slow the machine.
    let settings = stage.write("twin.toml", "[limits]\ndeadline_ms = 500\n").display().to_string();
    let mut twin =
        Program::daemon(&stage, &["twin", "--scene", &scene.display().to_string(), "--config", &settings]);
    twin.wait_for("ready:");
    let readers = Readers::attach(&stage).expect("the twin's topics");
    let health = HealthReader::attach(&stage.bus(), &Topic::health("part").unwrap()).expect("a health");
    let out = stage.path("run.mcap").display().to_string();
    let mut recorder = Program::tool(&stage, &["record", "--out", &out]);
    wait_listening(&stage, &recorder);
    let bridge = Program::daemon(&stage, &["bridge", "--scene", &scene.display().to_string()]);
    let (states, fields) = readers.follow();
    check(&stage, &states, &fields);
    let (status, said) = bridge.ended();
    assert!(status.success(), "the trace ends, and the bridge with it: {said:?}");
    let counted = wait_for(&health, "a health with all readings", |reader| {
        reader.newest().expect("readable").filter(|health| health.received == LOADS.len() as u64)
    });
    let count = |outcome| counted.count(outcome);
    let [bad, outside] = [Outcome::HeldNotFinite, Outcome::HeldInputOutsideScene].map(count);
    assert_eq!((count(Outcome::Published), bad, outside), (3, 2, 1));
    wait_state(&readers.states, "a stale state", |state| state.flags & flags::STALE != 0);
    for (arguments, text) in [
        (&["echo", "softtwin/part/state", "--once"][..], "load_n 3.75000 (measured"),
        (&["top", "--once"], "thickness_mm 7.30000 (given"),
        (&["inspect", "part.toml", "--json"], r#""name":"load_n","unit":"N","value":null,"from":"measured""#),
        (&["doctor", "--scene", "part.toml"], "part loaded"),
        (&["get", "softtwin/part/whatif?load_n=2.6"], "load_n 2.60000"),
    ] {
        // A command may end between two states of a twin without readings; the next call sees one.
        wait_until(text, || Program::tool(&stage, arguments).end().1.join("\n").contains(text).then_some(()));
    }
    // A query without the load is refused: the scene has no value for it.
    let (status, said) = Program::tool(&stage, &["get", "softtwin/part/whatif?pressure_mpa=0"]).end();
    assert_eq!(status.code(), Some(1), "{said:?}");
    // Nor is there an answer about a pressure, a gap or a force that the model does not have.
    for question in [
        "whatif?load_n=2.6&pressure_mpa=0.02",
        "whatif?load_n=2.6&gap_mm=40",
        "pressure?load_n=2.6&force_n=0.1&gap_mm=40",
    ] {
        let (status, said) = Program::tool(&stage, &["get", &format!("softtwin/part/{question}")]).end();
        assert_eq!(status.code(), Some(1), "{question}: {said:?}");
    }
    recorder.signal(libc::SIGINT);
    let (status, said) = recorder.end();
    assert!(status.success(), "{said:?}");
    replayed(&stage, &out, &readers);
    // The trace again, without a scene: its columns are the inputs.
    let mut replay = Program::tool(&stage, &["replay", "load.csv", "--actuator", "part"]);
    let (states, fields) = readers.follow();
    check(&stage, &states, &fields);
    let (status, said) = replay.end();
    assert!(status.success() && said.join("\n").contains("sent  6"), "{said:?}");
    let (status, said) = twin.stop();
    assert!(status.success(), "{said:?}");
}

/// Waits until the recorder reads the readings.
fn wait_listening(stage: &Stage, recorder: &Program) {
    let (bus, sensor) = (stage.bus(), KeyExpr::new("softtwin/part/sensor").unwrap());
    wait_until("a recorder that listens", || {
        let found = bus.topics(&sensor).expect("topics");
        found.iter().any(|info| info.readers.contains(&recorder.id())).then_some(())
    });
}

/// The readings of the recording give the same again.
fn replayed(stage: &Stage, recording: &str, readers: &Readers) {
    let tables = stage.path("tables");
    run(stage, &["export", recording, "--out", &tables.display().to_string()]);
    let table = std::fs::read_to_string(tables.join("softtwin.part.sensor.csv")).expect("readings");
    assert_eq!(table.matches(",load_n,").count(), LOADS.len(), "{table}");
    assert!(table.contains(",load_n,2.6,0,") && table.contains(",load_n,NaN,0,"), "{table}");
    let mut replay = Program::tool(stage, &["replay", recording, "--actuator", "part"]);
    let (states, fields) = readers.follow();
    check(stage, &states, &fields);
    let (status, said) = replay.end();
    assert!(status.success() && said.join("\n").contains("sent  6"), "{said:?}");
}

/// One input is measured, the other estimated from a marker at the end of the beam: by a fit to a recording, by a twin that runs.
#[test]
fn input_is_estimated_next_to_a_measured_one() {
    let (stage, _) = stage("estimate");
    let mut trace = String::from("t_s,load_n,marker1_x_mm,marker1_y_mm,marker1_z_mm\n");
    for at in 0..40 {
        let load_n = 1.5 + 0.05 * f64::from(at);
        let (point, moved, _) = beam(load_n, THICKNESS_MM)[MARKER];
        let [x, y, z] = [0, 1, 2].map(|axis| point[axis] + moved[axis]);
        trace += &format!("{},{load_n},{x},{y},{z}\n", 0.02 * f64::from(at));
    }
    stage.write("marker.csv", &trace);
    let scene = |of_load: &str| {
        let text = format!(
            "name = \"bench\"\n[[actuator]]\nname = \"part\"\nmodel = \"part.twin\"\n[actuator.inputs]\nload_n = {of_load}\n\
             [actuator.estimate]\nthickness_mm = {{ prior = 7.9, sigma = 1.0 }}\n[actuator.sigma]\nmarker_mm = 0.01\n\
             [[actuator.marker]]\nname = \"end\"\nnode = {MARKER}\n\
             [actuator.source]\nkind = \"replay\"\ntrace = \"marker.csv\"\n"
        );
        stage.write("estimate.toml", &text)
    };
    let without = scene("\"measured\"").display().to_string();
    let (status, said) = Program::daemon(&stage, &["twin", "--scene", &without]).ended();
    assert!(status.code() == Some(78) && said.join("\n").contains("load_n"), "{said:?}");
    let path = scene("{ sigma = 0.001 }");
    let shown = path.display().to_string();
    let fit = run(&stage, &["calibrate", "--scene", &shown, "--recording", "marker.csv", "--json"]);
    let fit: Value = serde_json::from_str(&fit).expect("JSON");
    let found = fit["estimates"]["thickness_mm"]["value"].as_f64().expect("a number");
    assert!((found - THICKNESS_MM).abs() < 0.05 && fit["readings_skipped"] == 0, "{fit}");
    let twin = Program::twin(&stage, &path);
    let states = StateReader::attach(&stage.bus(), &Topic::state("part").unwrap()).expect("a state");
    let bridge = Program::daemon(&stage, &["bridge", "--scene", &shown]);
    let last = wait_state(&states, "the last reading's state", |state| {
        state.sensor_seq == 40 && state.flags & flags::HELD == 0
    });
    let inputs: Vec<(String, f64, u8)> = last.inputs().map(|i| (i.name, i.value, i.source)).collect();
    let of = |name: &str| inputs.iter().find(|input| input.0 == name).expect("an input");
    assert_eq!(of("load_n").2, input_source::MEASURED);
    assert!((of("load_n").1 - 3.45).abs() < 0.01, "{inputs:?}");
    assert_eq!(of("thickness_mm").2, input_source::ESTIMATED);
    assert!((of("thickness_mm").1 - THICKNESS_MM).abs() < 0.05, "{inputs:?}");
    let (status, said) = bridge.ended();
    assert!(status.success(), "{said:?}");
    assert!(twin.stop().0.success());
}

/// A beam whose tip follows its load late, drifts, or is read wrongly is not the model's: exit code 65, what the residuals show, and no
/// calibrated scene unless forced.
#[test]
fn recording_that_the_model_does_not_explain_calibrates_nothing() {
    let (stage, _) = stage("unexplained");
    let scene = stage.write(
        "wrong.toml",
        &format!(
            "name = \"bench\"\n[[actuator]]\nname = \"part\"\nmodel = \"part.twin\"\n[actuator.inputs]\n\
             load_n = {{ sigma = 0.001 }}\n[actuator.estimate]\nthickness_mm = {{ prior = 7.9, sigma = 1.0 }}\n\
             [actuator.sigma]\nmarker_mm = 0.01\n[[actuator.marker]]\nname = \"end\"\nnode = {MARKER}\n\
             [actuator.source]\nkind = \"replay\"\ntrace = \"wrong.csv\"\n"
        ),
    );
    let load_n = |t_s: f64| 2.2 + 0.9 * (1.5 * t_s).sin();
    // First order with this time constant, its start passed.
    let late_n = |t_s: f64, lag_s: f64| {
        let angle = (1.5 * lag_s).atan();
        2.2 + 0.9 * angle.cos() * (1.5 * t_s - angle).sin()
    };
    let calibrate = |more: &[&str], tip: &dyn Fn(usize, f64) -> (f64, f64)| {
        let mut trace = String::from("t_s,load_n,marker1_x_mm,marker1_y_mm,marker1_z_mm\n");
        for at in 0..160 {
            let t_s = 0.05 * at as f64;
            let (of_n, off_mm) = tip(at, t_s);
            let (point, moved, _) = beam(of_n, THICKNESS_MM)[MARKER];
            let [x, y, z] = [0, 1, 2].map(|axis| point[axis] + moved[axis]);
            trace += &format!("{t_s},{},{x},{},{z}\n", load_n(t_s), y + off_mm);
        }
        stage.write("wrong.csv", &trace);
        let scene = scene.display().to_string();
        let fixed =
            ["calibrate", "--scene", &scene, "--recording", "wrong.csv", "--json", "--out", "fitted.toml"];
        let (status, said) = Program::tool(&stage, &[&fixed[..], more].concat()).end();
        let json = said.iter().find(|line| line.starts_with("{\"readings\"")).expect("an answer");
        let answer: Value = serde_json::from_str(json).expect("JSON");
        (status.code(), answer, stage.path("fitted.toml").exists())
    };
    let in_y = |answer: &Value, what: &str| answer["residuals"]["end y"][what].as_f64();
    let (code, late, is_saved) = calibrate(&[], &|_, t_s| (late_n(t_s, 0.3), 0.0));
    assert_eq!((code, is_saved, &late["is_explained"]), (Some(65), false, &Value::Bool(false)), "{late}");
    assert!(in_y(&late, "lag_s").is_some_and(|lag_s| (lag_s - 0.3).abs() < 0.1), "{late}");
    assert!(in_y(&late, "loop_share").is_some_and(|share| share.abs() > 0.1), "{late}");
    let (code, drifts, is_saved) = calibrate(&[], &|_, t_s| (load_n(t_s), 0.05 * (t_s - 4.0)));
    assert_eq!((code, is_saved), (Some(65), false), "{drifts}");
    assert!(in_y(&drifts, "drift_per_s").is_some_and(|drift| (drift - 0.05).abs() < 0.01), "{drifts}");
    let (code, wrong, is_saved) =
        calibrate(&[], &|at, t_s| (load_n(t_s), if at % 3 == 0 { 5.0 } else { 0.0 }));
    assert_eq!((code, is_saved), (Some(65), false), "{wrong}");
    assert!(wrong["outliers"].as_u64().is_some_and(|count| count >= 50), "{wrong}");
    let (code, _, is_saved) = calibrate(&["--force"], &|_, t_s| (late_n(t_s, 0.3), 0.0));
    assert_eq!((code, is_saved), (Some(65), true));
    let (code, right, _) = calibrate(&[], &|_, t_s| (load_n(t_s), 0.0));
    assert_eq!((code, &right["is_explained"]), (Some(0), &Value::Bool(true)), "{right}");
}

#[test]
fn scene_that_measures_an_unknown_input_is_refused() {
    let (stage, scene) = stage("structure-wrong");
    let text = std::fs::read_to_string(&scene).unwrap();
    let refused = |program: &str, from: &str, to: &str, expected: &str| {
        let path = stage.write("wrong.toml", &text.replace(from, to)).display().to_string();
        let (status, said) = Program::daemon(&stage, &[program, "--scene", &path]).ended();
        let said = said.join("\n");
        assert!(status.code() == Some(78) && said.contains(expected), "{said}");
    };
    refused("twin", "load_n = {", "load = {", "did you mean \"load_n\"");
    refused("bridge", "load_n = {", "lod_n = {", "column `lod_n`");
    refused("bridge", "min = 0.5", "min = 5", "expected min below max, found 5 .. 4");
    let formula = "kind = \"simulate\"";
    let replay = "kind = \"replay\"\ntrace = \"load.csv\"";
    refused("bridge", replay, formula, "expected one that can have load_n");
}

#[test]
fn import_command_makes_a_model_from_results() {
    let stage = Stage::with_model("structure-build", &[]);
    let names = simulations(stage.folder.path());
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let pattern = ["--pattern", "beam_f{load_n}_t{thickness_mm}.vtu", "--out", "part/database"];
    let others = ["--length-unit", "m", "--stress-unit", "pa", "--test-every", "3"];
    run(&stage, &[&["import", "results"], &names[..], &pattern, &others].concat());
    let built: Value = serde_json::from_str(&run(&stage, &["build", "part", "--json"])).expect("JSON");
    assert_eq!(built["inputs"], serde_json::json!(["load_n", "thickness_mm"]), "{built:#}");
    // The training's notes are repeated.
    let sheet = std::fs::read_to_string(stage.path("part/part.json")).expect("a data sheet");
    let sheet: Value = serde_json::from_str(&sheet).expect("JSON");
    assert!(built["notes"].is_array() && built["notes"] == sheet["remarks"], "{built:#}");
    let held_back = &built["quality"]["held_back"][0];
    assert!(held_back["states"].as_u64().is_some_and(|states| states > 1), "{built:#}");
    assert!(held_back["displacement"]["percent"][1].as_f64().is_some_and(|error| error < 2.0), "{built:#}");
    // A changed scene is kept under another name.
    let scene = stage.path("part/scene.toml");
    let changed = format!("{}# with a sensor\n", std::fs::read_to_string(&scene).expect("a scene"));
    std::fs::write(&scene, &changed).expect("writable");
    let said = run(&stage, &["build", "part"]);
    assert!(said.contains("part/scene.toml.old"), "{said}");
    assert_eq!(
        std::fs::read_to_string(stage.path("part/scene.toml.old")).expect("the scene before"),
        changed
    );
    let scene = scene.display().to_string();
    let mut twin = Program::daemon(&stage, &["twin", "--scene", &scene]);
    twin.wait_for("ready:");
    let readers = Readers::attach(&stage).expect("the twin's topics");
    let _bridge = Program::daemon(&stage, &["bridge", "--scene", &scene, "--loop"]);
    let mut last_n = f64::NAN;
    let risen = wait_state(&readers.states, "a load that rises, and its field", |state| {
        let load =
            state.inputs().find(|input| input.name == "load_n" && input.source == input_source::MEASURED);
        let load_n = load.map_or(f64::NAN, |load| load.value);
        let has_risen = load_n > last_n && state.outcome == Outcome::Published.code();
        last_n = load_n;
        has_risen
    });
    let thickness = risen.inputs().find(|input| input.name == "thickness_mm").expect("the thickness");
    assert_eq!(thickness.source, input_source::GIVEN);
    wait_for(&readers.fields, "a field", |reader| reader.next().expect("readable").map(drop));
}
