//! Logs of a bench: described, learned from, compared.

use rom::evaluator::Evaluator;
use rom::inputs::Inputs;
use rom::model::Model;
use rom::observable::Observables;
use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output};

fn run(folder: &Path, args: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_softtwin"));
    command.args(args).current_dir(folder).env_remove("RUST_LOG").output().unwrap()
}

fn json(folder: &Path, args: &[&str]) -> Value {
    let ended = run(folder, args);
    assert!(ended.status.success(), "{}", String::from_utf8_lossy(&ended.stderr));
    serde_json::from_slice(&ended.stdout).unwrap()
}

/// A finger whose tip follows the pressure (kPa) with play and noise: `p_kpa,idle,x_mm,y_mm,angle`.
fn bench(folder: &Path, name: &str, seed: u32, factor: f64) {
    let (mut text, mut played, mut noise) = ("t_s,p,idle,x,y,angle\n".to_owned(), 0.0_f64, seed);
    for row in 0..600_u32 {
        let t = 0.05 * f64::from(row);
        let p = 30.0 * (1.0 - (0.7 * t + 0.1 * f64::from(seed)).cos()) * (0.6 + 0.4 * (0.13 * t).sin());
        played = played.clamp(p - 2.0, p + 2.0);
        noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let n = f64::from(noise >> 8) / f64::from(1 << 24) - 0.5;
        let (x, y) = (100.0 - 0.004 * played * played, -0.9 * played);
        text += &format!(
            "{t:.3},{},1.0,{:.4},{:.4},{:.4}\n",
            p * factor,
            x + 0.2 * n,
            y - 0.2 * n,
            1.5 * played + 0.3 * n
        );
    }
    std::fs::write(folder.join(name), text).unwrap();
}

const LOG: &str = r#"
[time]
column = "t_s"
unit = "s"
[[input]]
name = "pressure_mpa"
column = "p"
unit = "kPa"
[[input]]
name = "idle_mpa"
column = "idle"
unit = "kPa"
[[output]]
name = "tip_x_mm"
column = "x"
unit = "mm"
[[output]]
name = "tip_y_mm"
column = "y"
unit = "mm"
[[output]]
name = "angle_deg"
column = "angle"
unit = "deg"
"#;

const LEARN: [&str; 7] = ["learn", "run1.csv", "--log", "log.toml", "--out", "mine.twin", "--json"];

fn compare<'a>(recording: &'a str, log: &'a str) -> Vec<&'a str> {
    vec!["compare", "mine.twin", "--recording", recording, "--log", log, "--out", "out", "--json"]
}

#[test]
fn twin_of_a_recording_predicts_another_run_within_its_half_widths() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    bench(folder, "run1.csv", 1, 1.0);
    bench(folder, "run2.csv", 2, 1.0);
    std::fs::write(folder.join("log.toml"), LOG).unwrap();
    let described =
        json(folder, &["inspect", "run1.csv", "--picture", "columns.svg", "--out", "new.toml", "--json"]);
    assert_eq!(described["time_column"], 1);
    assert_eq!(described["columns"][2]["constant"], true);
    assert!(folder.join("columns.svg").is_file() && folder.join("new.toml").is_file());
    assert!(run(folder, &["export", "run1.csv", "--log", "log.toml", "--out", "trace.csv"]).status.success());
    let trace = std::fs::read_to_string(folder.join("trace.csv")).unwrap();
    assert!(trace.starts_with("t_s,pressure_mpa,idle_mpa,tip_x_mm,tip_y_mm,angle_deg\n"), "{}", &trace[..60]);
    let learned = json(folder, &LEARN);
    assert_eq!(learned["source"], "measured");
    assert_eq!(learned["inputs"], serde_json::json!(["pressure_mpa"]));
    let loops = learned["outputs"]["tip_y_mm"]["loop_share"].as_f64().unwrap();
    assert!((0.0..0.03).contains(&loops), "of a play of 4 in 60 kPa the model leaves little: {loops}");
    let compared = json(folder, &compare("run2.csv", "log.toml"));
    assert_eq!(compared["source"], "measured");
    for name in ["tip_x_mm", "tip_y_mm", "angle_deg"] {
        let output = &compared["outputs"][name];
        let [rms, p95, max, range, coverage] =
            ["rms", "p95", "max", "range", "coverage"].map(|key| output[key].as_f64().unwrap());
        assert!(rms < 0.06 * range && rms < p95 && p95 <= max, "{name}: {output}");
        assert!((0.8..=1.0).contains(&coverage), "{name}: {output}");
    }
    assert!(folder.join("out/compare.svg").is_file() && folder.join("out/compare.csv").is_file());
    for kind in ["coefficients", "observables"] {
        assert!(run(folder, &["draw", "mine.twin", "--chart", kind, "--out", "curves.svg"]).status.success());
    }
    let state = json(folder, &["predict", "mine.twin", "--json", "--pressure", "0.03"]);
    assert_eq!(state["in_domain"], true);
    let inspected = json(folder, &["inspect", "mine.twin", "--json"]);
    assert_eq!(inspected["source"], "measured");
}

