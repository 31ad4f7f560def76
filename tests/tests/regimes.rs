//! A twin serves a structure with regimes of its own names from readings of its load: number, field and answer are those of the
//! regime that the model finds.

use formats::npy;
use serde_json::Value;
use tests::strip::{self, simulations};
use tests::wait::{wait_for, wait_state, wait_until};
use tests::{Program, Stage};
use wire::layout::{flags, regime};
use wire::{FieldReader, KeyExpr, StateReader, Topic};

/// What the trace has, and the regime with an imperfection of [`IMPERFECTION_MM`].
const LOADS: [(f64, &str, u32); 3] =
    [(5.0, "straight", regime::NAMED1), (13.0, "up", regime::NAMED3), (15.5, "up", regime::NAMED3)];
const IMPERFECTION_MM: f64 = 0.25;

fn run(stage: &Stage, arguments: &[&str]) -> String {
    let (status, said) = Program::tool(stage, arguments).end();
    assert!(status.success(), "{arguments:?}: {said:?}");
    said.join("\n")
}

#[test]
fn a_strip_is_served_in_the_regime_of_each_reading() {
    let stage = Stage::with_model("regimes", &[]);
    let names = simulations(stage.folder.path(), 80);
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let more = ["--inputs", "inputs.csv", "--out", "db", "--length-unit", "m", "--stress-unit", "pa"];
    run(&stage, &[&["import", "results"], &names[..], &more].concat());
    run(&stage, &["train", "--database", "db", "--out", "strip.twin"]);
    let rows = LOADS.iter().enumerate().map(|(at, (load, ..))| format!("{},{load}\n", 0.01 * at as f64));
    stage.write("load.csv", &format!("t_s,load_n\n{}", rows.collect::<String>()));
    let scene = stage.write(
        "strip.toml",
        &format!(
            "name = \"bench\"\n[[actuator]]\nname = \"strip\"\nmodel = \"strip.twin\"\nbacklog = 64\n\
             [actuator.inputs]\nload_n = {{ min = 2, max = 20 }}\nimperfection_mm = {IMPERFECTION_MM}\n\
             [actuator.source]\nkind = \"replay\"\ntrace = \"load.csv\"\n[[actuator.output]]\n"
        ),
    );
    let scene = scene.display().to_string();
    let mut twin = Program::daemon(&stage, &["twin", "--scene", &scene]);
    twin.wait_for("regimes straight (regime 3) and down (regime 4) and up (regime 5)");
    twin.wait_for("ready:");
    let bus = stage.bus();
    let states = StateReader::attach(&bus, &Topic::state("strip").unwrap()).expect("a state");
    let fields = FieldReader::attach(&bus, &Topic::field("strip", None).unwrap()).expect("a field");
    let mut recorder = Program::tool(&stage, &["record", "--out", "run.mcap", "--fields"]);
    wait_listening(&bus, "softtwin/strip/**", &recorder);
    let bridge = Program::daemon(&stage, &["bridge", "--scene", &scene]);
    twin.wait_for("strip: regime straight");
    twin.wait_for("strip: regime up");
    let mut seen = Vec::new();
    wait_state(&states, "the last reading's state", |state| {
        if state.flags & (flags::NO_DATA | flags::STALE) == 0 {
            seen.push(state.regime);
        }
        seen.len() == LOADS.len()
    });
    assert_eq!(seen, LOADS.map(|(.., number)| number));
    let mut served: Vec<Vec<f32>> = Vec::new();
    wait_for(&fields, "the fields", |reader| {
        while let Some(field) = reader.next().expect("readable") {
            served.push(field.values().to_vec());
        }
        (served.len() == LOADS.len()).then_some(())
    });
    for ((load, name, _), field) in LOADS.iter().zip(&served) {
        let set = [format!("load_n={load}"), format!("imperfection_mm={IMPERFECTION_MM}")];
        let out = ["--set", &set[0], "--set", &set[1], "--out", "state.npy"];
        let said = run(&stage, &[&["predict", "--model", "strip.twin"], &out[..]].concat());
        let answer: Value = serde_json::from_str(&said).expect("JSON");
        assert_eq!(answer["regime"], *name, "{answer}");
        let array = npy::read_f32(&stage.path("state.npy")).expect("an array");
        let (nodes, count) = (array.shape[0], array.shape[1]);
        let exact =
            (0..count).flat_map(|k| (0..nodes).map(move |node| node * count + k)).map(|at| array.data[at]);
        let largest = array.data.iter().fold(0.0_f32, |largest, value| largest.max(value.abs()));
        let off = field.iter().zip(exact).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(
            field.len() == array.data.len() && off <= 2.0 * f32::EPSILON * largest,
            "{load} N: off by {off}"
        );
    }
    // Programs without the model learn the names from the twin.
    for (arguments, text) in [
        (&["echo", "softtwin/strip/state", "--once"][..], "  up "),
        (&["echo", "softtwin/strip/state", "--once", "--json"], "\"regime\":\"up\""),
        (&["top", "--once"], " up "),
        (&["top", "--once", "--json"], "\"regime\":\"up\""),
        (&["list", "softtwin/strip/state", "--long"], "  up "),
        (&["get", "softtwin/strip/whatif?load_n=5"], "  straight "),
        (&["get", "softtwin/strip/whatif?load_n=13", "--json"], "\"regime\":\"up\""),
    ] {
        wait_until(text, || {
            let said = Program::tool(&stage, arguments).end().1.join("\n");
            said.contains(text).then_some(())
        });
    }
    // In a domain of its own, with the lines of the fields as they come.
    let said = run(&stage, &["demo", "--scene", &scene, "--json"]);
    assert!(said.contains("\"regimes\":{\"straight\":1,\"up\":2}"), "{said}");
    assert!(bridge.ended().0.success());
    recorder.signal(libc::SIGINT);
    assert!(recorder.end().0.success());
    assert!(twin.stop().0.success());
    recorded(&stage);
}

