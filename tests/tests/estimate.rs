//! Estimation with readings of a known truth: a twin that follows them, `softtwin calibrate` that fits them.

use rom::evaluator::Query;
use rom::inputs::Inputs;
use rom::memory::{InputMemory, Line, Play, Slopes};
use rom::model::Model;
use rom::probe::{MeshPoint, ProbePosition, Probes};
use rom::rng::Rng;
use serde_json::Value;
use std::fmt::Write as _;
use std::io::{Read, Write as _};
use std::net::{SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use tests::process::binary;
use tests::wait::{states, wait_for, wait_state};
use tests::{Program, Stage};
use wire::layout::{estimate_alarm, estimate_status, flags, input_source};
use wire::{EstimateReader, StateReader, Topic};

pub(crate) const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");

/// A slow inflation over a plate at a gap, read by a gauge with a bias, a load cell and a camera at the tip: a table.
fn recording(gap_mm: f64, bias_mpa: f64) -> String {
    readings(&inflation(), [gap_mm, bias_mpa, 0.0], true)
}

/// Times and pressures of ten seconds: an inflation, then part of a deflation, without which play is not distinguishable from a bias.
pub(crate) fn inflation() -> Vec<(f64, f64)> {
    let pressure = |k: u32| f64::from(k.min(600 - k)) * 0.095 / 300.0;
    (0..400).map(|k| (f64::from(k) * 0.025, pressure(k))).collect()
}

/// A table of readings at times and pressures, with a gap, a gauge's bias, and what the load cell shows where nothing touches.
/// Their truth is the model of the reference actuator, which is not the scene's.
fn readings(states: &[(f64, f64)], [gap_mm, bias_mpa, zero_n]: [f64; 3], with_markers: bool) -> String {
    let model = committed("pneunet");
    table(&model, states, [gap_mm, bias_mpa, zero_n], with_markers)
}

pub(crate) fn committed(name: &str) -> Model {
    let bytes = std::fs::read(format!("{ROOT}/models/{name}/{name}.twin")).expect("a committed model");
    Model::from_bytes(&bytes).expect("a model")
}

fn table(model: &Model, states: &[(f64, f64)], truth: [f64; 3], with_markers: bool) -> String {
    let acting: Vec<f64> = states.iter().map(|(_, pressure_mpa)| *pressure_mpa).collect();
    table_behind(model, states, &acting, truth, with_markers)
}

/// The same where other pressures act than those that are measured.
fn table_behind(
    model: &Model,
    states: &[(f64, f64)],
    acting_mpa: &[f64],
    [gap_mm, bias_mpa, zero_n]: [f64; 3],
    with_markers: bool,
) -> String {
    let tip = MeshPoint::at(model, [115.0, 2.0, 16.0]).expect("the tip");
    let probes = Probes::new(model, &[tip]).expect("probes");
    let (mut evaluation, mut at) = (probes.evaluation(), [ProbePosition::default()]);
    let mut random = Rng::new(17);
    let mut normal = || (0..12).map(|_| random.uniform()).sum::<f64>() - 6.0;
    let mut text = String::from("t_s,pressure_mpa,measured_force_n");
    text += if with_markers { ",marker1_x_mm,marker1_y_mm,marker1_z_mm\n" } else { "\n" };
    for (k, (t_s, pressure_mpa)) in states.iter().copied().enumerate() {
        probes.answer(Inputs::new(acting_mpa[k], gap_mm), Query::GRADIENTS, &mut evaluation, &mut at);
        let measured = pressure_mpa + bias_mpa + 0.0005 * normal();
        let force = evaluation.contact_force_n + zero_n + 0.005 * normal();
        write!(text, "{t_s},{measured},{force}").expect("memory");
        if with_markers {
            let [x, y, z] = at[0].position_mm.map(|x| x + 0.2 * normal());
            let row = if k % 10 == 3 { ",,,".into() } else { format!(",{x},{y},{z}") };
            text += &row;
        }
        text += "\n";
    }
    text
}

/// Unknown of a scene in addition to gap and gauge bias.
#[derive(Clone, Copy, PartialEq)]
enum Stiffness {
    Known,
    Unknown,
}

/// The shipped scene, for any folder, without the trace that it replays.
fn shipped(stiffness: Stiffness) -> String {
    let text =
        std::fs::read_to_string(format!("{ROOT}/config/scenes/estimate.toml")).expect("the shipped scene");
    let unknown = |line: &&str| line.starts_with("\"elastomer.law.mu_mpa\" = {");
    assert_eq!(text.lines().filter(unknown).count(), 1, "the stiffness is an unknown of the shipped scene");
    let (before, source) = text.split_once("[actuator.source]").expect("the shipped scene replays a trace");
    let (_, after) = source.split_once("[[actuator.output]]").expect("an output after it");
    let text = format!("{before}[[actuator.output]]{after}");
    let kept = text.lines().filter(|line| stiffness == Stiffness::Unknown || !unknown(line));
    kept.collect::<Vec<_>>().join("\n").replace("../../models", &format!("{ROOT}/models"))
}

fn write_scene(folder: &Path, stiffness: Stiffness) -> PathBuf {
    let path = folder.join("scene.toml");
    std::fs::write(&path, shipped(stiffness)).expect("a scene");
    path
}

fn calibrate(folder: &Path, table: &str, extra: &[&str]) -> Output {
    calibrate_with(folder, Stiffness::Known, table, extra)
}

fn calibrate_with(folder: &Path, stiffness: Stiffness, table: &str, extra: &[&str]) -> Output {
    let recording = folder.join("run.csv");
    std::fs::write(&recording, table).expect("a table");
    Command::new(binary("softtwin"))
        .args(["calibrate", "--scene"])
        .arg(write_scene(folder, stiffness))
        .args(["--json", "--recording"])
        .arg(recording)
        .args(extra)
        .output()
        .expect("softtwin")
}

fn json(output: &Output) -> Value {
    let text = String::from_utf8_lossy(&output.stdout);
    serde_json::from_str(&text)
        .unwrap_or_else(|e| panic!("{e}: {text}{}", String::from_utf8_lossy(&output.stderr)))
}

#[test]
fn fit_of_gap_and_bias_writes_a_scene_that_runs() {
    let folder = tempfile::tempdir().expect("a folder");
    let [out, picture] = ["calibrated.toml", "fit.svg"].map(|name| folder.path().join(name));
    let extra: Vec<&str> = vec!["--out", path(&out), "--picture", path(&picture)];
    let output = calibrate(folder.path(), &recording(46.0, 0.0012), &extra);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let found = json(&output);
    let (gap, bias) = (&found["estimates"]["gap_mm"], &found["estimates"]["pressure_bias_mpa"]);
    assert_eq!(
        (&found["converged"], &gap["identifiable"], &bias["identifiable"]),
        (&true.into(), &true.into(), &true.into()),
        "{found}"
    );
    let off = |estimate: &Value, truth: f64| (estimate["value"].as_f64().expect("a value") - truth).abs();
    assert!(off(gap, 46.0) < 0.25 && off(bias, 0.0012) < 0.0006, "{found}");
    let chi2 = found["chi2_per_dof"].as_f64().expect("a number");
    assert!((0.8..1.25).contains(&chi2), "{found}");
    assert!(std::fs::read_to_string(picture).expect("a picture").contains("<svg"));
    let scene = runtime::config::Scene::load(&out).expect("the scene is valid");
    assert!((scene.actuators[0].estimate["gap_mm"].prior - 46.0).abs() < 0.25);
    assert!(scene.actuators[0].model.exists());
}

#[test]
fn fit_finds_stiffness_gap_and_bias() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut softer = committed("pneunet-design");
    softer.header.set_parameters([("elastomer.law.mu_mpa", 0.71)]).expect("a parameter");
    let table = table(&softer, &inflation(), [46.0, 0.0012, 0.0], true);
    let output = calibrate_with(folder.path(), Stiffness::Unknown, &table, &[]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let found = json(&output);
    let truths =
        [("gap_mm", 46.0, 0.25), ("pressure_bias_mpa", 0.0012, 0.0012), ("elastomer.law.mu_mpa", 0.71, 0.02)];
    for (name, truth, allowed) in truths {
        let estimate = &found["estimates"][name];
        let off = (estimate["value"].as_f64().expect("a value") - truth).abs();
        assert_eq!(estimate["identifiable"], true, "{found}");
        assert!(
            off < allowed && off < 3.0 * estimate["sigma"].as_f64().expect("a number"),
            "{name}: {found}"
        );
    }
    assert_eq!(found["converged"], true, "{found}");
}

/// Three inflations in 20 s through a line (filling in 0.3 s, emptying in 0.9 s) and play of +-2.25 kPa.
#[test]
fn memory_is_identified_beside_stiffness_gap_and_bias_and_then_used() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut softer = committed("pneunet-design");
    softer.header.set_parameters([("elastomer.law.mu_mpa", 0.72)]).expect("a parameter");
    let times: Vec<f64> = (0..400).map(|k| 0.05 * f64::from(k)).collect();
    let pressure = |t_s: &f64| 0.047 * (1.0 - (std::f64::consts::TAU * t_s / 6.7).cos());
    let measured: Vec<f64> = times.iter().map(pressure).collect();
    let block = InputMemory {
        input: 0,
        range: [0.0, 0.095],
        line: Some(Line { fill_s: 0.3, empty_s: 0.9 }),
        orifice: None,
        play: vec![Play { threshold: 0.00225, weight: 1.0 }],
        creep: Vec::new(),
        slopes: Slopes::default(),
    };
    let acting = block.responses(&times, &measured);
    let states: Vec<(f64, f64)> = times.iter().copied().zip(measured).collect();
    let table = table_behind(&softer, &states, &acting, [46.0, 0.0012, 0.0], true);
    let truths = [("gap_mm", 46.0), ("pressure_bias_mpa", 0.0012), ("elastomer.law.mu_mpa", 0.72)];
    let are_found = |found: &Value| {
        for (name, truth) in truths {
            let estimate = &found["estimates"][name];
            let off = (estimate["value"].as_f64().expect("a value") - truth).abs();
            assert!(off < 3.0 * estimate["sigma"].as_f64().expect("a number"), "{name}: {found}");
        }
        assert_eq!(found["estimates"]["elastomer.law.mu_mpa"]["identifiable"], true, "{found}");
        assert_eq!(found["is_explained"], true, "{found}");
    };
    // Without memory the recording is not explained.
    let output = calibrate_with(folder.path(), Stiffness::Unknown, &table, &[]);
    assert_eq!(output.status.code(), Some(65), "{}", String::from_utf8_lossy(&output.stderr));
    let [model, out] = ["remembers.twin", "calibrated.toml"].map(|name| folder.path().join(name));
    let extra = ["--memory", path(&model), "--out", path(&out)];
    let output = calibrate_with(folder.path(), Stiffness::Unknown, &table, &extra);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let found = json(&output);
    are_found(&found);
    let blocks = found["memory"]["blocks"].as_array().expect("blocks");
    let kept = |name: &str| blocks.iter().find(|b| b["block"] == name && b["kept"] == true);
    assert!(kept("single play").is_some(), "{found}");
    let line = &kept("line").unwrap_or_else(|| panic!("{found}"))["constants"];
    for (at, truth) in [0.3, 0.9].into_iter().enumerate() {
        let value = line[at]["value"].as_f64().expect("a number");
        assert!((value / truth - 1.0).abs() < 0.2, "{found}");
    }
    // The scene names the model with its memory, which explains the recording without a search.
    let recording = folder.path().join("run.csv");
    let again = ["calibrate", "--scene", path(&out), "--recording", path(&recording), "--json"];
    let again = json(&Command::new(binary("softtwin")).args(again).output().expect("softtwin"));
    let stiffness = again["estimates"]["elastomer.law.mu_mpa"]["value"].as_f64().expect("a value");
    assert!(again["is_explained"] == true && (stiffness - 0.72).abs() < 0.02, "{again}");
}

