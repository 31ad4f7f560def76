//! `softtwin mesh --step`: with gmsh's Python package where `SOFTTWIN_GMSH_PYTHON` or `python3` has one, otherwise with a program that answers in its place.

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
    let report = r#"{"faces": [], "quality_least": 0.3, "quality_median": 0.6, "below_0_1": 0, "thinnest_wall_mm": 2.0}"#;
    let answers = program(folder.path(), &format!("cp '{}' part/block.msh\necho '{report}'", made.display()));
    let (code, out, error) = mesh(folder.path(), &answers);
    assert_eq!(code, Some(0), "{error}");
    let found: Value = serde_json::from_str(&out).unwrap();
    assert_eq!(found["surfaces"], serde_json::json!(["cavity", "cavity.lower", "clamp"]), "{found}");
    assert!(found["nodes"] == 2133 && folder.path().join("part/block.png").exists(), "{found}");
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