#[test]
fn outside_what_was_measured_half_widths_are_wider_and_far_outside_there_is_no_answer() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    bench(folder, "run1.csv", 1, 1.0);
    std::fs::write(folder.join("log.toml"), LOG).unwrap();
    json(folder, &LEARN);
    let predict = ["predict", "mine.twin", "--json"];
    let near = json(folder, &[&predict[..], &["--pressure", "0.075"]].concat());
    assert!(near["outputs"]["tip_y_mm"]["value"].is_number(), "{near}");
    let width = |state: &Value| state["outputs"]["tip_y_mm"]["half_width"].as_f64().unwrap_or(f64::INFINITY);
    let inside = json(folder, &[&predict[..], &["--pressure", "0.03"]].concat());
    assert!(width(&near) > 1.5 * width(&inside), "{near} {inside}");
    let along = |rows: &str| {
        std::fs::write(folder.join("trace.csv"), format!("t_s,pressure_mpa\n{rows}")).unwrap();
        run(folder, &[&predict[..], &["--trace", "trace.csv", "--out", "series.csv"]].concat())
    };
    let ended = along("0,0.03\n0.001,0.075\n");
    assert!(ended.status.success() && String::from_utf8_lossy(&ended.stderr).contains("pressure_mpa"));
    let series = formats::table::Table::read(&folder.join("series.csv"), true).unwrap();
    assert!(series.rows().count() > 1);
    let ended = along("0,0.03\n0.001,0.6\n");
    assert_eq!(ended.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&ended.stderr).contains("0.001 s"));
    // Of a recording such a row is left out of the comparison.
    let rows = std::fs::read_to_string(folder.join("run1.csv")).unwrap();
    std::fs::write(folder.join("run2.csv"), format!("{rows}30.0,130,1.0,0,0,0\n")).unwrap();
    let compared = json(folder, &compare("run2.csv", "log.toml"));
    let rms = compared["outputs"]["tip_y_mm"]["rms"].as_f64().unwrap();
    assert!(rms < 5.0, "{compared}");
    assert!(
        compared["remarks"].as_array().unwrap().iter().any(|of| of.as_str().unwrap().contains("0.13")),
        "{compared}"
    );
}

#[test]
fn wrong_units_and_swapped_columns_are_noticed() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    bench(folder, "run1.csv", 1, 1.0);
    std::fs::write(folder.join("log.toml"), LOG).unwrap();
    json(folder, &LEARN);
    for (factor, confusion) in [(6.895, "psi and kPa"), (10.0, "bar and MPa"), (1000.0, "kPa and MPa")] {
        bench(folder, "wrong.csv", 2, factor);
        let ended = run(folder, &compare("wrong.csv", "log.toml"));
        let text = String::from_utf8_lossy(&ended.stderr);
        assert_eq!(ended.status.code(), Some(78), "{text}");
        assert!(text.contains(confusion), "{text}");
    }
    bench(folder, "small.csv", 2, 1.0 / 6.895);
    let small = json(folder, &compare("small.csv", "log.toml"));
    assert!(small["remarks"].to_string().contains("psi"), "{small}");
    let swapped = LOG.replace("column = \"x\"", "column = \"z\"").replace("column = \"y\"", "column = \"x\"");
    std::fs::write(folder.join("swapped.toml"), swapped.replace("column = \"z\"", "column = \"y\"")).unwrap();
    let found = json(folder, &compare("run1.csv", "swapped.toml"));
    assert!(found["remarks"].to_string().contains("swapped?"), "{found}");
    std::fs::write(folder.join("other.toml"), LOG.replace("pressure_mpa", "supply_mpa")).unwrap();
    let ended = run(folder, &compare("run1.csv", "other.toml"));
    assert_eq!(ended.status.code(), Some(78));
}

