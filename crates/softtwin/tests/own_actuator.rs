//! One's own actuator, as a user makes it: `new`, `build --quick`, then twin, readings and prediction, in real processes.

use serde_json::Value;
use std::io::Read;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};
use tests::process::binary;
use tests::wait::wait_until;
use tests::{Program, Stage};
use wire::layout::unpack_name;
use wire::{SensorSample, SensorWriter, Topic, ValveReader, now_ns};

/// A build takes about a minute of processor time, and other tests run beside it.
const DEADLINE: Duration = Duration::from_secs(1800);

fn softtwin(stage: &Stage, line: &str) -> Command {
    let mut command = Command::new(binary("softtwin"));
    command.args(line.split_whitespace()).current_dir(stage.folder.path()).env_remove("RUST_LOG");
    command.stdin(Stdio::null());
    command
}

/// Exit code, standard output, standard error.
fn run(stage: &Stage, line: &str) -> (Option<i32>, String, String) {
    let output = softtwin(stage, line).output().expect("the program starts");
    let text = |bytes| String::from_utf8(bytes).expect("UTF-8");
    (output.status.code(), text(output.stdout), text(output.stderr))
}

fn done(stage: &Stage, line: &str) -> String {
    let (code, out, error) = run(stage, line);
    assert_eq!(code, Some(0), "{line}: {out}{error}");
    out
}

/// Makes the twin of a shape, then runs it: from the folder to an answer.
fn make_and_run(label: &str, options: &str) -> Value {
    let stage = Stage::new(label);
    done(&stage, &format!("new finger {options}"));
    let built: Value = serde_json::from_str(&done(&stage, "build finger --quick --size-mm 9 --json"))
        .expect("one JSON object");
    println!("{label}: {built:#}");
    let [low, high] = [0, 1].map(|k| built["gap_mm"][k].as_f64().expect("a gap"));
    let pressure = built["contact_pressure_mpa"].as_f64().expect("a pressure");
    assert_eq!(built["failed"], 0, "{built}");
    // The pictures and the model must be good enough to be called a first look.
    let held_back = built["quality"]["held_back"].as_array().expect("a list");
    assert_eq!(held_back.len(), 2, "free and contact: {built}");
    for errors in held_back {
        let mean = |name: &str| errors[name]["percent"][0].as_f64();
        assert!(mean("displacement").is_some_and(|e| e < 1.0), "{errors}");
        assert!(mean("stress").is_some_and(|e| e < 6.0), "{errors}");
        assert!(mean("force").is_none_or(|e| e < 2.0), "{errors}");
    }
    assert!(stage.path("finger/errors.png").exists());

    // Every contact state touches.
    let table = std::fs::read_to_string(stage.path("finger/database/cases.csv")).expect("a list");
    let mut lines = table.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let heading = lines.next().expect("a heading");
    let column = |name: &str| heading.iter().position(|cell| *cell == name).expect("a column");
    let (regime, force) = (column("regime"), column("contact_force_n"));
    for cells in lines.filter(|cells| cells[regime] == "contact") {
        assert!(cells[force].parse::<f64>().is_ok_and(|force_n| force_n > 0.0), "{cells:?}");
    }
    // Trained again by whatever way, the model has the same observables.
    for (way, out) in [("", "again.twin"), ("--paper", "paper.twin")] {
        done(&stage, &format!("train --database finger/database {way} --out {out}"));
        let answer = done(&stage, &format!("predict {out} --pressure {pressure} --gap {low} --json"));
        let answer: Value = serde_json::from_str(&answer).expect("JSON");
        assert_eq!(answer["observables"].as_object().map(serde_json::Map::len), Some(5), "{way}: {answer}");
        let inspected: Value =
            serde_json::from_str(&done(&stage, &format!("inspect {out} --json"))).expect("JSON");
        assert_eq!(inspected["pressure_limit"]["reason"], built["pressure_reason"], "{way}");
    }

    // The printed commands: ask the model, run the scene.
    let gap = 0.5 * (low + high);
    let state = format!("finger/finger.twin --pressure {} --gap {gap}", 0.7 * pressure);
    let answer: Value =
        serde_json::from_str(&done(&stage, &format!("predict {state} --json"))).expect("JSON");
    assert_eq!((&answer["regime"], &answer["in_domain"]), (&"contact".into(), &true.into()), "{answer}");
    // The angle that was reported is the observable's, as the model has it at that pressure with nothing in the way.
    let free = format!("predict finger/finger.twin --pressure {} --gap 10000 --json", built["pressure_mpa"]);
    let free: Value = serde_json::from_str(&done(&stage, &free)).expect("JSON");
    let [reported, predicted] = [&built["angle_deg"], &free["observables"]["bending_angle_deg"]["value"]]
        .map(|angle| angle.as_f64().expect("an angle"));
    let off = (reported - predicted).rem_euclid(360.0);
    assert!(off.min(360.0 - off) < 1.0, "build {reported}, observable {predicted} degrees");
    let scene = stage.path("finger/scene.toml");
    // Pictures show the plate that was solved.
    let table = |path: &Path| -> toml::Table {
        std::fs::read_to_string(path).expect("just made").parse().expect("TOML")
    };
    let (drawn, solved) = (table(&scene), table(&stage.path("finger/actuator.toml")));
    for key in ["x_mm", "z_mm"] {
        assert_eq!(drawn["actuator"][0]["plate"][key], solved["obstacle"][key], "{drawn}");
    }
    let _twin = Program::twin(&stage, &scene);
    let _bridge = Program::bridge(&stage, &scene);
    let (status, said) =
        Program::tool(&stage, &["echo", "softtwin/finger/field/tip", "--once", "--json"]).end();
    assert!(status.success(), "{said:?}");
    let tip: Value = serde_json::from_str(&said[0]).expect("JSON");
    assert_eq!(tip["sample"]["entries"], 3, "the tip is one node: {tip}");
    built
}