/// The trace comes from a mesh that no model of the project was trained on; its comments say what is hidden.
#[test]
fn fit_of_the_shipped_trace_finds_its_true_values() {
    let trace = format!("{ROOT}/config/traces/estimate.csv");
    let text = std::fs::read_to_string(&trace).expect("the shipped trace");
    let output = Command::new(binary("softtwin"))
        .args([
            "calibrate",
            "--scene",
            &format!("{ROOT}/config/scenes/estimate.toml"),
            "--recording",
            &trace,
            "--json",
        ])
        .output()
        .expect("softtwin");
    let found = json(&output);
    let bounds = [("gap_mm", 0.25), ("elastomer.law.mu_mpa", 0.016), ("pressure_bias_mpa", 0.0006)];
    for (name, bound) in bounds {
        let hidden = text.lines().find_map(|line| line.strip_prefix(&format!("# hidden: {name} = ")));
        let hidden: f64 = hidden.expect("a comment").parse().expect("a number");
        let off = (found["estimates"][name]["value"].as_f64().expect("a value") - hidden).abs();
        // One inflation hardly distinguishes a bias of the gauge from play.
        let is_told = name == "pressure_bias_mpa" || found["estimates"][name]["identifiable"] == true;
        assert!(off < bound && is_told, "{name}: {hidden}, {found}");
    }
}