#[test]
fn swapped_inputs_are_named() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    let write = |name: &str, headings: &str| {
        let mut text = format!("t,{headings},angle\n");
        for row in 0..300 {
            let t = 0.1 * f64::from(row);
            let (a, b) = (30.0 + 30.0 * (0.9 * t).sin(), 30.0 + 30.0 * (1.7 * t).cos());
            text += &format!("{t},{a},{b},{}\n", a - 0.6 * b);
        }
        std::fs::write(folder.join(name), text).unwrap();
    };
    write("run1.csv", "left,right");
    write("run2.csv", "right,left");
    let input =
        |name: &str| format!("[[input]]\nname = \"{name}_mpa\"\ncolumn = \"{name}\"\nunit = \"kPa\"\n");
    let log = "[time]\ncolumn = \"t\"\nunit = \"s\"\n[[output]]\nname = \"angle_deg\"\ncolumn = \"angle\"\nunit = \"deg\"\n";
    std::fs::write(folder.join("log.toml"), [log, &input("left"), &input("right")].concat()).unwrap();
    json(folder, &LEARN);
    let named =
        |run: &str| json(folder, &compare(run, "log.toml"))["remarks"].to_string().contains("swapped?");
    assert!(named("run2.csv") && !named("run1.csv"));
}

#[test]
fn recordings_that_teach_nothing_are_refused() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    std::fs::write(folder.join("log.toml"), LOG).unwrap();
    let still: String = (0..100).map(|row| format!("{row},5,1,{},2,3\n", row % 3)).collect();
    std::fs::write(folder.join("run1.csv"), format!("t_s,p,idle,x,y,angle\n{still}")).unwrap();
    assert_eq!(run(folder, &LEARN).status.code(), Some(65));
    std::fs::write(folder.join("run1.csv"), "t_s,p,idle,x,y,angle\n0,1,1,1,1,1\n1,2,1,2,2,2\n").unwrap();
    assert_eq!(run(folder, &LEARN).status.code(), Some(65));
    std::fs::write(folder.join("run1.csv"), "nothing\n").unwrap();
    assert_eq!(run(folder, &LEARN).status.code(), Some(78));
}

#[test]
fn less_than_two_periods_are_remarked() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    std::fs::write(folder.join("log.toml"), LOG).unwrap();
    let ramp: String = (0..200).map(|row| format!("{row},{row},1,{},{},{row}\n", 2 * row, -row)).collect();
    std::fs::write(folder.join("run1.csv"), format!("t_s,p,idle,x,y,angle\n{ramp}")).unwrap();
    let learned = json(folder, &LEARN);
    assert_eq!(learned["turns"], 0);
    assert!(!learned["remarks"].as_array().unwrap().is_empty(), "{learned}");
}

#[test]
fn learned_model_answers_along_a_trace_as_along_the_recording_and_follows_an_offset() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    bench(folder, "run1.csv", 1, 1.0);
    bench(folder, "run2.csv", 2, 1.0);
    std::fs::write(folder.join("log.toml"), LOG).unwrap();
    json(folder, &LEARN);
    let of = |value: &Value, key: &str| value["outputs"]["tip_y_mm"][key].as_f64().unwrap();
    let free = json(folder, &compare("run2.csv", "log.toml"));
    assert!((0.8..=1.0).contains(&of(&free, "coverage")), "{free}");
    let following = json(folder, &[&compare("run2.csv", "log.toml")[..], &["--follow", "1"]].concat());
    assert!(of(&following, "rms") < 1.3 * of(&free, "rms"), "{following} {free}");
    json(folder, &compare("run2.csv", "log.toml"));
    // Along a trace the model answers as along the recording.
    let column = |file: &str, name: &str, factor: f64| -> Vec<f64> {
        let table = formats::table::Table::read(&folder.join(file), true).unwrap();
        let at = table.column(name).unwrap();
        // A half-width is empty where the run goes beyond what was measured.
        let value = |row: formats::table::TableRow| row.optional_number(at).unwrap().unwrap_or(f64::NAN);
        table.rows().map(|row| factor * value(row)).collect()
    };
    let rows = column("run2.csv", "t_s", 1.0).into_iter().zip(column("run2.csv", "p", 1e-3));
    let lines: Vec<String> = rows.map(|(t_s, pressure_mpa)| format!("{t_s},{pressure_mpa}\n")).collect();
    std::fs::write(folder.join("trace.csv"), format!("t_s,pressure_mpa\n{}", lines.concat())).unwrap();
    let predict = ["predict", "mine.twin", "--json", "--trace", "trace.csv", "--out", "series.csv"];
    json(folder, &[&predict[..], &["--step-ms", "1000"]].concat());
    let compared = column("out/compare.csv", "tip_y_mm_predicted", 1.0);
    let along = column("series.csv", "tip_y_mm", 1.0);
    assert_eq!(along.len(), compared.len());
    let off = along.iter().zip(&compared).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(off < 1e-5, "{off}");
    let widths = column("series.csv", "tip_y_mm_half_width", 1.0);
    assert!(widths[1] > 2.0 * widths[widths.len() - 1], "{} {}", widths[1], widths[widths.len() - 1]);
}