#[test]
fn new_actuator_of_soft_silicone_bends_by_more_than_150_degrees_and_runs() {
    let built = make_and_run("soft", "--chambers 4 --wall-mm 3 --silicone dragon-skin-10-medium");
    let angle_deg = built["angle_deg"].as_f64().expect("an angle");
    assert!((150.0..200.0).contains(&angle_deg), "{built:#}");
}

#[test]
fn new_short_wide_actuator_runs() {
    make_and_run("wide", "--chambers 3 --length-mm 50 --width-mm 30 --silicone elastosil-m4601");
}

/// Runs the commands of a README of `models/shapes`, from the folder to the view of the live twin. Returns what each has printed, and the
/// newest state.
fn from_folder_to_live_twin(stage: &Stage, name: &str) -> (Vec<(String, String)>, Value) {
    let from = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../models/shapes")).join(name);
    let to = stage.path(name);
    std::fs::create_dir(&to).expect("a new folder");
    for file in std::fs::read_dir(&from).expect("a folder").map(|entry| entry.expect("an entry").path()) {
        if file.is_file() {
            std::fs::copy(&file, to.join(file.file_name().expect("a file"))).expect("copied");
        }
    }
    let text = std::fs::read_to_string(from.join("README.md")).expect("a README");
    let block = text.split("```sh\n").nth(1).and_then(|rest| rest.split("```").next()).expect("commands");
    let (mut said, mut running) = (Vec::new(), Vec::new());
    for line in block.lines().skip_while(|line| line.starts_with("cp ")) {
        match line.trim_end_matches(" &").split_once(' ').expect("a command") {
            ("softtwind", rest) => {
                let mut program = Program::daemon(stage, &rest.split_whitespace().collect::<Vec<_>>());
                program.wait_for("ready:");
                running.push(program);
            }
            ("softtwin", rest) if rest.starts_with("view ") => {
                let mut program =
                    Program::tool(stage, &rest.split_whitespace().chain(["--port", "0"]).collect::<Vec<_>>());
                program.wait_for("http://");
                running.push(program);
            }
            ("softtwin", rest) => said.push((rest.to_owned(), done(stage, rest))),
            (other, _) => panic!("{other}: not a program of ours"),
        }
    }
    let topic = format!("softtwin/{name}/state");
    let (status, lines) = Program::tool(stage, &["echo", &topic, "--once", "--json"]).end();
    assert!(status.success(), "{lines:?}");
    (said, serde_json::from_str(&lines[0]).expect("JSON"))
}

/// Output of the first command that begins so.
fn said_by<'a>(said: &'a [(String, String)], command: &str) -> &'a str {
    said.iter().find(|(line, _)| line.starts_with(command)).map(|(_, out)| out.as_str()).expect("run")
}

/// The JSON of the prediction among the commands that were run.
fn predicted(stage: &Stage, said: &[(String, String)]) -> Value {
    let (line, _) = said.iter().find(|(line, _)| line.starts_with("predict")).expect("run");
    serde_json::from_str(&done(stage, &format!("{line} --json"))).expect("JSON")
}