#[test]
fn gap_and_bias_are_unidentifiable_from_force_alone() {
    let folder = tempfile::tempdir().expect("a folder");
    let rising: Vec<(f64, f64)> =
        (0..400).map(|k| (f64::from(k) * 0.025, f64::from(k) * 0.095 / 400.0)).collect();
    let table = readings(&rising, [46.0, 0.0012, 0.0], false);
    let found = json(&calibrate(folder.path(), &table, &[]));
    assert_eq!(found["converged"], true, "{found}");
    for (name, truth) in [("gap_mm", 46.0), ("pressure_bias_mpa", 0.0012)] {
        let estimate = &found["estimates"][name];
        assert_eq!(estimate["identifiable"], false, "{found}");
        let off = (estimate["value"].as_f64().expect("a value") - truth).abs();
        assert!(off < 3.0 * estimate["sigma"].as_f64().expect("a number"), "confident and wrong: {found}");
    }
}

#[test]
fn unfittable_unknowns_are_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let output = calibrate(folder.path(), "t_s,pressure_mpa\n0,0.01\n1,0.02\n", &[]);
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(78), "{text}");
    assert!(text.contains("measured_force_n"), "{text}");
    let finger = format!("{ROOT}/config/scenes/finger.toml");
    let output = Command::new(binary("softtwin"))
        .args(["calibrate", "--scene", &finger, "--recording", "none.csv"])
        .output()
        .expect("softtwin");
    assert!(String::from_utf8_lossy(&output.stderr).contains("[actuator.estimate]"));
}

