//! `softtwin mesh --step`: with gmsh's Python package where there is one, otherwise with a program that answers in its place.

use serde_json::Value;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::Command;
use tests::skip::{Missing, skipped};

/// A hollow block of 12 x 10 x 8 mm with walls of 2 mm, written by gmsh.
const BLOCK: &str = "
import gmsh, sys
gmsh.initialize()
occ = gmsh.model.occ
occ.cut([(3, occ.addBox(0, 0, 0, 12, 10, 8))], [(3, occ.addBox(2, 2, 2, 8, 6, 4))])
occ.synchronize()
gmsh.write(sys.argv[1])
";

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
    let done = command.args(["--out", "block.msh", "--json", "--python", python]).output().unwrap();
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
    let report = r#"{"faces": [], "quality_least": 0.3, "quality_median": 0.6, "below_0_1": 0, "thinnest_wall_mm": 2.0}"#;
    let answers = program(folder.path(), &format!("cp '{}' block.msh\necho '{report}'", made.display()));
    let (code, out, error) = mesh(folder.path(), &answers);
    assert_eq!(code, Some(0), "{error}");
    let found: Value = serde_json::from_str(&out).unwrap();
    assert_eq!(found["surfaces"], serde_json::json!(["cavity", "cavity.lower", "clamp"]), "{found}");
    assert!(found["nodes"] == 2133 && folder.path().join("block.png").exists(), "{found}");
    for (lines, part) in [
        ("echo \"ModuleNotFoundError: No module named 'gmsh'\" >&2; exit 1", "pip install gmsh numpy"),
        ("echo 'expected solids, found none' >&2; exit 1", "block.step: expected solids, found none"),
    ] {
        let (code, _, error) = mesh(folder.path(), &program(folder.path(), lines));
        assert!(code == Some(78) && error.contains(part), "{code:?} {error}");
    }
}

#[test]
fn a_hollow_block_of_a_step_file_is_meshed_with_its_names() {
    let folder = tempfile::tempdir().unwrap();
    let written =
        Command::new("python3").current_dir(folder.path()).args(["-c", BLOCK, "block.step"]).output();
    if !written.is_ok_and(|written| written.status.success()) {
        return skipped(Missing::GmshPackage);
    }
    let (code, out, error) = mesh(folder.path(), "python3");
    assert_eq!(code, Some(0), "{error}");
    let found: Value = serde_json::from_str(&out).unwrap();
    assert_eq!(found["surfaces"], serde_json::json!(["cavity", "clamp"]), "{found}");
    let wall_mm = found["report"]["thinnest_wall_mm"].as_f64().unwrap();
    assert!((wall_mm - 2.0).abs() < 0.1 && found["report"]["below_0_1"] == 0, "{found}");
}
