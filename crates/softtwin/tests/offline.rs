//! The offline commands as a user runs them: exit codes, output, files.

use rom::model::{Model, PressureLimit};
use rom::snapshots::Split;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

/// A folder with the bar's database in `db`.
struct WorkFolder(tempfile::TempDir);

impl WorkFolder {
    fn new() -> Self {
        let place = Self(tempfile::tempdir().unwrap());
        let (database, tets) = crate::common::database(cases());
        formats::database::write(&place.at("db"), &database, formats::vtu::Cells::QuadraticTets(&tets))
            .unwrap();
        place
    }

    fn trained() -> Self {
        let place = Self::new();
        let out = place.run(&["train", "--database", "db", "--out", "bar.twin"]);
        assert_eq!(out.code, 0, "{}", out.err);
        place
    }

    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn command(&self, args: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_softtwin"));
        command.args(args).current_dir(self.0.path()).env_remove("RUST_LOG");
        command
    }

    fn run(&self, args: &[&str]) -> Ended {
        Ended::from(self.command(args).output().unwrap())
    }
}

struct Ended {
    code: i32,
    out: String,
    err: String,
}

impl From<Output> for Ended {
    fn from(output: Output) -> Self {
        let text = |bytes| String::from_utf8(bytes).unwrap();
        Self { code: output.status.code().unwrap(), out: text(output.stdout), err: text(output.stderr) }
    }
}

impl Ended {
    fn json(&self) -> Value {
        assert_eq!(self.code, 0, "{}", self.err);
        assert_eq!(self.out.lines().count(), 1, "one JSON object per line: {}", self.out);
        serde_json::from_str(&self.out).unwrap()
    }

    fn refused(&self, code: i32, part: &str) {
        assert_eq!(self.code, code, "{}{}", self.out, self.err);
        assert!(self.err.contains(part), "`{part}` is not in {}", self.err);
        assert!(self.out.is_empty(), "a refusal prints no result: {}", self.out);
    }
}

fn cases() -> Vec<rom::snapshots::Case> {
    let mut cases = Vec::new();
    for i in 0..12 {
        cases.push(crate::common::case(&format!("f{i}"), Split::Train, 0.009 * f64::from(i), None));
    }
    cases.push(crate::common::case("ft", Split::Test, 0.0415, None));
    for i in 0..6 {
        for j in 0..5 {
            let gap = 1.0 + f64::from(j);
            let pressure = 0.01 * gap + 0.001 + 0.008 * f64::from(i);
            cases.push(crate::common::case(&format!("c{i}{j}"), Split::Train, pressure, Some(gap)));
        }
    }
    cases.push(crate::common::case("ct", Split::Test, 0.044, Some(2.5)));
    cases
}

fn edit(path: &Path, change: impl FnOnce(&mut Vec<u8>)) {
    let mut bytes = std::fs::read(path).unwrap();
    change(&mut bytes);
    std::fs::write(path, bytes).unwrap();
}

#[test]
fn train_writes_a_model_and_its_data_sheet() {
    let place = WorkFolder::new();
    let done = place.run(&["train", "--database", "db", "--out", "bar.twin", "--json"]).json();
    assert_eq!(done["cases"], 42);
    assert!(done["regimes"]["contact"]["force"]["kernel"].is_string());
    let sheet: Value = serde_json::from_slice(&std::fs::read(place.at("bar.json")).unwrap()).unwrap();
    assert_eq!(sheet["database_hash"], done["database_hash"]);
    let inspected = place.run(&["inspect", "bar.twin", "--json"]).json();
    assert_eq!(inspected["database_hash"], done["database_hash"]);
    assert_eq!(inspected["regimes"]["free"]["inputs"][0]["name"], "pressure_mpa");
    let card = std::fs::read_to_string(place.at("bar.card.json")).unwrap();
    assert_eq!(place.run(&["inspect", "bar.twin", "--card", "json"]).out, card);
    let card: Value = serde_json::from_str(&card).unwrap();
    assert_eq!(
        (&card["provenance"]["database_hash"], &card["licence"]),
        (&done["database_hash"], &"not stated".into())
    );
    let files = std::fs::read_dir(place.at("")).unwrap().map(|entry| entry.unwrap().file_name());
    let partial = files.map(|name| name.into_string().unwrap()).find(|name| name.contains(".part"));
    assert_eq!(partial, None);
}

#[test]
fn commented_configuration_is_the_default() {
    let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/train.toml");
    let written: train::config::TrainConfig =
        toml::from_str(&std::fs::read_to_string(config).unwrap()).unwrap();
    assert_eq!(written, train::config::TrainConfig::default());
}