/// Readers that saw the model before say the names of the one that a reload brings; between the two a state says none. A reload that
/// is refused leaves the names as they are.
#[test]
fn a_reload_brings_the_names_of_the_other_model() {
    let stage = Stage::with_model("regimenames", &[]);
    let scene = strip::scene(&stage, &strip::model_bytes(["straight", "up", "down"]));
    let mut twin = Program::twin(&stage, &scene);
    let bus = stage.bus();
    let mut loads = strip::Loads::new(&bus);
    let mut echo = Program::tool(&stage, &["echo", "softtwin/strip/state", "--json"]);
    wait_listening(&bus, "softtwin/strip/state", &echo);
    loads.send(13.0);
    echo.wait_for("\"regime\":\"up\"");
    twin.wait_for("strip: regime up");
    let reload = |twin: &mut Program, names, outcome| {
        std::fs::write(stage.path("strip.twin"), strip::model_bytes(names)).unwrap();
        twin.signal(libc::SIGHUP);
        twin.wait_for(outcome);
    };
    reload(&mut twin, ["rest", "high", "low"], "reloaded: ");
    echo.wait_for("\"regime\":\"unknown\"");
    loads.send(13.0);
    echo.wait_for("\"regime\":\"high\"");
    twin.wait_for("strip: regime high");
    let text = std::fs::read_to_string(&scene).unwrap();
    stage.write("strip.toml", &text.replace("name = \"strip\"", "name = \"other\""));
    reload(&mut twin, ["rest", "left", "right"], "start the twin anew");
    let late =
        Program::tool(&stage, &["echo", "softtwin/strip/state", "--once", "--json"]).end().1.join("\n");
    assert!(late.contains("\"regime\":\"high\""), "{late}");
    drop(echo);
    assert!(twin.stop().0.success());
}

/// Waits until a program reads all topics of a key.
fn wait_listening(bus: &wire::Bus, key: &str, program: &Program) {
    let all = KeyExpr::new(key).expect("a key");
    wait_until("a program that listens", || {
        let found = bus.topics(&all).expect("topics");
        let is_read = |info: &wire::TopicInfo| info.readers.contains(&program.id());
        (found.iter().filter(|info| is_read(info)).count() == found.len()).then_some(())
    });
}

/// A recording has the names beside its messages: without twin and model its tables say them.
fn recorded(stage: &Stage) {
    run(stage, &["export", "run.mcap", "--out", "tables"]);
    for topic in ["state", "field"] {
        let path = stage.path(&format!("tables/softtwin.strip.{topic}.csv"));
        let table = std::fs::read_to_string(path).expect("a table");
        let mut rows = table.lines().map(|line| line.split(',').collect::<Vec<_>>());
        let at = rows.next().expect("a head").iter().position(|name| *name == "regime").expect("a column");
        let mut found: Vec<&str> = rows.map(|row| row[at]).filter(|name| *name != "unknown").collect();
        found.dedup();
        assert_eq!(found, ["straight", "up"], "{topic}: {table}");
    }
}
