//! A structure with three regimes of its own names, from another program's results to predictions: a strip that is straight below
//! a load and buckles to one of two sides.

use crate::program::{run, succeeds};
use rom::model::{ModelReader, Selection};
use serde_json::{Value, json};
use std::fs;
use std::io::Cursor;
use std::path::Path;
use tests::strip::{nodes, simulations};

/// The regimes in the order in which the states name them.
const REGIMES: [&str; 3] = ["straight", "down", "up"];
const STATES: usize = 80;
const UNITS: [&str; 4] = ["--length-unit", "m", "--stress-unit", "pa"];
const TABLE: [&str; 4] = ["--inputs", "inputs.csv", "--out", "db"];

fn answer(folder: &Path, args: &[&str]) -> Value {
    serde_json::from_str(&succeeds(folder, args)).unwrap()
}

fn import<'a>(names: &'a [String], more: &[&'a str]) -> Vec<&'a str> {
    let names = names.iter().map(String::as_str);
    ["import", "results"].into_iter().chain(names).chain(UNITS).chain(more.iter().copied()).collect()
}

#[test]
fn a_strip_is_imported_trained_evaluated_and_predicted_in_its_regimes() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path();
    let names = simulations(folder, STATES);
    let said = succeeds(folder, &import(&names, &TABLE));
    assert!(REGIMES.iter().all(|name| said.contains(&format!("regime {name}: "))), "{said}");
    let table = fs::read_to_string(folder.join("db/cases.csv")).unwrap();
    assert!(REGIMES.iter().all(|name| table.contains(&format!(",{name},"))), "{table}");

    let said = succeeds(folder, &["train", "--database", "db", "--out", "strip.twin"]);
    assert!(said.contains("regimes told apart by ") && said.contains("of 64 training states"), "{said}");
    assert!(REGIMES.iter().all(|name| said.contains(&format!("regime {name}: "))), "{said}");
    let sheet: Value = serde_json::from_slice(&fs::read(folder.join("strip.json")).unwrap()).unwrap();
    assert!(sheet["border"]["wrong_share"].as_f64().unwrap() < 0.2, "{}", sheet["border"]);

    held_back(folder);
    predicted(folder);

    let shown = succeeds(folder, &["inspect", "strip.twin"]);
    assert!(shown.contains("regime up (5 in states)"), "{shown}");
    let card: Value = serde_json::from_slice(&fs::read(folder.join("strip.card.json")).unwrap()).unwrap();
    assert_eq!(
        (&card["regimes"]["straight"]["number"], &card["regimes"]["down"]["number"]),
        (&json!(3), &json!(4))
    );
    let bytes = fs::read(folder.join("strip.twin")).unwrap();
    let model = ModelReader::open(Cursor::new(bytes)).unwrap().load(&Selection::default()).unwrap();
    let fmu = fmu::describe(&model, &[], "token");
    assert!(fmu.contains("description=\"3 straight, 4 down, 5 up\"/>"), "{fmu}");
    succeeds(
        folder,
        &["render", "--model", "strip.twin", "--modes", "up", "--field", "displacement", "--out", "up.png"],
    );
    let (code, _, err) =
        run(folder, &["render", "--model", "strip.twin", "--modes", "contact", "--out", "x.png"]);
    assert!(code == 2 && err.contains("it has straight, down, up"), "{code} {err}");
}

/// On states that training did not see: in the right regime, and there as good as a model of one regime.
fn held_back(folder: &Path) {
    let report = answer(folder, &["evaluate", "--model", "strip.twin", "--database", "db", "--json"]);
    let summaries = report["regimes"].as_array().unwrap();
    assert_eq!(summaries.iter().map(|s| s["regime_name"].as_str().unwrap()).collect::<Vec<_>>(), REGIMES);
    let (mut found, mut all) = (0.0, 0.0);
    for summary in summaries {
        let cases = summary["cases"].as_f64().unwrap();
        found += cases * summary["in_regime"].as_f64().unwrap();
        all += cases;
    }
    assert!(all == 16.0 && found >= 14.0, "{found} of {all} states are found in their regime");
    for case in report["cases"].as_array().unwrap() {
        let [answered, own] = [0, 1].map(|k| case["regime_names"][k].as_str().unwrap());
        let inside = case["domain"] == "inside" && answered == own;
        let off = case["fields"][1]["max"].as_f64().unwrap(); // y, mm
        assert!(!inside || off < 0.1, "case {}: {off} mm off", case["case"]);
    }
    let text = succeeds(folder, &["evaluate", "--model", "strip.twin", "--database", "db"]);
    assert!(text.contains("regime down: ") && text.contains("found in this regime: "), "{text}");
}

