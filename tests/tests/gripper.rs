//! The gripper of the paper: two mirrored fingers, one pressure source, and whether they hold the object.

use runtime::config::Scene;
use runtime::grasp::GraspModel;
use serde_json::Value;
use std::path::{Path, PathBuf};
use tests::{Program, Stage};
use wire::layout::{flags, grasp_status};

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").canonicalize().unwrap()
}

fn gripper() -> GraspModel {
    let path = repository().join("config/scenes/gripper.toml");
    let scene = Scene::load(&path).unwrap_or_else(|error| panic!("{error}"));
    GraspModel::load(&scene, &path).unwrap().unwrap()
}

#[test]
fn published_gripper_case_is_reproduced() {
    let mut gripper = gripper();
    let grasp = gripper.at(0.079, f64::NAN);
    // The paper's twin says 0.58 N; our own finite elements 0.5863 N (case `force` of the database).
    let forces: Vec<f64> = grasp.fingers().map(|(force, _)| force).collect();
    assert_eq!(forces.len(), 2);
    for force in forces {
        assert!((force - 0.58).abs() < 0.02 * 0.58, "{force} N");
        assert!((force - 0.58626).abs() < 0.005 * 0.58626, "{force} N");
    }
    assert_eq!((grasp.grasp_status, grasp.flags), (grasp_status::HELD, 0));
    assert!(
        grasp.needed_friction < 0.2,
        "17 g must be held at the paper's friction: {}",
        grasp.needed_friction
    );
    // At the stop point the force is the needed one: just below it is not held, just above it is.
    let stop = grasp.stop_pressure_mpa;
    assert!((0.03..0.079).contains(&stop), "{stop} MPa");
    assert_eq!(gripper.at(stop - 1e-5, f64::NAN).grasp_status, grasp_status::NOT_HELD);
    assert_ne!(gripper.at(stop + 1e-5, f64::NAN).grasp_status, grasp_status::NOT_HELD);
    assert!((gripper.at(stop, f64::NAN).least_force_n - gripper.needed_force_n()).abs() < 1e-6);
}

#[test]
fn measured_gap_is_ignored_without_gap_input() {
    let mut gripper = gripper();
    let mut last = -1.0;
    for step in 0..=90 {
        let grasp = gripper.at(0.001 * f64::from(step), f64::NAN);
        assert_eq!(grasp.flags & flags::OUTSIDE_DOMAIN, 0, "step {step}");
        assert!(
            grasp.least_force_n.is_finite() && grasp.least_force_n >= last - 2e-3,
            "step {step}: {grasp:?}"
        );
        last = grasp.least_force_n;
    }
}

#[test]
fn too_heavy_object_has_no_stop_point() {
    let path = repository().join("config/scenes/gripper.toml");
    let mut scene = Scene::load(&path).unwrap();
    scene.grasp.as_mut().unwrap().mass_g = 500.0;
    let grasp = GraspModel::load(&scene, &path).unwrap().unwrap().at(0.09, f64::NAN);
    assert_eq!(grasp.grasp_status, grasp_status::NOT_HELD);
    assert!(grasp.stop_pressure_mpa.is_nan() && grasp.margin < 0.0);
}

#[test]
fn grasp_is_published_from_one_pressure_source() {
    let stage = Stage::new("gripper");
    let scene = repository().join("config/scenes/gripper.toml");
    let twin = Program::twin(&stage, &scene);
    let bridge = Program::bridge(&stage, &scene);
    let (status, said) =
        Program::tool(&stage, &["echo", "softtwin/gripper/grasp", "--count", "50", "--json"]).end();
    assert!(status.success(), "{said:?}");
    let grasps: Vec<Value> =
        said.iter().map(|line| serde_json::from_str::<Value>(line).unwrap()["sample"].clone()).collect();
    let newest = grasps.last().unwrap();
    assert_eq!(newest["scene"], "gripper");
    let both = |key: &str| {
        let values: Vec<f64> = newest[key].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
        (values[0], values[1], values.len())
    };
    let (left, right, count) = both("pressures_mpa");
    assert_eq!((left, count), (right, 2), "both fingers hang on one source");
    let (left, right, _) = both("forces_n");
    assert_eq!(left, right, "the same model at the same pressure");
    assert!(newest["stop_pressure_mpa"].as_f64().is_some_and(|stop| stop > 0.03), "{newest}");
    drop((bridge, twin));
}

#[test]
fn grasp_with_two_pressure_sources_uses_the_weaker_finger() {
    let stage = Stage::new("twosources");
    let models = format!("\"{}/models", repository().display());
    let profile = |mpa: f64| format!("shape = \"step\"\nlow_mpa = {mpa}\nhigh_mpa = {mpa}\nat_s = 0.0\n");
    let text = std::fs::read_to_string(repository().join("config/scenes/gripper.toml")).unwrap();
    let (head, rest) = text.split_once("shape = \"sine\"").unwrap();
    let (_, tail) = rest.split_once("frequency_hz = 0.2\n").unwrap();
    let own_source = tail.lines().filter(|line| !line.starts_with("sensor =")).collect::<Vec<_>>().join("\n");
    let scene = format!(
        "{head}{}{own_source}\n[actuator.source]\nkind = \"simulate\"\nrate_hz = 200.0\n[actuator.source.profile]\n{}",
        profile(0.079),
        profile(0.05)
    );
    let scene = stage.write("gripper.toml", &scene.replace("\"../../models", &models));
    let twin = Program::twin(&stage, &scene);
    let bridge = Program::bridge(&stage, &scene);
    // The first grasps may know one finger only.
    let (status, said) =
        Program::tool(&stage, &["echo", "softtwin/gripper/grasp", "--count", "100", "--json"]).end();
    assert!(status.success(), "{said:?}");
    let newest = serde_json::from_str::<Value>(said.last().unwrap()).unwrap()["sample"].clone();
    let number = |value: &Value| value.as_f64().unwrap_or_else(|| panic!("{newest}"));
    let pair = |key: &str| (number(&newest[key][0]), number(&newest[key][1]));
    assert_eq!(pair("pressures_mpa"), (0.079, 0.05), "each finger has its own gauge");
    let (strong, weak) = pair("forces_n");
    assert!(strong > 0.5 && weak > 0.0 && weak < 0.6 * strong, "{newest}");
    assert_eq!(number(&newest["least_force_n"]), weak, "the weaker finger counts");
    drop((bridge, twin));
}

#[test]
fn contradictory_grasp_scene_is_refused_with_all_errors() {
    let stage = Stage::new("contradiction");
    let path = stage.write(
        "scene.toml",
        r#"
        name = "two words"
        [grasp]
        mass_g = -1.0
        friction = 0.2
        fingers = ["left", "middle"]
        [[block]]
        min_mm = [0.0, 0.0, 0.0]
        max_mm = [1.0, -1.0, 1.0]
        [[actuator]]
        name = "left"
        model = "beam.twin"
        sensor = "right"
        [actuator.source]
        kind = "simulate"
        "#,
    );
    let error = Scene::load(&path).unwrap_err().to_string();
    for expected in [
        "mass_g",
        "grasp's topic",
        "no actuator is called `middle`",
        "2 to 8 fingers",
        "block[0]",
        "leave one out",
    ] {
        assert!(error.contains(expected), "`{expected}` is missing in {error}");
    }
}
