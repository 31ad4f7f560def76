//! A structure that is no actuator, from another program's results to predictions: a cantilever with load and thickness as inputs,
//! as VTU files of linear hexahedra with an analytic bending field.

use crate::program::{run, succeeds};
use serde_json::Value;
use std::fs;
use std::path::Path;
use tests::cantilever::{beam, simulations, vtu};

const UNITS: [&str; 4] = ["--length-unit", "m", "--stress-unit", "pa"];

#[test]
fn cantilever_is_imported_trained_evaluated_and_predicted() {
    let dir = tempfile::tempdir().unwrap();
    let names = simulations(dir.path());
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let pattern =
        ["--pattern", "beam_f{load_n}_t{thickness_mm}.vtu", "--out", "db", "--test-every", "3", "--json"];
    let import = [&["import", "results"], &names[..], &UNITS, &pattern].concat();
    let done: Value = serde_json::from_str(&succeeds(dir.path(), &import)).unwrap();
    assert_eq!(
        (&done["states"], &done["testing"], &done["shape_varies"]),
        (&28.into(), &3.into(), &true.into())
    );
    assert_eq!(done["inputs"], serde_json::json!(["load_n", "thickness_mm"]));
    // Ranges and largest values tell a wrong unit at a glance.
    let whole = |value: &Value| value.as_f64().is_some_and(f64::is_finite);
    let range = |name: &str| [0, 1].map(|end| done["ranges"][name][end].as_f64().unwrap());
    assert!(done["ranges"].as_object().is_some_and(|ranges| ranges.len() == 2), "{done}");
    assert!(["load_n", "thickness_mm"].into_iter().all(|name| range(name)[0] < range(name)[1]), "{done}");
    assert!(whole(&done["largest_displacement_mm"]) && whole(&done["largest_stress_mpa"]), "{done}");
    assert_eq!(done["body"]["remarks"], serde_json::json!([]), "{done}");
    succeeds(dir.path(), &["train", "--database", "db", "--out", "beam.twin"]);
    succeeds(dir.path(), &["evaluate", "beam.twin", "--database", "db"]);
    let question = ["--set", "load_n=2.6", "--set", "thickness_mm=7.3", "--out", "state.csv"];
    let answer = succeeds(dir.path(), &[&["predict", "beam.twin", "--json"], &question[..]].concat());
    let answer: Value = serde_json::from_str(&answer).unwrap();
    assert_eq!((&answer["regime"], &answer["in_domain"]), (&"free".into(), &true.into()), "{answer}");
    let table = fs::read_to_string(dir.path().join("state.csv")).unwrap();
    let numbers = |line: &str| line.split(',').filter_map(|cell| cell.parse().ok()).collect::<Vec<f64>>();
    let rows: Vec<Vec<f64>> = table.lines().map(numbers).filter(|row| row.len() >= 6).collect();
    let exact = beam(2.6, 7.3);
    assert_eq!(rows.len(), exact.len(), "{}", &table[..200]);
    let size = |u: &[f64; 3]| u.iter().map(|v| v * v).sum::<f64>().sqrt();
    let largest_mm = exact.iter().map(|node| size(&node.1)).fold(0.0, f64::max);
    let largest_mpa = exact.iter().map(|node| node.2).fold(0.0, f64::max);
    for (row, (point, u, stress_mpa)) in rows.iter().zip(&exact) {
        let [_, x, y, z, moved_mm, von_mises_mpa] = row[..6] else { panic!("a node and five fields") };
        for (found, k) in [(x, 0), (y, 1), (z, 2)] {
            assert!((found - point[k] - u[k]).abs() <= 0.01 * largest_mm, "{row:?} {point:?} {u:?}");
        }
        assert!((moved_mm - size(u)).abs() <= 0.01 * largest_mm, "{row:?} {u:?}");
        assert!((von_mises_mpa - stress_mpa).abs() <= 0.01 * largest_mpa, "{row:?} {stress_mpa}");
    }
}

/// A length unit of m for files in mm makes a beam of 60 m, and kPa taken for MPa a rubber that no test machine tears.
#[test]
fn a_wrong_unit_is_remarked() {
    let dir = tempfile::tempdir().unwrap();
    let names = simulations(dir.path());
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let remarks = |length: &str, stress: &str| {
        let units = ["--length-unit", length, "--stress-unit", stress];
        let pattern =
            ["--pattern", "beam_f{load_n}_t{thickness_mm}.vtu", "--out", "db", "--replace", "--json"];
        let done = succeeds(dir.path(), &[&["import", "results"], &names[..], &units, &pattern].concat());
        let done: Value = serde_json::from_str(&done).unwrap();
        done["body"]["remarks"].as_array().unwrap().len()
    };
    assert_eq!(remarks("m", "pa"), 0);
    assert_eq!(remarks("mm", "pa"), 1, "a beam of 0.1 mm");
}

