//! `softtwin mesh --step`: with gmsh's Python package where `SOFTTWIN_GMSH_PYTHON` or `python3` has one, otherwise with a program that
//! answers in its place.

use crate::program::succeeds;
use serde_json::Value;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::Command;
use tests::skip::{Missing, skipped};

/// A block of 20 x 10 x 8 mm with two hollows under a roof of 0.8 and 2 mm, bonded to a strip, written by gmsh. Its writer has no names of
/// solids: they are set in the file.
const BLOCK: &str = r#"
import gmsh, pathlib, re, sys
gmsh.initialize()
occ = gmsh.model.occ
hollows = [(3, occ.addBox(2, 2, 2, 7, 6, 5.2)), (3, occ.addBox(11, 2, 2, 7, 6, 4))]
occ.cut([(3, occ.addBox(0, 0, 0, 20, 10, 8))], hollows)
occ.addBox(0, 0, -1, 20, 10, 1)
occ.synchronize()
gmsh.write(sys.argv[1])
file = pathlib.Path(sys.argv[1])
text = file.read_text()
for place, name in enumerate(["silicone", "strip"], 1):
    text = re.sub(rf"'Open CASCADE STEP translator [\d.]+ 1\.{place}'", f"'{name}'", text)
file.write_text(text)
"#;

fn mesh(folder: &Path, python: &str) -> (Option<i32>, String, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_softtwin"));
    command.current_dir(folder).args([
        "mesh",
        "--step",
        "block.step",
        "--face",
        "clamp=xmin",
        "--size-mm",
        "4",
    ]);
    let done = command.args(["--out", "part/block.msh", "--json", "--python", python]).output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (done.status.code(), text(done.stdout), text(done.stderr))
}

/// Program in place of Python.
fn program(folder: &Path, lines: &str) -> String {
    let path = folder.join("python");
    std::fs::write(&path, format!("#!/bin/sh\n{lines}\n")).unwrap();
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).unwrap();
    path.display().to_string()
}

#[test]
fn mesh_and_figures_of_the_program_are_taken_and_a_missing_package_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let made = crate::actuators::model("shapes/two-chambers/mesh.msh");
    let report = r#"{"faces": [], "quality_least": 0.3, "quality_median": 0.6, "below_0_1": 0, "thinnest_wall_mm": 2.0, "volume_mm3": 7030.0,
        "cavities": [{"name": "cavity", "faces": [7, 8], "centre_mm": [25, 10.5, 6]}]}"#.replace('\n', "");
    let answers = program(folder.path(), &format!("cp '{}' part/block.msh\necho '{report}'", made.display()));
    let (code, out, error) = mesh(folder.path(), &answers);
    assert_eq!(code, Some(0), "{error}");
    let found: Value = serde_json::from_str(&out).unwrap();
    assert_eq!(found["surfaces"], serde_json::json!(["cavity", "cavity.lower", "clamp"]), "{found}");
    assert!(found["nodes"] == 2133 && folder.path().join("part/block.png").exists(), "{found}");
    // Flat facets that lose 2 % of the CAD file's volume are remarked.
    assert_eq!(found["body"]["remarks"].as_array().map(Vec::len), Some(1), "{found}");
    for (lines, part) in [
        ("echo \"ModuleNotFoundError: No module named 'gmsh'\" >&2; exit 1", "pip install gmsh numpy"),
        ("echo 'expected solids, found none' >&2; exit 1", "block.step: expected solids, found none"),
    ] {
        let (code, _, error) = mesh(folder.path(), &program(folder.path(), lines));
        assert!(code == Some(78) && error.contains(part), "{code:?} {error}");
    }
}

#[test]
fn a_block_of_a_step_file_is_meshed_with_its_names() {
    let folder = tempfile::tempdir().unwrap();
    let python = std::env::var("SOFTTWIN_GMSH_PYTHON").unwrap_or_else(|_| "python3".into());
    let written = Command::new(&python).current_dir(folder.path()).args(["-c", BLOCK, "block.step"]).output();
    if !written.is_ok_and(|written| written.status.success()) {
        return skipped(Missing::GmshPackage);
    }
    let (code, out, error) = mesh(folder.path(), &python);
    assert_eq!(code, Some(0), "{error}");
    let found: Value = serde_json::from_str(&out).unwrap();
    assert_eq!(found["surfaces"], serde_json::json!(["cavity", "cavity.2", "clamp"]), "{found}");
    assert_eq!(found["volumes"], serde_json::json!(["silicone", "strip"]), "{found}");
    let report = &found["report"];
    let (wall_mm, least) =
        (report["thinnest_wall_mm"].as_f64().unwrap(), report["quality_least"].as_f64().unwrap());
    assert!((wall_mm - 0.8).abs() < 1.0e-6 && least > 0.1 && report["below_0_1"] == 0, "{found}");
    // Two elements through the roof of 0.8 mm, 4 mm elsewhere.
    let tetrahedra = report["tetrahedra"].as_u64().unwrap();
    assert!((2_000..20_000).contains(&tetrahedra), "{tetrahedra}");
    assert!(folder.path().join("part/block.png").exists());
}