fn predicted(folder: &Path) {
    for (load_n, imperfection_mm, regime) in
        [(5.0, 0.2, "straight"), (14.0, 0.25, "up"), (14.0, -0.25, "down")]
    {
        let set = [format!("load_n={load_n}"), format!("imperfection_mm={imperfection_mm}")];
        let question =
            ["predict", "--model", "strip.twin", "--set", &set[0], "--set", &set[1], "--out", "state.csv"];
        let answer = answer(folder, &question);
        assert_eq!(answer["regime"], regime, "{answer}");
        assert_eq!((&answer["contact_force_n"], &answer["onset_pressure_mpa"]), (&json!(0.0), &Value::Null));
        let table = fs::read_to_string(folder.join("state.csv")).unwrap();
        let numbers = |line: &str| line.split(',').filter_map(|cell| cell.parse().ok()).collect::<Vec<f64>>();
        let rows: Vec<Vec<f64>> = table.lines().map(numbers).filter(|row| row.len() >= 6).collect();
        let exact = nodes(load_n, imperfection_mm);
        assert_eq!(rows.len(), exact.len());
        for (row, (point, moved, _)) in rows.iter().zip(exact) {
            let off = (row[2] - point[1] - moved[1]).abs();
            assert!(off < 0.1, "{regime}: y is {off} mm off");
        }
    }
}

#[test]
fn regimes_may_stand_in_the_names_of_the_files() {
    let dir = tempfile::tempdir().unwrap();
    let names = simulations(dir.path(), 20);
    let pattern = ["--pattern", "strip_{regime}_f{load_n}_i{imperfection_mm}.vtu", "--out", "db", "--json"];
    let done = answer(dir.path(), &import(&names, &pattern));
    let mut found: Vec<&str> = done["regimes"].as_array().unwrap().iter().filter_map(Value::as_str).collect();
    found.sort_unstable();
    assert_eq!(
        (found, &done["inputs"]),
        (vec!["down", "straight", "up"], &json!(["imperfection_mm", "load_n"]))
    );
    // As many states as one regime has are too few for the others.
    let (code, _, err) = run(dir.path(), &["train", "--database", "db", "--out", "strip.twin"]);
    assert!(code == 0 || (code == 78 && err.contains("expected at least 4 training states")), "{code} {err}");
}

#[test]
fn what_cannot_be_a_regime_is_refused_by_place() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path();
    let names = simulations(folder, 20);
    let good = fs::read_to_string(folder.join("inputs.csv")).unwrap();
    let refused = |table: &str| {
        fs::write(folder.join("inputs.csv"), table).unwrap();
        let (code, _, err) = run(folder, &import(&names, &TABLE));
        assert!(code == 78 && !folder.join("db").exists(), "{code} {err}");
        err
    };
    let err = refused(&good.replacen(",straight,", ",,", 1));
    assert!(err.contains("names of your own for all states") || err.contains("a regime by name"), "{err}");
    let err = refused(&good.replacen(",up,", ",free,", 1));
    assert!(err.contains("`free`") && err.contains("a name of your own, as `straight`"), "{err}");
    let err = refused(&good.replace(",straight,", ",straight/flat,"));
    assert!(err.contains("letters, digits, - and _") && err.contains("`straight/flat`"), "{err}");
    let err = refused(&good.replace(",straight,", ",Free,"));
    assert!(err.contains("`free` means something already"), "{err}");
    let mut each = 0;
    let lines = good.lines().map(|line| {
        each += 1;
        REGIMES
            .iter()
            .fold(line.to_owned(), |line, name| line.replace(&format!(",{name},"), &format!(",r{each},")))
    });
    let err = refused(&(lines.collect::<Vec<_>>().join("\n") + "\n"));
    assert!(err.contains("at most 16 names"), "{err}");

    // The same in the table of a database, and too few states of one regime.
    fs::write(folder.join("inputs.csv"), &good).unwrap();
    succeeds(folder, &import(&names, &TABLE));
    let table = fs::read_to_string(folder.join("db/cases.csv")).unwrap();
    let untrained = |table: String| {
        fs::write(folder.join("db/cases.csv"), table).unwrap();
        let (code, _, err) = run(folder, &["train", "--database", "db", "--out", "strip.twin"]);
        assert!(code == 78 && !folder.join("strip.twin").exists(), "{code} {err}");
        err
    };
    let err = untrained(table.replacen(",straight,", ",free,", 1));
    assert!(err.contains("cases.csv") && err.contains("your own"), "{err}");
    let err = untrained(table.replacen(",straight,", ",slanted,", 1));
    assert!(
        err.contains("regime slanted: expected at least 3 training states") && err.contains("found 1"),
        "{err}"
    );
}