#[test]
fn two_opposite_chambers_of_a_mesh_file_bend_either_way_in_the_twin() {
    let stage = Stage::new("opposite");
    from_folder_to_live_twin(&stage, "two-chambers");
    let largest = 0.035;
    let tip_y = |upper: f64, lower: f64| -> f64 {
        let model = "predict two-chambers/two-chambers.twin --json";
        let line = format!("{model} --pressure {upper} --set pressure_mpa.lower={lower}");
        let answer: Value = serde_json::from_str(&done(&stage, &line)).expect("JSON");
        answer["observables"]["tip_y_mm"]["value"].as_f64().expect("a number")
    };
    let (rest, down, up) = (tip_y(0.0, 0.0), tip_y(largest, 0.0), tip_y(0.0, largest));
    assert!(down < rest - 0.3 && up > rest + 0.3, "{rest} {down} {up}");
    let trace = format!("t_s,pressure_mpa,pressure_mpa.lower\n0,{largest},0\n1,0,{largest}\n");
    stage.write("trace.csv", &trace);
    done(&stage, "predict two-chambers/two-chambers.twin --json --trace trace.csv --out series.csv");
    let series = std::fs::read_to_string(stage.path("series.csv")).expect("just made");
    let column = |line: &str| line.split(',').nth(5).and_then(|cell| cell.parse::<f64>().ok());
    let heights: Vec<f64> = series.lines().filter_map(column).collect();
    // The series is of another node of the tip.
    let rise = heights[heights.len() - 1] - heights[0];
    assert!((rise / (up - down) - 1.0).abs() < 0.05, "{rise}: {down} {up}");
    every_cavity_is_an_input_of_the_unit(&stage);
    every_cavity_has_its_valve(&stage, largest);
}

/// The FMU has each pressure as an input.
fn every_cavity_is_an_input_of_the_unit(stage: &Stage) {
    done(stage, "export two-chambers/two-chambers.twin --out two.fmu");
    let file = std::fs::File::open(stage.path("two.fmu")).expect("just made");
    let mut archive = zip::ZipArchive::new(file).expect("an archive");
    let mut text = String::new();
    archive.by_name("modelDescription.xml").expect("in it").read_to_string(&mut text).expect("text");
    for name in ["pressure_mpa", "pressure_mpa.lower"] {
        let line = text.lines().find(|line| line.contains(&format!("name=\"{name}\""))).unwrap_or_default();
        assert!(line.contains("causality=\"input\""), "{name}: {text}");
    }
}

/// A valve per cavity on two converters: each follows its own owner, and both close where the state is outside of the sampled ones.
fn every_cavity_has_its_valve(stage: &Stage, largest_mpa: f64) {
    let converters = stage.path("iio:device0");
    std::fs::create_dir(&converters).expect("a new folder");
    let raw = |channel: u32| converters.join(format!("out_voltage{channel}_raw"));
    let valve = |section: &str, channel: u32| {
        std::fs::write(raw(channel), "0\n").expect("written");
        format!(
            "[actuator.{section}]\nrange_mpa = [0.0, {largest_mpa:?}]\nstate_max_age_ms = 60000.0\n\
             [actuator.{section}.iio]\nroot = \"{}\"\ndevice = \"iio:device0\"\nchannel = {channel}\nscale = 1e-6\nraw_max = 65535\n",
            stage.folder.path().display()
        )
    };
    let text = |input: &str| {
        format!(
            "name = \"two\"\n[[actuator]]\nname = \"two\"\nmodel = \"two-chambers/two-chambers.twin\"\n\
             [actuator.inputs]\n\"pressure_mpa.lower\" = {input}\n{}{}",
            valve("valve", 0),
            valve("valves.lower", 1)
        )
    };
    let given = stage.write("given.toml", &text("0.0"));
    let (code, said, error) = run(stage, &format!("inspect {}", given.display()));
    assert!(code == Some(78) && error.contains("valves.lower"), "{said}{error}");
    let scene = stage.write("two.toml", &text("\"measured\""));
    let _twin = Program::twin(stage, &scene);
    let _bridge = Program::bridge(stage, &scene);
    let mut sensor =
        SensorWriter::create(&stage.bus(), &Topic::sensor("two").expect("a name")).expect("one writer");
    let mut seq = 0;
    let mut publish = |upper_mpa: f64, lower_mpa: f64| {
        seq += 1;
        let (boot_id, t_sensor_ns) = (1, now_ns());
        let mut reading =
            SensorSample { boot_id, seq, t_sensor_ns, pressure_mpa: upper_mpa, ..SensorSample::default() };
        assert!(reading.add_input("pressure_mpa.lower", lower_mpa));
        sensor.publish(reading).expect("published");
    };
    let written = |channel: u32, wanted: f64| {
        wait_until(&format!("{wanted} MPa in converter {channel}"), || {
            let found: f64 = std::fs::read_to_string(raw(channel)).ok()?.trim().parse().ok()?;
            ((1e-6 * found - wanted).abs() < 1e-6).then_some(())
        });
    };
    let inside = [0.3, 0.2].map(|share| share * largest_mpa);
    publish(inside[0], inside[1]);
    let setpoint = |cavity: &str, mpa: f64| {
        Program::shell(stage, &format!("exec softtwin setpoint two {cavity} --pressure {mpa}"))
    };
    let upper = setpoint("", inside[0]);
    written(0, inside[0]);
    written(1, 0.0);
    let lower = setpoint("--cavity lower", inside[1]);
    written(1, inside[1]);
    publish(inside[0], 3.0 * largest_mpa);
    written(0, 0.0);
    written(1, 0.0);
    publish(inside[0], inside[1]);
    written(0, inside[0]);
    written(1, inside[1]);
    upper.kill();
    written(0, 0.0);
    written(1, inside[1]);
    let (code, said, error) = run(stage, "setpoint two --cavity middle --pressure 0.0");
    assert!(code != Some(0) && error.contains("[actuator.valves.middle]"), "{said}{error}");
    lower.kill();
    further_cavity_is_held(stage, &text("\"measured\""), &mut publish, &written, inside);
}