/// The shipped finger, with its angles as observables.
const FINGER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../models/pneunet/pneunet.twin");

/// Pressures (MPa) and bending angles (deg) of the shipped finger over a plate.
fn angles(gap_mm: f64, pressures_mpa: impl Iterator<Item = f64>) -> Vec<(f64, f64)> {
    let model = Model::from_bytes(&std::fs::read(FINGER).unwrap()).unwrap();
    let observables = Observables::of(&model).unwrap();
    let at = observables.names().position(|name| name == "bending_angle_deg").unwrap();
    let evaluator = Evaluator::new(&model.header).unwrap();
    let mut evaluation = evaluator.evaluation();
    let mut one = |pressure_mpa: f64| {
        evaluator.evaluate(Inputs::new(pressure_mpa, gap_mm), &mut evaluation);
        (pressure_mpa, observables.value(at, &evaluation).value)
    };
    pressures_mpa.map(&mut one).collect()
}

fn scene(prior_mm: f64) -> String {
    format!(
        "name = \"bench\"\n[[actuator]]\nname = \"finger\"\nmodel = \"{FINGER}\"\n\
         estimate = {{ gap_mm = {{ prior = {prior_mm}, sigma = 10.0 }} }}\n\
         observables = {{ bending_angle_deg = {{ sigma = 0.1, model_sigma = 0.1 }} }}\n"
    )
}

#[test]
fn gap_is_calibrated_by_an_angle_and_shown_before_and_after() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    let (mut text, mut noise) = ("t;p (kPa);gap;angle (deg)\n".to_owned(), 3_u32);
    for (row, (pressure_mpa, angle)) in
        angles(30.0, (1..60).map(|i| 0.0013 * f64::from(i))).iter().enumerate()
    {
        noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let n = 0.2 * (f64::from(noise >> 8) / f64::from(1 << 24) - 0.5);
        text += &format!("{row};{};30;{:.4}\n", 1000.0 * pressure_mpa, angle + n).replace('.', ",");
    }
    std::fs::write(folder.join("run.csv"), &text).unwrap();
    let log = "[time]\ncolumn = 1\n[[input]]\nname = \"pressure_mpa\"\ncolumn = 2\nunit = \"kPa\"\n\
               [[output]]\nname = \"bending_angle_deg\"\ncolumn = 4\nunit = \"deg\"\n";
    std::fs::write(folder.join("log.toml"), log).unwrap();
    std::fs::write(folder.join("scene.toml"), scene(36.0)).unwrap();
    let calibrate = "calibrate --scene scene.toml --recording run.csv --log log.toml --out calibrated.toml --picture fit.svg --json";
    let found = json(folder, &calibrate.split(' ').collect::<Vec<_>>());
    let gap = &found["estimates"]["gap_mm"];
    assert!((gap["value"].as_f64().unwrap() - 30.0).abs() < 0.5 && gap["identifiable"] == true, "{found}");
    for rows in [1, 5, 10, 15, 20] {
        let few: String = text.split_inclusive('\n').take(rows).collect();
        std::fs::write(folder.join("few.csv"), few).unwrap();
        let calibrate =
            "calibrate --scene scene.toml --recording few.csv --log log.toml --memory m.twin --out few.toml";
        let ended = run(folder, &calibrate.split(' ').collect::<Vec<_>>());
        assert!(matches!(ended.status.code(), Some(65 | 78)), "{rows} rows: {ended:?}");
    }
    let both = [log, "[[input]]\nname = \"gap_mm\"\ncolumn = 3\nunit = \"mm\"\n"].concat();
    std::fs::write(folder.join("both.toml"), both).unwrap();
    let compare =
        "compare calibrated.toml --before scene.toml --recording run.csv --log both.toml --out out --json";
    let found = json(folder, &compare.split(' ').collect::<Vec<_>>());
    assert!(found["before"]["bending_angle_deg"]["rms"].is_number(), "{found}");
    std::fs::write(folder.join("other.toml"), scene(36.0).replace("bending_angle", "torsion")).unwrap();
    let ended = run(folder, &["calibrate", "--scene", "other.toml", "--recording", "run.csv"]);
    assert_eq!(ended.status.code(), Some(78), "an observable that the model does not have");
}