/// Shipped scene with known stiffness and a trace replayed at five times its speed.
fn scene(stage: &Stage, readings: &str) -> PathBuf {
    scene_at(stage, readings, 5.0)
}

/// A scene that replays readings at `speed` times the pace at which they were measured.
fn scene_at(stage: &Stage, readings: &str, speed: f64) -> PathBuf {
    stage.write("run.csv", readings);
    let text = shipped(Stiffness::Known);
    let source = format!(
        "[actuator.source]\nkind = \"replay\"\ntrace = \"run.csv\"\nspeed = {speed:?}\n[[actuator.output]]"
    );
    stage.write("estimate.toml", &text.replace("[[actuator.output]]", &source))
}

#[test]
fn running_twin_estimates_gap_and_bias_and_publishes_that_state() {
    let stage = Stage::new("estimate");
    let scene = scene(&stage, &recording(46.0, 0.0012));
    let twin = Program::twin(&stage, &scene);
    let bus = stage.bus();
    let estimates =
        EstimateReader::attach(&bus, &Topic::estimate("finger").expect("a topic")).expect("a reader");
    let published = states(&bus);
    let _bridge = Program::bridge(&stage, &scene);
    let last = wait_for(&estimates, "an identifiable gap", |reader| {
        let newest = reader.newest().expect("readable")?;
        (newest.identifiable == 0b11 && newest.sigmas[0] < 0.4).then_some(newest)
    });
    assert_eq!((last.name(0), last.name(1)), ("gap_mm".into(), "pressure_bias_mpa".into()));
    assert_eq!((last.status, last.unknown_count, last.input_count), (estimate_status::USED, 2, 7));
    assert!((last.values[0] - 46.0).abs() < 4.0 * last.sigmas[0], "{last:?}");
    assert!((last.values[1] - 0.0012).abs() < 4.0 * last.sigmas[1], "{last:?}");
    assert!(last.force_sigma_n > 0.0 && last.force_sigma_n < 0.04, "{last:?}");
    // The state is that of the estimated inputs, and its half-width contains the estimate's.
    let state =
        wait_state(&published, "a state of a later reading", |state| state.sensor_seq > last.sensor_seq);
    assert!((state.gap_mm - 46.0).abs() < 0.5, "{state:?}");
    let sources: Vec<u8> = state.inputs().map(|input| input.source).collect();
    let [estimated, nominal] = [input_source::ESTIMATED, input_source::NOMINAL];
    assert_eq!(sources, [estimated, estimated, nominal, nominal, nominal, nominal, nominal]);
    assert!(f64::from(state.force_halfwidth_n) > 1.6 * last.force_sigma_n * 0.5, "{state:?}");
    // The commands that watch show it.
    let (status, table) = Program::tool(&stage, &["top", "--once"]).end();
    let table = table.join("\n");
    assert!(status.success() && table.contains("gap_mm 4") && !table.contains("ALARM"), "{table}");
    let (status, top) = Program::tool(&stage, &["top", "--once", "--json"]).end();
    let top: Value = serde_json::from_str(&top.join("\n")).expect("JSON");
    assert!(status.success() && top[0]["estimate"]["values"][0].is_number(), "{top}");
    assert!(twin.stop().0.success());
}