#[test]
fn same_database_gives_the_same_model() {
    let place = WorkFolder::trained();
    assert_eq!(place.run(&["train", "--database", "db", "--out", "again.twin"]).code, 0);
    assert_eq!(std::fs::read(place.at("bar.twin")).unwrap(), std::fs::read(place.at("again.twin")).unwrap());
}

#[test]
fn predict_answers_in_json_and_writes_all_formats() {
    let place = WorkFolder::trained();
    for out in ["s.npy", "s.csv", "s.vtu"] {
        let args = ["predict", "bar.twin", "--json", "--pressure", "0.044", "--gap", "2.5", "--out", out];
        let answer = place.run(&args).json();
        assert_eq!(answer["regime"], "contact");
        assert_eq!(answer["in_domain"], true);
        // The bar presses with 100 P - gap and touches at P = gap / 100.
        assert!((answer["contact_force_n"].as_f64().unwrap() - 1.9).abs() < 0.01, "{answer}");
        assert!((answer["onset_pressure_mpa"].as_f64().unwrap() - 0.025).abs() < 2e-4, "{answer}");
    }
    let array = formats::npy::read_f32(&place.at("s.npy")).unwrap();
    let (points, _) = crate::common::bar(3);
    assert_eq!(array.shape, [points.len(), 5]);
    let tip = points.iter().position(|p| *p == [30.0, 0.0, 0.0]).unwrap();
    assert!(
        (array.data[tip * 5 + 1] + 2.5).abs() < 0.05,
        "the tip rests on the plate: {}",
        array.data[tip * 5 + 1]
    );
    let text = std::fs::read_to_string(place.at("s.csv")).unwrap();
    assert!(text.starts_with(
        "node,x_mm,y_mm,z_mm,displacement_mm,von_mises_mpa,pressure_mpa,gap_mm,contact_force_n\n0,"
    ));
    assert_eq!(text.lines().count(), points.len() + 1);
    let grid = std::fs::read_to_string(place.at("s.vtu")).unwrap();
    assert!(grid.contains("Name=\"gap_mm\" NumberOfTuples=\"1\"") && !grid.contains("Name=\"case\""));
    assert!(grid.contains("Name=\"von_mises [MPa]\"") && grid.contains("Name=\"displacement vector [mm]\""));
}

#[test]
fn prediction_without_gap_has_no_contact() {
    let place = WorkFolder::trained();
    let answer = place.run(&["predict", "bar.twin", "--json", "--pressure", "0.0415"]).json();
    assert_eq!(answer["regime"], "free");
    assert_eq!(answer["contact_force_n"], 0.0);
    assert!(answer["onset_pressure_mpa"].is_null() && answer["gap_mm"].is_null());
    assert!((answer["max_displacement_mm"].as_f64().unwrap() - 4.15).abs() < 1e-3, "{answer}");
}

#[test]
fn prediction_outside_the_training_range_is_flagged() {
    let place = WorkFolder::trained();
    let ran = place.run(&["predict", "bar.twin", "--json", "--pressure", "0.11"]);
    let answer = ran.json();
    assert_eq!(answer["in_domain"], false);
    assert_eq!(answer["domain"], "outside");
    for (name, width) in answer["half_widths"].as_object().expect("half-widths") {
        assert!(width.is_null(), "{name}: {width}");
    }
    assert!(ran.err.contains("pressure_mpa") && ran.err.contains("0.11"), "{}", ran.err);
    // Far outside there is no number at all, in no format.
    let far = ["predict", "bar.twin", "--json", "--pressure", "5"];
    place.run(&far).refused(1, "pressure_mpa");
    place.run(&[&far[..], &["--out", "far.npy"]].concat()).refused(1, "pressure_mpa");
    assert!(!place.at("far.npy").exists());
    place.run(&["export", "bar.twin", "--pressure", "5", "--out", "far.csv"]).refused(1, "pressure_mpa");
}