/// Near enough for a mesh file's rounding.
fn near(value: &Value, expected: f64) -> bool {
    value.as_f64().is_some_and(|value| (value - expected).abs() < 1.0e-6 * expected.abs().max(1.0))
}

/// A bar of 50 x 14 x 12 mm with two hollows of 42 x 3 x 6 mm, 2 mm below its top and above its bottom.
#[test]
fn a_mesh_and_an_import_tell_the_measures_of_the_body() {
    let folder = tempfile::tempdir().unwrap();
    let bar = crate::actuators::model("shapes/two-chambers");
    for name in ["actuator.toml", "mesh.msh"] {
        std::fs::copy(bar.join(name), folder.path().join(name)).unwrap();
    }
    let run = |arguments: &[&str]| -> Value {
        serde_json::from_str(&succeeds(folder.path(), &[arguments, &["--json"]].concat())).unwrap()
    };
    let check = |body: &Value| {
        assert!(near(&body["volume_mm3"], 50.0 * 14.0 * 12.0 - 2.0 * 42.0 * 3.0 * 6.0), "{body}");
        assert!(near(&body["thinnest_wall"]["thickness_mm"], 2.0), "{body}");
        assert!(near(&body["high_mm"][0], 50.0) && near(&body["low_mm"][1], 0.0), "{body}");
        let hollows = body["hollows"].as_array().unwrap();
        assert_eq!(hollows.len(), 2, "{body}");
        for hollow in hollows {
            let centre = &hollow["centre_mm"];
            assert!(
                near(&hollow["volume_mm3"], 756.0) && near(&centre[0], 25.0) && near(&centre[2], 6.0),
                "{body}"
            );
        }
        assert_eq!(body["remarks"], serde_json::json!([]), "{body}");
    };
    let mesh = run(&["mesh", "--actuator", "actuator.toml"]);
    check(&mesh["body"]);
    let cavity = mesh["parts"].as_array().unwrap().iter().find(|part| part["name"] == "cavity").unwrap();
    assert!(near(&cavity["encloses_mm3"], 756.0) && near(&cavity["centre_mm"][1], 10.5), "{cavity}");
    check(&run(&["import", "mesh.msh", "--out", "bar.vtu"])["body"]);
    // Rubber of 10 MPa is none.
    let text = std::fs::read_to_string(folder.path().join("actuator.toml")).unwrap();
    std::fs::write(folder.path().join("hard.toml"), text.replace("mu_mpa = 0.1", "mu_mpa = 10.0")).unwrap();
    let hard = run(&["mesh", "--actuator", "hard.toml"]);
    assert_eq!(hard["body"]["remarks"].as_array().map(Vec::len), Some(1), "{hard}");
}

#[test]
fn a_body_of_60_m_and_one_of_a_thirtieth_of_a_millimetre_are_remarked() {
    let folder = tempfile::tempdir().unwrap();
    for (factor, remarks) in [(1.0, 0), (1.2e3, 1), (6.0e-4, 1)] {
        let mut bar = formats::read_mesh(&crate::actuators::model("shapes/two-chambers/mesh.msh")).unwrap();
        bar.points_mm.iter_mut().flatten().for_each(|x| *x *= factor);
        let cells = formats::vtu::Cells::QuadraticTets(&bar.tets);
        let grid = formats::vtu::Grid { points_mm: &bar.points_mm, cells, point_data: &[] };
        formats::vtu::write(&folder.path().join("bar.vtu"), &grid).unwrap();
        let found = succeeds(folder.path(), &["import", "bar.vtu", "--out", "copy.vtu", "--json"]);
        let found: Value = serde_json::from_str(&found).unwrap();
        assert_eq!(found["body"]["remarks"].as_array().map(Vec::len), Some(remarks), "{factor}: {found}");
    }
}