#[test]
fn unzeroed_load_cell_raises_an_alarm_that_names_it() {
    let stage = Stage::new("estimate-zero");
    // At the pace of the bench: faster, a busy machine reaches the end of the readings before the twin has seen enough of them.
    let scene = scene_at(&stage, &readings(&inflation(), [46.0, 0.0012, 0.08], true), 1.0);
    let twin = Program::twin(&stage, &scene);
    let topic = Topic::estimate("finger").expect("a topic");
    let estimates = EstimateReader::attach(&stage.bus(), &topic).expect("a reader");
    let states =
        StateReader::attach(&stage.bus(), &Topic::state("finger").expect("a topic")).expect("a reader");
    let _bridge = Program::bridge(&stage, &scene);
    let first = wait_for(&estimates, "the first estimate", |reader| reader.newest().expect("readable"));
    // On a machine that pauses the twin, residuals may first be unexplained.
    let alarmed = wait_for(&estimates, "the alarm that names the load cell", |reader| {
        let names_it = |alarm, suspects| alarm == estimate_alarm::SENSOR && suspects == 0b1;
        reader.newest().expect("readable").filter(|estimate| names_it(estimate.alarm, estimate.suspects))
    });
    let after_ns = alarmed.t_sensor_ns.saturating_sub(first.t_sensor_ns);
    assert!(after_ns < 5_000_000_000, "{after_ns} ns of the ten seconds of readings");
    // The state has the flag with which a valve closes.
    wait_for(&states, "a state with the alarm", |reader| {
        reader.next().expect("readable").filter(|state| state.flags & flags::ESTIMATE_ALARM != 0)
    });
    assert!(twin.stop().0.success());
}