/// One folder per job, by a table alone and by a pattern with folders; again over the first; one state of another load.
#[test]
fn jobs_in_folders_are_imported_and_a_state_off_the_curve_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let mut table = "file,load_n\n".to_owned();
    let mut paths = Vec::new();
    for load in 1..=9 {
        let path = format!("job_{load}/results.vtu");
        fs::create_dir(dir.path().join(format!("job_{load}"))).unwrap();
        // The solver of job 5 stopped early.
        let reached = if load == 5 { 4.0 } else { f64::from(load) };
        fs::write(dir.path().join(&path), vtu(reached, 8.0)).unwrap();
        table += &format!("{path},{load}\n");
        paths.push(path);
    }
    fs::write(dir.path().join("inputs.csv"), table + "job_10/results.vtu,10\n").unwrap();
    fn import<'a>(args: &[&'a str]) -> Vec<&'a str> {
        [&["import", "results", "--out", "db"], &UNITS[..], args].concat()
    }
    let (code, _, err) = run(dir.path(), &import(&["--inputs", "inputs.csv"]));
    assert!(code != 0 && err.contains("job_10"), "{code} {err}");
    let paths: Vec<&str> = paths.iter().map(String::as_str).collect();
    let json = |args: &[&str]| -> Value {
        serde_json::from_str(&succeeds(dir.path(), &import(&[args, &["--json"]].concat()))).unwrap()
    };
    let done = json(&[&paths[..], &["--inputs", "inputs.csv", "--test-every", "4"]].concat());
    assert_eq!((&done["states"], &done["testing"]), (&9.into(), &1.into()));
    assert!(done["left_out"].as_array().unwrap().iter().any(|reason| reason.to_string().contains("line 11")));
    let cases = fs::read_to_string(dir.path().join("db/cases.csv")).unwrap();
    assert!(
        cases.contains("job_1-results,free,train") && cases.contains("job_5-results,free,test"),
        "{cases}"
    );
    let pattern = [&paths[..], &["--pattern", "job_{load_n}/re*s.vtu"]].concat();
    assert_eq!(run(dir.path(), &import(&pattern)).0, 2, "there is a database");
    assert_eq!(json(&[&pattern[..], &["--replace"]].concat())["testing"], 0);
    succeeds(dir.path(), &["train", "--database", "db", "--out", "beam.twin", "--json"]);
    let sheet: Value = serde_json::from_slice(&fs::read(dir.path().join("beam.json")).unwrap()).unwrap();
    // Fields that are straight in the input, with a state in the middle: the mode is kept, and states are reproduced.
    let answer = succeeds(dir.path(), &["predict", "beam.twin", "--json", "--set", "load_n=8"]);
    let answer: Value = serde_json::from_str(&answer).unwrap();
    let largest = beam(8.0, 8.0).iter().map(|node| node.2).fold(0.0, f64::max);
    assert!(
        (answer["max_von_mises_mpa"].as_f64().unwrap() - largest).abs() < 1e-3 * largest,
        "{answer} {largest}"
    );
    let untaught = ["contact_force_n", "pressure_mpa", "gap_mm", "force_by_gap_n_per_mm"];
    assert!(untaught.iter().all(|key| answer[key].is_null()), "{answer}");
    assert!(answer["half_widths"]["force_n"].is_null() && answer["dforce"]["load_n"].is_null(), "{answer}");
    let remarks = sheet["remarks"].as_array().unwrap();
    assert!(remarks.len() == 1 && remarks[0].as_str().unwrap().contains("job_5-results"), "{remarks:?}");
}

#[test]
fn missing_inputs_are_requested_by_name() {
    let dir = tempfile::tempdir().unwrap();
    let file = "beam_f2_t7.vtu";
    fs::write(dir.path().join(file), vtu(2.0, 7.0)).unwrap();
    let table = |text: &str| fs::write(dir.path().join("inputs.csv"), text).unwrap();
    let refused = |more: &[&str]| {
        let (code, _, err) = run(dir.path(), &[&["import", "results", file, "--out", "db"], more].concat());
        assert!(matches!(code, 2 | 78), "{code} {err}");
        assert!(!dir.path().join("db").exists(), "nothing is written: {err}");
        err
    };
    let pattern = ["--pattern", "beam_f{load_n}_t{thickness_mm}.vtu"];
    assert!(refused(&pattern).contains("--length-unit"));
    assert!(refused(&[&["--length-unit", "m"], &pattern[..]].concat()).contains("--stress-unit"));
    assert!(refused(&UNITS).contains("--inputs"));
    let with = |more: &[&str]| refused(&[&UNITS, more].concat());
    assert!(with(&["--pattern", "beam_f{load_n}.vtu"]).contains("beam_f2_t7.vtu"));
    assert!(with(&["--pattern", "{load}_t{t}.vtu"]).contains("load"));
    assert!(with(&["--pattern", "beam_f{load}_t{thickness_mm}.vtu"]).contains("load"));
    assert!(with(&["--ramp", "load_n=2"]).contains("--ramp"));
    assert!(with(&[&pattern[..], &["--field", "heat=K"]].concat()).contains("heat"));
    table("file,load_n\nother.vtu,1\n");
    assert!(with(&["--inputs", "inputs.csv"]).contains("beam_f2_t7.vtu"));
    table("file,load_n\nbeam_f2_t7,many\n");
    assert!(with(&["--inputs", "inputs.csv"]).contains("line 2, column load_n"));
    table("file,load_n,step\nbeam_f2_t7,1,4\n");
    assert!(with(&["--inputs", "inputs.csv"]).contains("beam_f2_t7.vtu"));
    table("file,load_n\nbeam_f2_t7,1\nbeam_f2_t7,1\n");
    let again = with(&["--inputs", "inputs.csv"]);
    assert!(again.contains("line 3") && again.contains("line 2"), "{again}");
    table("file,load_n\nbeam_f2_t7,1\nbeam_f2_t7,2\n");
    assert!(with(&["--inputs", "inputs.csv"]).contains("line 3"), "one state with two loads");
    table("file,pressure_mpa,gap_mm\nbeam_f2_t7,0.02,40\n");
    assert!(with(&["--inputs", "inputs.csv"]).contains("contact_force_n"));
}