/// `softtwin hold` drives the cavity that `control.cavity` names, the other one keeps its reading; force and unknown cavities are refused.
fn further_cavity_is_held(
    stage: &Stage,
    text: &str,
    publish: &mut dyn FnMut(f64, f64),
    written: &dyn Fn(u32, f64),
    [upper_mpa, lower_mpa]: [f64; 2],
) {
    let scene = |cavity: &str| {
        stage.write("held.toml", &format!("{text}[actuator.control]\ncavity = \"{cavity}\"\n"))
    };
    let path = scene("middle").display().to_string();
    let (code, said, error) = run(stage, &format!("hold --scene {path} --pressure 0.001"));
    assert!(code == Some(78) && error.contains("control.cavity") && error.contains("lower"), "{said}{error}");
    let path = scene("lower").display().to_string();
    let (code, said, error) = run(stage, &format!("hold --simulate --scene {path} --force-n 0.1"));
    assert!(code == Some(2) && error.contains("control.cavity"), "{said}{error}");
    let line = format!("hold --simulate --json --seconds 1 --scene {path} --tip-y-mm");
    let (_, said, error) = run(stage, &format!("{line} 900"));
    let reach = error.split_once("limit give ").and_then(|(_, rest)| rest.split_once(" mm;")).expect(&said).0;
    let (low, high) = reach.split_once(" to ").expect(reach);
    let middle = 0.5 * (low.parse::<f64>().expect(low) + high.parse::<f64>().expect(high));
    done(stage, &format!("{line} {middle}"));
    let main = stage.write("main.toml", text).display().to_string();
    let (code, said, error) = run(stage, &format!("hold --simulate --scene {main} --tip-y-mm {middle}"));
    assert!(code == Some(2), "the other bends down: {said}{error}");

    let holds = Program::shell(
        stage,
        &format!("exec softtwin hold --scene {path} --owner test --pressure {lower_mpa:?}"),
    );
    let bus = stage.bus();
    let topic = Topic::valve("two").expect("a name").of_cavity(Some("lower")).expect("a name");
    let valves = ValveReader::open(&bus, &topic).expect("a valve");
    wait_until("a setpoint of the controller", || {
        publish(upper_mpa, lower_mpa);
        let valve = valves.newest().expect("open")?;
        (unpack_name(&valve.owner) == "test" && (valve.pressure_mpa - lower_mpa).abs() < 0.2 * lower_mpa)
            .then_some(())
    });
    written(0, 0.0);
    holds.kill();
}

#[test]
fn silicone_on_a_stiff_skeleton_of_a_mesh_file_is_built() {
    let stage = Stage::new("skeleton");
    let (said, _) = from_folder_to_live_twin(&stage, "skeleton");
    let parts = said_by(&said, "mesh");
    assert!(parts.contains("materials.skeleton") && parts.contains("held (support.fixed)"), "{parts}");
    let answer: Value = predicted(&stage, &said);
    assert!(answer["in_domain"] == true && answer["max_displacement_mm"].as_f64() > Some(2.0), "{answer}");
    // The strip is a part of the mesh.
    let model: Value =
        serde_json::from_str(&done(&stage, "inspect skeleton/skeleton.twin --json")).expect("JSON");
    let nodes = model["node_sets"]["material.skeleton"].as_u64().expect("the nodes of the strip");
    assert!(nodes > 100 && 2 * nodes < model["node_count"].as_u64().expect("all nodes"), "{model}");
}