#[test]
fn plan_lists_identifying_sensors_and_predicted_deviations() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = write_scene(folder.path(), Stiffness::Known);
    let plan = |extra: &[&str]| {
        let arguments = ["calibrate", "--plan", "--scene", path(&scene), "--json"];
        json(&Command::new(binary("softtwin")).args(arguments).args(extra).output().expect("softtwin"))
    };
    let found = plan(&["--gap", "46", "--holds", "5"]);
    let plans = found["plans"].as_array().expect("plans");
    assert_eq!(plans.len(), 3, "force, markers, both: {found}");
    assert_eq!(plans[2]["identifiable"], true, "{found}");
    let number = |plan: usize, unknown: &str, key: &str| {
        plans[plan]["estimates"][unknown][key].as_f64().unwrap_or_else(|| panic!("{found}"))
    };
    for unknown in ["gap_mm", "pressure_bias_mpa"] {
        let of = |plan| number(plan, unknown, "sigma");
        assert!(
            of(2) <= of(1) && of(2) < 0.3 * of(0) && of(0) < number(0, unknown, "prior_sigma"),
            "{found}"
        );
    }
    // A fit to the readings that the plan asks for, in rising and falling order, comes to the standard deviations that it predicts.
    for (at, with_markers) in [(0, false), (2, true)] {
        let holds = plans[at]["holds"].as_array().expect("holds");
        assert_eq!((holds.len(), plans[at]["rank"].as_u64()), (5, Some(2)), "{found}");
        let hold = |k: usize| if k < 500 { k / 100 } else { 9 - k / 100 };
        let pressure = |k: usize| holds[hold(k)]["pressure_mpa"].as_f64().expect("a number");
        let states: Vec<(f64, f64)> = (0..1000).map(|k| (k as f64 * 0.01, pressure(k))).collect();
        let fit = json(&calibrate(folder.path(), &readings(&states, [46.0, 0.0, 0.0], with_markers), &[]));
        for unknown in ["gap_mm", "pressure_bias_mpa"] {
            let sigma = fit["estimates"][unknown]["sigma"].as_f64().expect("a number");
            let ratio = sigma / number(at, unknown, "sigma");
            assert!((0.8..1.25).contains(&ratio), "{unknown} of plan {at}: {ratio}, {fit}, {found}");
        }
    }
    // The predicted standard deviation falls with the number of readings and of plate positions.
    let sigma = |found: &Value| found["plans"][2]["estimates"]["gap_mm"]["sigma"].as_f64().expect("a number");
    assert!(sigma(&plan(&["--gap", "46", "--holds", "5", "--readings", "20"])) > sigma(&found));
    assert!(sigma(&plan(&["--gap", "36", "46", "56", "--holds", "5"])) < sigma(&found) * 1.0001);
}

#[test]
fn scene_that_estimates_unknown_inputs_is_refused_with_all_errors() {
    let stage = Stage::new("estimate-wrong");
    let path = scene(&stage, &recording(46.0, 0.0012));
    let text = std::fs::read_to_string(&path).expect("the scene");
    let text = text.replace("# force_bias_n = {", "stifness_mpa = { prior = 1.0, sigma = 0.1 }\n# {");
    std::fs::write(&path, text.replace("at_mm = [115.0, 2.0, 16.0]", "at_mm = [500.0, 2.0, 16.0]"))
        .expect("written");
    let (status, lines) =
        Program::daemon(&stage, &["twin", "--scene", path.to_str().expect("a path")]).ended();
    let text = lines.join("\n");
    assert_eq!(status.code(), Some(78), "{text}");
    assert!(
        text.contains("estimate.stifness_mpa") && text.contains("sheet.thickness_mm, pressure_bias_mpa"),
        "{text}"
    );
    assert!(text.contains("marker[0] `tip`"), "{text}");
}

fn path(path: &Path) -> &str {
    path.to_str().expect("a path")
}

/// A slow inflation seen by instruments: pressure and force as lines, the tip by Modbus, a second marker as JSON lines.
struct Bench {
    /// The camera answers.
    is_plugged: Arc<AtomicBool>,
    stop: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
}

impl Bench {
    const GAP_MM: f64 = 46.0;
    const BIAS_MPA: f64 = 0.0012;
    const PLACES_MM: [[f64; 3]; 2] = [[115.0, 2.0, 16.0], [80.0, 0.0, 16.0]];

    /// Starts; inflates for as long as the thread lives, once.
    fn start(camera: TcpListener, lines_to: SocketAddr, json_to: SocketAddr) -> Self {
        // Registers of the camera: x, y, z of the tip as 32-bit numbers, the high word first; zeros before its first picture, which the
        // estimate must survive.
        let shown = Arc::<Mutex<[u16; 6]>>::default();
        let (is_plugged, stop) = (Arc::new(AtomicBool::new(true)), Arc::<AtomicBool>::default());
        let (seen, plugged, over) = (shown.clone(), is_plugged.clone(), stop.clone());
        let asked = std::thread::spawn(move || answer(&camera, &seen, &plugged, &over));
        let over = stop.clone();
        let inflated = std::thread::spawn(move || inflate(&shown, lines_to, json_to, &over));
        Self { is_plugged, stop, threads: vec![asked, inflated] }
    }
}

