//! The clients' pages and the control loop: what the documentation shows is what runs.

use serde_json::Value;
use std::path::{Path, PathBuf};
use tests::{Program, Stage};

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").canonicalize().unwrap()
}

fn read(path: &str) -> String {
    std::fs::read_to_string(repository().join(path)).unwrap_or_else(|error| panic!("{path}: {error}"))
}

#[test]
fn documents_contain_the_tested_programs() {
    for (page, program) in [
        ("docs/clients/rust.md", "crates/wire/examples/read_twin.rs"),
        ("docs/clients/c.md", "clients/c/examples/twin.c"),
        ("docs/clients/c.md", "clients/c/examples/twin.cpp"),
    ] {
        assert!(read(page).contains(read(program).trim_end()), "{page} does not contain {program}");
    }
}

#[test]
fn documented_rust_program_runs() {
    let stage = Stage::new("rust");
    let scene = stage.write(
        "finger.toml",
        "name = \"s\"\n[[actuator]]\nname = \"finger\"\nmodel = \"beam.twin\"\n[actuator.source]\nkind = \"simulate\"\n\
         gap_mm = 25.0\n[[actuator.output]]\nnodes = \"all\"",
    );
    let (status, said) = Program::shell(&stage, "read_twin").end();
    assert_eq!(status.code(), Some(1), "{said:?}");
    let twin = Program::twin(&stage, &scene);
    let bridge = Program::bridge(&stage, &scene);
    let (status, said) = Program::shell(&stage, "read_twin").end();
    assert!(status.success(), "{said:?}");
    let all = said.join("\n");
    for expected in ["120 nodes", "what if: 0.", "refused: more force than the sampled states give here"] {
        assert!(all.contains(expected), "`{expected}` is missing in {all}");
    }
    drop((bridge, twin));
}

/// Plant, twin and controller, three processes; the plant says from its truth how well it was held.
fn hold(plant_arguments: &str) -> (Value, Value) {
    let stage = Stage::new("control");
    let scene = repository().join("config/scenes/force.toml").display().to_string();
    let twin = Program::twin(&stage, Path::new(&scene));
    let line = format!("softtwin-studies plant --scene {scene} --seconds 3 --target-n 0.3 {plant_arguments}");
    let mut plant = Program::shell(&stage, &line);
    plant.wait_for("ready:");
    let (status, said) =
        Program::shell(&stage, &format!("softtwin hold --json --scene {scene} --force-n 0.3")).end();
    // The plant has ended first.
    assert_eq!(status.code(), Some(1), "{said:?}");
    let report = said.iter().find(|line| line.contains("\"setpoints\"")).unwrap();
    let controller: Value = serde_json::from_str(report).unwrap();
    let (status, said) = plant.end();
    assert!(status.success(), "{said:?}");
    drop(twin);
    let truth: Value = serde_json::from_str(said.last().unwrap()).unwrap();
    println!("{}", serde_json::json!({ "plant": truth, "controller": controller }));
    (truth, controller)
}

#[test]
fn force_is_held_with_a_wrong_assumed_gap() {
    for gap in ["--true-gap-mm 33", "--true-gap-mm 27"] {
        let (truth, controller) = hold(gap);
        let response = &truth["response"];
        assert!(response["settling_s"].is_f64(), "{gap}: not settled: {truth}");
        assert!(response["overshoot"].as_f64().is_some_and(|share| share < 0.05), "{gap}: {truth}");
        assert!(response["final_error"].as_f64().is_some_and(|share| share.abs() < 0.03), "{gap}: {truth}");
        assert!(controller["setpoints"].as_u64().is_some_and(|count| count > 50));
    }
}

#[test]
fn unreachable_force_is_refused_before_any_setpoint() {
    let stage = Stage::new("reach");
    let scene = repository().join("config/scenes/force.toml");
    let twin = Program::twin(&stage, &scene);
    let line = format!("softtwin hold --scene {} --force-n 9 --gap 30", scene.display());
    let (status, said) = Program::shell(&stage, &line).end();
    assert_eq!(status.code(), Some(1), "{said:?}");
    let line = format!("softtwin hold --simulate --scene {} --force-n 9", scene.display());
    let (status, said) = Program::shell(&stage, &line).end();
    assert_eq!(status.code(), Some(2), "{said:?}");
    drop(twin);
}