#[test]
fn bellows_past_their_limit_follow_the_pressure_on_two_branches() {
    let stage = Stage::new("bellows");
    let (said, state) = from_folder_to_live_twin(&stage, "bellows");
    let report: Value = predicted(&stage, &said);
    assert_eq!(
        (&report["limits_passed"], &report["outside_training_range"]),
        (&2.into(), &0.into()),
        "{report}"
    );
    let series = std::fs::read_to_string(stage.path("bellows/series.csv")).expect("just made");
    let rows: Vec<Vec<f64>> = series.lines().skip(1).map(numbers).collect();
    // At 58.5 kPa, between the limits, before and after: time, pressure, ... volume.
    let at = |row: &&Vec<f64>, begin: f64| row[0] > begin && (row[1] - 0.0585).abs() < 3e-5;
    let volumes = [0.0, 5.0].map(|begin| rows.iter().find(|row| at(row, begin)).expect("passed")[9]);
    assert!(
        (volumes[0] / 6000.0 - 1.0).abs() < 0.1 && (volumes[1] / 86000.0 - 1.0).abs() < 0.1,
        "{volumes:?}"
    );
    let sample = &state["sample"];
    assert!(sample["pressure_mpa"].is_number() && sample["inputs"][0].is_number(), "{sample}");
    assert_eq!([&sample["input_names"][0], &sample["input_sources"][0]], ["volume_mm3", "measured"]);
}

/// Numbers of a line; NaN for an empty cell.
fn numbers(line: &str) -> Vec<f64> {
    line.split(',').map(|cell| cell.parse().unwrap_or(f64::NAN)).collect()
}

/// Checkpoints that are whole.
fn states(folder: &Path) -> usize {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries.filter(|entry| entry.path().extension().is_some_and(|ending| ending == "state")).count()
}

#[test]
fn killed_build_continues() {
    let stage = Stage::new("killed");
    done(&stage, "new finger --chambers 2 --silicone elastosil-m4601");
    let folder = stage.path("finger/database/states");
    let mut child = softtwin(&stage, "build finger --quick --size-mm 9 --json")
        .stdout(Stdio::null())
        .spawn()
        .expect("the program starts");
    let end = Instant::now() + DEADLINE;
    while states(&folder) < 10 {
        assert!(Instant::now() < end && child.try_wait().expect("our child").is_none(), "it ended before");
        std::thread::sleep(Duration::from_millis(2));
    }
    child.kill().expect("killed");
    child.wait().expect("gone");
    let kept = states(&folder);
    let built: Value = serde_json::from_str(&done(&stage, "build finger --quick --size-mm 9 --json"))
        .expect("one JSON object");
    assert!(built["reused"].as_u64().is_some_and(|reused| reused + 1 >= kept as u64), "{kept} kept: {built}");
}

#[test]
fn invalid_actuators_are_refused() {
    let stage = Stage::new("mistakes");
    done(&stage, "new finger --chambers 2");
    let refused = |line: &str, code: i32, part: &str| {
        let (found, out, error) = run(&stage, line);
        assert!(found == Some(code) && error.contains(part), "{line}: {found:?} {out}{error}");
    };
    refused("new finger", 2, "expected a new or an empty folder");
    refused("new other --chambers 6 --length-mm 40", 2, "need at least 58.0 mm");
    refused("new other --wall-mm 9", 2, "give thinner walls");
    refused("new other --silicone rubber", 2, "expected one of reference");
    refused("new bad.name", 2, "give --name");
    assert!(!stage.path("other").exists(), "what is refused leaves nothing");
    refused("build nowhere", 2, "which `softtwin new nowhere` makes");
    refused("build finger --size-mm 30", 2, "flatter elements fold");
    let text = std::fs::read_to_string(stage.path("finger/actuator.toml")).expect("just made");
    stage.write("finger/actuator.toml", &text.replace("floor_mm = 7.0 ", "floor_mm = 5.0 "));
    refused("build finger", 78, "slots.floor_mm");
    stage.write("finger/actuator.toml", &text.replace("count = 2", "count = two"));
    refused("build finger", 78, "actuator.toml");
    stage.write("finger/actuator.toml", &text.replace("mu_mpa = 0.8", "mu_mpa = 0.002"));
    refused("build finger --size-mm 9", 78, "--hanging");
    refused("simulate --pressure 0.01", 2, "--actuator");
}