impl Drop for Bench {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::SeqCst);
        for thread in self.threads.drain(..) {
            thread.join().expect("an instrument");
        }
    }
}

/// Moves the truth in real time and shows it on the instruments.
fn inflate(registers: &Mutex<[u16; 6]>, lines_to: SocketAddr, json_to: SocketAddr, stop: &AtomicBool) {
    let model = committed("pneunet");
    let points = Bench::PLACES_MM.map(|place| MeshPoint::at(&model, place).expect("on the mesh"));
    let probes = Probes::new(&model, &points).expect("probes");
    let (mut evaluation, mut at) = (probes.evaluation(), [ProbePosition::default(); 2]);
    let mut random = Rng::new(23);
    let mut normal = || (0..12).map(|_| random.uniform()).sum::<f64>() - 6.0;
    let (socket, begin) = (UdpSocket::bind("127.0.0.1:0").expect("a socket"), Instant::now());
    for k in 0_u32.. {
        if stop.load(Ordering::SeqCst) {
            return;
        }
        let pressure_mpa = (0.012 * begin.elapsed().as_secs_f64()).min(0.095);
        probes.answer(Inputs::new(pressure_mpa, Bench::GAP_MM), Query::GRADIENTS, &mut evaluation, &mut at);
        let tip = at[0].position_mm.map(|x| ((x + 0.2 * normal()) as f32).to_bits());
        let words = std::array::from_fn(|word| (tip[word / 2] >> (16 * (1 - word % 2))) as u16);
        *registers.lock().expect("the camera") = words;
        let [x, y, z] = at[1].position_mm.map(|x| x + 0.2 * normal());
        let seen = format!("{{\"x\": {x}, \"y\": {y}, \"z\": {z}}}\n");
        let hidden = "{\"x\": null, \"y\": null, \"z\": null}\n".to_owned();
        socket.send_to(if k % 10 == 3 { hidden } else { seen }.as_bytes(), json_to).expect("sent");
        let measured = pressure_mpa + Bench::BIAS_MPA + 0.0005 * normal();
        let force_n = evaluation.contact_force_n + 0.005 * normal();
        socket.send_to(format!("{measured}; {force_n}\n").as_bytes(), lines_to).expect("sent");
        std::thread::sleep(Duration::from_millis(10)); // the bench's own pace
    }
}