#[test]
fn pressure_limit_of_a_build_is_named_by_every_description_of_the_model() {
    let place = WorkFolder::trained();
    let path = place.at("bar.twin");
    let mut model = Model::from_bytes(&std::fs::read(&path).unwrap()).unwrap();
    let reason = "the silicone ends here".to_owned();
    model.header.limit = Some(PressureLimit { pressure_mpa: 0.1, reason: reason.clone(), stretch: 3.0 });
    std::fs::write(&path, model.to_bytes().unwrap()).unwrap();
    let inspected = place.run(&["inspect", "bar.twin", "--json"]).json();
    assert_eq!(inspected["pressure_limit"]["reason"], reason, "{inspected}");
    let described = [&["--card", "json"][..], &["--card", "markdown"], &[]];
    for options in described {
        let ran = place.run(&[&["inspect", "bar.twin"], options].concat());
        assert!(ran.code == 0 && ran.out.contains(&reason), "{options:?}: {}{}", ran.out, ran.err);
    }
    let ran = place.run(&["predict", "bar.twin", "--json", "--pressure", "0.11"]);
    assert!(ran.err.contains(&reason), "{}", ran.err);
    // A build leaves it with the states: trained on them in whatever way, a model keeps what the build found.
    let own = format!("[limit]\npressure_mpa = 0.1\nreason = \"{reason}\"\nstretch = 3.0\n");
    std::fs::write(place.at("db/train.toml"), own).unwrap();
    std::fs::write(place.at("mine.toml"), "coverage = 0.8\n").unwrap();
    for way in [&[][..], &["--paper"], &["--config", "mine.toml"]] {
        let again = ["train", "--database", "db", "--out", "again.twin"];
        assert_eq!(place.run(&[&again[..], way].concat()).code, 0);
        let inspected = place.run(&["inspect", "again.twin", "--json"]).json();
        assert_eq!(inspected["pressure_limit"]["reason"], reason, "{way:?}");
    }
}

#[test]
fn evaluation_names_worst_case_and_draws() {
    let place = WorkFolder::trained();
    let args = ["evaluate", "bar.twin", "--database", "db", "--json", "--picture", "e.svg"];
    let report = place.run(&args).json();
    assert_eq!(report["regimes"][0]["cases"], 1);
    assert_eq!(report["regimes"][0]["fields"][0]["worst_case"], "ft");
    assert!(report["regimes"][0]["mse"].as_f64().unwrap() < 1e-6, "{}", report["regimes"][0]);
    assert_eq!(report["leave_one_out"][0]["regime"], "Free");
    assert!(std::fs::read_to_string(place.at("e.svg")).unwrap().contains("largest error over nodes"));
    let text = place.run(&[
        "evaluate",
        "bar.twin",
        "--database",
        "db",
        "--split",
        "all",
        "--picture",
        "e.png",
        "--json",
    ]);
    assert_eq!(text.json()["regimes"][1]["cases"], 31);
    assert!(std::fs::read(place.at("e.png")).unwrap().starts_with(b"\x89PNG"));
}

/// Errors on held-out states set the half-widths of the model on which they were measured.
#[test]
fn measured_errors_set_the_half_widths_of_their_model_only() {
    let place = WorkFolder::trained();
    let unseen = (0..40).map(|i| {
        let gap = 1.2 + 0.09 * f64::from(i);
        let pressure = 0.01 * gap + 0.004 + 0.0007 * f64::from(i * 17 % 40);
        crate::common::case(&format!("u{i}"), Split::Check, pressure, Some(gap))
    });
    let (database, tets) = crate::common::database(cases().into_iter().chain(unseen).collect());
    let cells = formats::vtu::Cells::QuadraticTets(&tets);
    formats::database::write(&place.at("more"), &database, cells).unwrap();
    let evaluate = |model: &str| {
        let line = ["evaluate", model, "--database", "more", "--split", "check", "--json", "--errors"];
        place.run(&[&line[..], &["errors.csv"]].concat()).json()
    };
    evaluate("bar.twin");
    let table = std::fs::read_to_string(place.at("errors.csv")).unwrap();
    assert!(
        table.starts_with("case,regime,pressure_mpa,gap_mm,displacement_error_mm,stress_error_mpa,force_error_n,predictions\n"),
        "{table}"
    );
    assert!(table.lines().count() > 30, "{table}");

    for split in ["train", "all"] {
        let line = ["evaluate", "bar.twin", "--database", "more", "--errors", "seen.csv", "--split", split];
        place.run(&line).refused(2, "training states among them");
        assert!(!place.at("seen.csv").exists());
    }

    let train = ["train", "--database", "db", "--out", "set.twin", "--errors", "errors.csv"];
    assert_eq!(place.run(&train).code, 0);
    let predict =
        |model: &str| place.run(&["predict", model, "--pressure", "0.04", "--gap", "2.5", "--json"]).json();
    let (before, after) = (predict("bar.twin"), predict("set.twin"));
    assert_eq!(before["contact_force_n"], after["contact_force_n"], "predictions are unchanged");
    let found = evaluate("set.twin");
    let coverage = found["regimes"].as_array().unwrap().iter().find(|r| r["regime"] == "Contact").unwrap();
    for share in coverage["coverage"].as_array().unwrap() {
        assert!((0.85..=1.0).contains(&share.as_f64().unwrap()), "{coverage}");
    }
    // Measured on the model with the new half-widths the table is the same: it is about predictions.
    assert_eq!(std::fs::read_to_string(place.at("errors.csv")).unwrap(), table);

    place.run(&[&train[..], &["--paper"]].concat()).refused(78, "these errors are of another one");
    let rows = |count: usize| table.lines().take(count + 1).collect::<Vec<_>>().join("\n");
    std::fs::write(place.at("errors.csv"), rows(19)).unwrap();
    place.run(&train).refused(78, "at least 20 states");
    std::fs::write(place.at("errors.csv"), table.replacen("e-", "x-", 1)).unwrap();
    place.run(&train).refused(78, "errors.csv");
    std::fs::write(place.at("errors.csv"), table.replacen("gap_mm", "gap", 1)).unwrap();
    place.run(&train).refused(78, "a column `gap_mm`");
}