/// A failed increment is left out and named, the others are states by the solver's time.
#[test]
fn increments_of_a_calculix_job_become_states() {
    let dir = tempfile::tempdir().unwrap();
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../formats/tests/data/cutback.frd");
    fs::copy(data, dir.path().join("cutback.frd")).unwrap();
    let units = ["--length-unit", "mm", "--stress-unit", "mpa", "--steps", "all", "--ramp", "shear_mm=0.2"];
    let args =
        [&["import", "results", "cutback.frd", "--out", "db", "--field", "ENER=mJ/mm3"], &units[..]].concat();
    let text = succeeds(dir.path(), &args);
    assert!(text.contains("cutback.frd, step 2 increment 1"), "{text}");
    let cases = fs::read_to_string(dir.path().join("db/cases.csv")).unwrap();
    let rows: Vec<&str> = cases.lines().collect();
    assert_eq!(rows[1..], ["cutback-1,free,train,0,,0.1,0", "cutback-2,free,train,0,,0.2,0"]);
    assert!(fs::read_to_string(dir.path().join("db/database.toml")).unwrap().contains("name = \"ener\""));
}

/// The .dat file of CalculiX has the contact force of the states with a gap.
#[test]
fn total_force_of_a_job_is_the_contact_force() {
    let dir = tempfile::tempdir().unwrap();
    let frd = concat!(env!("CARGO_MANIFEST_DIR"), "/../formats/tests/data/cutback.frd");
    fs::copy(frd, dir.path().join("job.frd")).unwrap();
    fs::write(dir.path().join("inputs.csv"), "file,pressure_mpa,gap_mm\njob.frd,0.02,3\n").unwrap();
    let line =
        ["import", "results", "job.frd", "--inputs", "inputs.csv", "--out", "db", "--force-from", "PLATE"];
    let units = ["--length-unit", "mm", "--stress-unit", "mpa"];
    let import = [&line[..], &units[..]].concat();
    let (code, _, err) = run(dir.path(), &import);
    assert!(code == 78 && err.contains("TOTALS=ONLY"), "{code} {err}");
    let totals = "\n total force (fx,fy,fz) for set NPLATE and time  0.1000000E+01\n\n  0.0 -2.5E-01 0.0\n";
    fs::write(dir.path().join("job.dat"), totals).unwrap();
    let (code, _, err) = run(dir.path(), &import);
    assert!(code == 78 && err.contains("NPLATE"), "{code} {err}");
    fs::write(dir.path().join("job.dat"), totals.replace("NPLATE", "PLATE")).unwrap();
    succeeds(dir.path(), &import);
    let cases = fs::read_to_string(dir.path().join("db/cases.csv")).unwrap();
    assert!(cases.contains("contact") && cases.contains("0.25"), "{cases}");
}

#[test]
fn formats_of_the_converter_are_refused_with_its_command() {
    let dir = tempfile::tempdir().unwrap();
    let refused = |args: &[&str]| {
        let (code, _, err) = run(dir.path(), args);
        assert_eq!(code, 78, "{err}");
        err
    };
    for name in ["run.xdmf", "run.xplt", "run.cdb", "run.rpt"] {
        fs::write(dir.path().join(name), "").unwrap();
        let import = ["import", "results", name, "--out", "db", "--length-unit", "mm", "--ramp", "load_n=1"];
        assert!(refused(&import).contains(&format!("softtwin-convert {name} --out run.npz")));
    }
    let mesh = refused(&["import", "run.cdb", "--out", "run.vtu"]);
    assert!(mesh.contains("softtwin-convert run.cdb --out run.vtu"), "{mesh}");
}