/// A camera on Modbus TCP: any number of input registers, while it is plugged in.
fn answer(camera: &TcpListener, registers: &Mutex<[u16; 6]>, is_plugged: &AtomicBool, stop: &AtomicBool) {
    camera.set_nonblocking(true).expect("a listener");
    let mut connections: Vec<TcpStream> = Vec::new();
    while !stop.load(Ordering::SeqCst) {
        connections.extend(camera.accept().map(|(connection, _)| connection));
        connections.retain_mut(|connection| {
            let (mut question, mut byte) = ([0; 12], [0]);
            connection.set_nonblocking(true).expect("a connection");
            match connection.peek(&mut byte) {
                Ok(0) => return false,
                Ok(_) => {}
                Err(error) => return error.kind() == std::io::ErrorKind::WouldBlock,
            }
            connection.set_nonblocking(false).expect("a connection");
            if connection.read_exact(&mut question).is_err() || !is_plugged.load(Ordering::SeqCst) {
                return false; // unplugged: the connection breaks
            }
            let word = |at: usize| usize::from(u16::from_be_bytes([question[at], question[at + 1]]));
            let (first, count) = (word(8), word(10));
            let words = registers.lock().expect("the camera")[first..first + count].to_vec();
            let mut reply = question[..4].to_vec();
            reply.extend((3 + 2 * count as u16).to_be_bytes());
            reply.extend([question[6], question[7], 2 * count as u8]);
            reply.extend(words.iter().flat_map(|word| word.to_be_bytes()));
            connection.write_all(&reply).is_ok()
        });
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// Markers that live instruments show end in an estimate; a camera that is pulled costs its marker and nothing else.
#[test]
fn markers_by_modbus_and_by_lines_end_in_an_estimate() {
    let stage = Stage::new("estimate-live");
    let camera = TcpListener::bind("127.0.0.1:0").expect("a port");
    let free = || UdpSocket::bind("127.0.0.1:0").expect("a port").local_addr().expect("an address");
    let [lines_to, json_to] = [free(), free()];
    let shipped = shipped(Stiffness::Known);
    let marker =
        |place: [f64; 3]| format!("[[actuator.marker]]\nname = \"at {}\"\nat_mm = {place:?}\n", place[0]);
    let tcp = camera.local_addr().expect("an address");
    let of_tip = |axis: &str, register: u32| {
        format!(
            "values.marker1_{axis}_mm = {{ from = {{ unit_id = 1, register = {register}, encoding = \"f32\" }} }}\n"
        )
    };
    let of_second = |axis: &str| format!("values.marker2_{axis}_mm = {{ from = \"{axis}\" }}\n");
    let sensors = format!(
        "[actuator.sensors.gauge]\nkind = \"lines\"\nudp = \"{lines_to}\"\nage_limit_ms = 1000\n\
         values.pressure_mpa = {{ from = 1 }}\nvalues.force_n = {{ from = 2 }}\n\
         [actuator.sensors.camera]\nkind = \"modbus\"\ntcp = \"{tcp}\"\nrate_hz = 100\ntimeout_ms = 1000\nbackoff_max_ms = 50\nage_limit_ms = 1000\n{}\
         [actuator.sensors.tracker]\nkind = \"lines\"\nudp = \"{json_to}\"\nage_limit_ms = 1000\n{}",
        of_tip("x", 0) + &of_tip("y", 2) + &of_tip("z", 4),
        ["x", "y", "z"].map(of_second).concat(),
    );
    // The shipped scene with these instruments, and a second marker.
    let (before, after) = shipped.split_once("[[actuator.output]]").expect("an output");
    let text = before.replace("backlog = 16", "backlog = 16\npace = \"gauge\"");
    let text = format!("{text}\n{}{sensors}[[actuator.output]]{after}", marker(Bench::PLACES_MM[1]));
    let scene = stage.write("live.toml", &text);
    let twin = Program::twin(&stage, &scene);
    let bridge = Program::bridge(&stage, &scene);
    let topic = Topic::estimate("finger").expect("a topic");
    let estimates = EstimateReader::attach(&stage.bus(), &topic).expect("a reader");
    let bench = Bench::start(camera, lines_to, json_to);
    let wait = |what: &str, fits: &dyn Fn(&wire::Estimate) -> bool| {
        wait_for(&estimates, what, |reader| {
            while let Some(estimate) = reader.next().expect("readable") {
                if fits(&estimate) {
                    return Some(estimate);
                }
            }
            None
        })
    };
    let whole = wait("a reading of force and both markers", &|estimate| estimate.used_values == 7);
    assert_eq!(whole.status, estimate_status::USED);
    let found =
        wait("gap identified", &|estimate| estimate.identifiable & 1 != 0 && estimate.sigmas[0] < 0.4);
    assert!((found.values[0] - Bench::GAP_MM).abs() < 4.0 * found.sigmas[0], "{found:?}");
    assert!((found.values[1] - Bench::BIAS_MPA).abs() < 4.0 * found.sigmas[1], "{found:?}");
    // Without the camera the force and the other marker go on; plugged in again it counts again.
    bench.is_plugged.store(false, Ordering::SeqCst);
    let seq = wait("a reading without the tip", &|estimate| estimate.used_values == 4).seq;
    let later = wait("more of them", &|estimate| estimate.seq > seq + 200);
    assert!(later.used_values <= 4 && (later.values[0] - Bench::GAP_MM).abs() < 1.0, "{later:?}");
    bench.is_plugged.store(true, Ordering::SeqCst);
    wait("the tip again", &|estimate| estimate.seq > later.seq && estimate.used_values == 7);
    let (status, table) = Program::tool(&stage, &["top", "--once"]).end();
    let table = table.join("\n");
    assert!(status.success() && table.contains("gap_mm 4") && !table.contains("ALARM"), "{table}");
    drop(bench);
    let (status, said) = bridge.stop();
    assert!(status.success() && said.iter().any(|line| line.contains("camera")), "{said:?}");
    assert!(twin.stop().0.success());
}