#[test]
fn wrong_usage_exits_with_2() {
    let place = WorkFolder::trained();
    let predict = |more: &[&str]| place.run(&[&["predict", "bar.twin", "--json"], more].concat());
    predict(&["--pressure", "nan"]).refused(2, "expected a number from 0 to 100");
    predict(&["--pressure", "-0.01"]).refused(2, "invalid value '-0.01'");
    predict(&["--pressure", "0.01", "--gap", "inf"]).refused(2, "expected a number from -10000 to 10000");
    predict(&["--pressure", "0.01", "--out", "s.xlsx"])
        .refused(2, ".npy, .csv, .vtu, .dat or .xdmf, found xlsx");
    predict(&["--pressure", "five"]).refused(2, "invalid value 'five'");
    place.run(&["fly"]).refused(2, "unrecognized subcommand 'fly'");
    place.run(&["train", "--database", "db", "--out", "bar.json"]).refused(2, "use .twin");
    place.run(&["train", "--database", "db", "--out", "missing/bar.twin"]).refused(2, "no folder missing");
    let check = ["evaluate", "bar.twin", "--database", "db", "--split", "check"];
    place.run(&check).refused(2, "it has 42 train, 2 test, 0 check");
}

#[test]
fn wrong_files_exit_with_78() {
    let place = WorkFolder::trained();
    std::fs::write(place.at("t.toml"), "modes = 3\n").unwrap();
    let train = ["train", "--database", "db", "--out", "x.twin"];
    place.run(&[&train[..], &["--config", "t.toml"]].concat()).refused(78, "unknown field `modes`");
    std::fs::write(place.at("t.toml"), "coverage = 2.0\nhysteresis_mpa = -1.0\n").unwrap();
    let both = place.run(&[&train[..], &["--config", "t.toml"]].concat());
    both.refused(78, "coverage: expected");
    both.refused(78, "hysteresis_mpa: expected");
    edit(&place.at("bar.twin"), |bytes| {
        let middle = bytes.len() / 2;
        bytes[middle] ^= 1;
    });
    place.run(&["inspect", "bar.twin"]).refused(78, "damaged");
    edit(&place.at("db/snapshots.npy"), |bytes| {
        let end = bytes.len();
        bytes[end - 4..].copy_from_slice(&f32::NAN.to_le_bytes());
    });
    place.run(&train).refused(78, "case ct: 1 non-finite values");
    assert!(!place.at("x.twin").exists());
}

#[test]
fn missing_files_exit_with_1() {
    let place = WorkFolder::new();
    place
        .run(&["inspect", "none.twin"])
        .refused(1, "cannot read the model none.twin; `softtwin train` makes one");
    place.run(&["train", "--database", "none", "--out", "x.twin"]).refused(1, "none/database.toml");
}

#[test]
fn closed_pipe_exits_with_0() {
    let place = WorkFolder::trained();
    let mut child = place
        .command(&["inspect", "bar.twin"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let ended = Ended::from(child.wait_with_output().unwrap());
    assert_eq!((ended.code, ended.err.as_str()), (0, ""));
}

#[test]
fn every_command_has_worked_examples() {
    let place = WorkFolder(tempfile::tempdir().unwrap());
    let help = place.run(&["--help"]).out;
    // The groups of commands stand between the usage and the options.
    let listed = help.split("Usage:").nth(1).unwrap().split("Options:").next().unwrap().to_owned();
    let names: Vec<&str> = listed.lines().filter(|l| l.starts_with("  ") && !l.starts_with("   ")).collect();
    assert!(names.len() > 20, "{help}");
    for name in names.iter().filter_map(|line| line.split_whitespace().next()).filter(|name| *name != "help")
    {
        let text = place.run(&[name, "--help"]).out;
        let examples = text.find("Example").unwrap_or_else(|| panic!("{name} --help shows no examples"));
        assert!(
            0 < examples && examples < text.find("Usage:").unwrap(),
            "{name}: what it does, then examples: {text}"
        );
    }
}
