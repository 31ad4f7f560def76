//! Logs of a bench: described, learned from, compared.

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
    vec!["compare", "--model", "mine.twin", "--recording", recording, "--log", log, "--out", "out", "--json"]
}

#[test]
fn twin_of_a_recording_predicts_another_run_within_its_half_widths() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    bench(folder, "run1.csv", 1, 1.0);
    bench(folder, "run2.csv", 2, 1.0);
    std::fs::write(folder.join("log.toml"), LOG).unwrap();
    let described = json(
        folder,
        &["log", "describe", "run1.csv", "--picture", "columns.svg", "--out", "new.toml", "--json"],
    );
    assert_eq!(described["time_column"], 1);
    assert_eq!(described["columns"][2]["constant"], true);
    assert!(folder.join("columns.svg").is_file() && folder.join("new.toml").is_file());
    assert!(
        run(folder, &["log", "convert", "run1.csv", "--log", "log.toml", "--out", "trace.csv"])
            .status
            .success()
    );
    let trace = std::fs::read_to_string(folder.join("trace.csv")).unwrap();
    assert!(trace.starts_with("t_s,pressure_mpa,idle_mpa,tip_x_mm,tip_y_mm,angle_deg\n"), "{}", &trace[..60]);
    let learned = json(folder, &LEARN);
    assert_eq!(learned["source"], "measured");
    assert_eq!(learned["inputs"], serde_json::json!(["pressure_mpa"]));
    let loops = learned["outputs"]["tip_y_mm"]["loop_share"].as_f64().unwrap();
    assert!((0.03..0.1).contains(&loops), "play of 4 in 60 kPa: {loops}");
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
    let state = json(folder, &["predict", "--model", "mine.twin", "--pressure-mpa", "0.03"]);
    assert_eq!(state["in_domain"], true);
    let inspected = json(folder, &["inspect", "mine.twin", "--json"]);
    assert_eq!(inspected["source"], "measured");
}

#[test]
fn wrong_units_and_swapped_columns_are_noticed() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    bench(folder, "run1.csv", 1, 1.0);
    std::fs::write(folder.join("log.toml"), LOG).unwrap();
    json(folder, &LEARN);
    for (factor, confusion) in [(6.895, "psi taken for kPa"), (10.0, "bar"), (1000.0, "kPa taken for MPa")] {
        bench(folder, "wrong.csv", 2, factor);
        let ended = run(folder, &compare("wrong.csv", "log.toml"));
        let text = String::from_utf8_lossy(&ended.stderr);
        assert_eq!(ended.status.code(), Some(78), "{text}");
        assert!(text.contains(confusion), "{text}");
    }
    bench(folder, "small.csv", 2, 1.0 / 6.895);
    let small = json(folder, &compare("small.csv", "log.toml"));
    assert!(small["remarks"].to_string().contains("psi taken for kPa"), "{small}");
    let swapped = LOG.replace("column = \"x\"", "column = \"z\"").replace("column = \"y\"", "column = \"x\"");
    std::fs::write(folder.join("swapped.toml"), swapped.replace("column = \"z\"", "column = \"y\"")).unwrap();
    let found = json(folder, &compare("run1.csv", "swapped.toml"));
    assert!(found["remarks"].to_string().contains("swapped?"), "{found}");
    std::fs::write(folder.join("other.toml"), LOG.replace("pressure_mpa", "supply_mpa")).unwrap();
    let ended = run(folder, &compare("run1.csv", "other.toml"));
    assert_eq!(ended.status.code(), Some(78));
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
    assert!(learned["remarks"].to_string().contains("less than two periods"), "{learned}");
}

#[test]
fn memory_of_a_recording_lowers_the_error_on_another_run() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    bench(folder, "run1.csv", 1, 1.0);
    bench(folder, "run2.csv", 2, 1.0);
    std::fs::write(folder.join("log.toml"), LOG).unwrap();
    json(folder, &LEARN);
    let rms = || json(folder, &compare("run2.csv", "log.toml"))["outputs"]["tip_y_mm"].clone();
    let statics = rms();
    let learned = json(folder, &[&LEARN[..], &["--memory"]].concat());
    let kept: Vec<&Value> =
        learned["memory"]["blocks"].as_array().unwrap().iter().filter(|b| b["kept"] == true).collect();
    assert!(kept.len() == 1 && kept[0]["block"] == "single play", "{learned}");
    let remembering = rms();
    let of = |value: &Value, key: &str| value[key].as_f64().unwrap();
    assert!(of(&remembering, "rms") < 0.4 * of(&statics, "rms"), "{remembering} {statics}");
    assert!((0.85..=1.0).contains(&of(&remembering, "coverage")), "{remembering}");
    // Along a trace the model answers as along the recording.
    let column = |file: &str, name: &str, factor: f64| -> Vec<f64> {
        let table = formats::table::Table::read(&folder.join(file), true).unwrap();
        let at = table.column(name).unwrap();
        table.rows().map(|row| factor * row.number(at).unwrap()).collect()
    };
    let rows = column("run2.csv", "t_s", 1.0).into_iter().zip(column("run2.csv", "p", 1e-3));
    let lines: Vec<String> = rows.map(|(t_s, pressure_mpa)| format!("{t_s},{pressure_mpa}\n")).collect();
    std::fs::write(folder.join("trace.csv"), format!("t_s,pressure_mpa\n{}", lines.concat())).unwrap();
    let predict = ["predict", "--model", "mine.twin", "--trace", "trace.csv", "--out", "series.csv"];
    json(folder, &[&predict[..], &["--step-ms", "1000"]].concat());
    let compared = column("out/compare.csv", "tip_y_mm_predicted", 1.0);
    let along = column("series.csv", "tip_y_mm", 1.0);
    assert_eq!(along.len(), compared.len());
    let off = along.iter().zip(&compared).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(off < 1e-5, "{off}");
    let widths = column("series.csv", "tip_y_mm_half_width", 1.0);
    assert!(widths[0] > 2.0 * widths[widths.len() - 1], "{widths:?}");
}