#[test]
fn offset_of_a_finite_element_model_is_learned_and_shown() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    let write = |name: &str, first: f64| {
        let mut text = "t,p,angle\n".to_owned();
        let pressures = (0..80).map(|i| 0.02 + 0.01 * (1.0 - (0.3 * f64::from(i) + first).cos()));
        for (row, (pressure_mpa, angle)) in angles(80.0, pressures).iter().enumerate() {
            text +=
                &format!("{row},{},{}\n", 1000.0 * pressure_mpa, angle + 4.0 + 200.0 * (pressure_mpa - 0.02));
        }
        std::fs::write(folder.join(name), text).unwrap();
    };
    write("run1.csv", 0.0);
    write("run2.csv", 1.0);
    let log = "[time]\ncolumn = 1\n[[input]]\nname = \"pressure_mpa\"\ncolumn = 2\nunit = \"kPa\"\n\
               [[input]]\nname = \"gap_mm\"\ncolumn = 2\nunit = \"mm\"\nslope = 1e-9\noffset = 80.0\n\
               [[output]]\nname = \"bending_angle_deg\"\ncolumn = 3\nunit = \"deg\"\n";
    std::fs::write(folder.join("log.toml"), log).unwrap();
    let learn = format!("learn run1.csv --log log.toml --model {FINGER} --out mine.twin --json");
    let learned = json(folder, &learn.split(' ').collect::<Vec<_>>());
    assert_eq!(learned["modes"][0]["kept"], true, "{learned}");
    let compare =
        format!("compare mine.twin --before {FINGER} --recording run2.csv --log log.toml --out out --json");
    let found = json(folder, &compare.split(' ').collect::<Vec<_>>());
    let rms = |of: &str| found[of]["bending_angle_deg"]["rms"].as_f64().unwrap();
    assert!(rms("before") > 4.0 && rms("outputs") < 0.1, "{found}");
    assert_eq!(found["source"], "finite elements");
    let state = json(folder, &["predict", "mine.twin", "--json", "--pressure", "0.03", "--gap", "80"]);
    let offset = state["observables"]["bending_angle_deg"]["offset"].as_f64().unwrap();
    assert!((offset - 6.0).abs() < 0.1, "{state}");
    let card = json(folder, &["inspect", "mine.twin", "--card", "json"]);
    let outputs = card["outputs"].as_array().unwrap();
    let offsets: Vec<&Value> = outputs.iter().filter(|of| of["measured_offset"].is_array()).collect();
    for name in ["bending_angle_deg", "x", "y"] {
        assert!(offsets.iter().any(|of| of["name"] == name), "{name}: {card}");
    }
}

#[test]
fn markers_are_drawn_at_instants() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    let mut text = "Frame,Time (Seconds),P (kPa),tip X (mm),tip Y (mm),tip Z (mm)\n".to_owned();
    for row in 0..200 {
        let p = 30.0 * (1.0 - (0.1 * f64::from(row)).cos());
        text += &format!("{row},{},{p},{},{},{}\n", 0.05 * f64::from(row), 100.0 - 0.1 * p, -p, 0.01 * p);
    }
    std::fs::write(folder.join("run1.csv"), text).unwrap();
    assert!(run(folder, &["inspect", "run1.csv", "--out", "log.toml"]).status.success());
    let proposed = std::fs::read_to_string(folder.join("log.toml")).unwrap();
    assert!(proposed.contains("column = 2\nunit = \"Seconds\""), "frames are not the time: {proposed}");
    json(folder, &LEARN);
    json(folder, &compare("run1.csv", "log.toml"));
    assert!(folder.join("out/body.png").is_file());
    let drawn = "draw mine.twin --set p_mpa=0.05 --field displacement --out markers.png";
    assert!(run(folder, &drawn.split(' ').collect::<Vec<_>>()).status.success());
    let refused = run(folder, &["draw", "mine.twin", "--out", "stress.png"]);
    assert_eq!(refused.status.code(), Some(2), "a measured model has no stress");
}
