//! The PneuNets actuator (the classical shape, meshed by `scripts/mesh.py`) by way of other programs: its states as the arrays that a
//! solver's user would save, in metres and pascals, become a database, a model and predictions.

use crate::program::succeeds;
use formats::database::ObstacleKind;
use formats::mesh_file::MeshFile;
use rom::snapshots::{Database, Split};
use serde_json::Value;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

fn committed() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models/pneunet/database")
}

/// A file of NumPy's format 1.0, little-endian.
fn npy(path: &Path, kind: &str, shape: &[usize], bytes: &[u8]) {
    let shape: String = shape.iter().fold(String::new(), |text, n| text + &format!("{n}, "));
    let mut header = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({shape}), }}");
    while (header.len() + 11) % 64 != 0 {
        header.push(' ');
    }
    header.push('\n');
    let mut file = b"\x93NUMPY\x01\x00".to_vec();
    file.extend((header.len() as u16).to_le_bytes());
    file.extend(header.as_bytes());
    file.extend(bytes);
    fs::write(path, file).expect("written");
}

/// Cases of the committed database as one run of a solver: its arrays, and the table of its inputs.
fn run_of(database: &Database, mesh: &MeshFile, cases: &[usize], folder: &Path) {
    fs::create_dir(folder.join("run")).expect("a folder");
    let path = |name: &str| folder.join("run").join(name);
    let nodes = database.node_count;
    let points: Vec<u8> = mesh.points_mm.iter().flatten().flat_map(|x| (x * 1e-3).to_le_bytes()).collect();
    npy(&path("points.npy"), "<f8", &[nodes, 3], &points);
    let cells: Vec<u8> = mesh.tets.iter().flatten().flat_map(|node| (*node as i32).to_le_bytes()).collect();
    npy(&path("tetra10.npy"), "<i4", &[mesh.tets.len(), 10], &cells);
    let fields = database.fields.len();
    let (mut moved, mut stress, mut times) = (Vec::new(), Vec::new(), Vec::new());
    let mut table = String::from("file,step,pressure_mpa,gap_mm,contact_force_n,split\n");
    for (step, case) in cases.iter().enumerate() {
        let rows =
            database.snapshots[case * nodes * fields..(case + 1) * nodes * fields].chunks_exact(fields);
        for (row, at) in rows.zip(&mesh.points_mm) {
            (0..3).for_each(|k| moved.extend((((f64::from(row[k]) - at[k]) * 1e-3) as f32).to_le_bytes()));
            stress.extend((row[4] * 1e6).to_le_bytes());
        }
        times.extend((step as f64).to_le_bytes());
        let case = &database.cases[*case];
        let gap = case.gap_mm.map_or(String::new(), |gap| gap.to_string());
        let force = case.gap_mm.map_or(String::new(), |_| case.contact_force_n.to_string());
        // Every eighth one is held out.
        let split = if step % 8 == 5 { "test" } else { "train" };
        writeln!(table, "run,{},{},{gap},{force},{split}", step + 1, case.pressure_mpa).expect("memory");
    }
    npy(&path("displacement.npy"), "<f4", &[cases.len(), nodes, 3], &moved);
    npy(&path("mises.npy"), "<f4", &[cases.len(), nodes], &stress);
    npy(&path("time.npy"), "<f8", &[cases.len()], &times);
    fs::write(folder.join("inputs.csv"), table).expect("written");
}

#[test]
fn imported_pneunets_states_give_an_accurate_model() {
    let database =
        formats::database::read(&committed(), ObstacleKind::Plate).expect("the committed database");
    let mesh = formats::read_mesh(&committed().join("mesh.vtu")).expect("its mesh");
    let train = |(at, case): (usize, &rom::snapshots::Case)| (case.split == Split::Train).then_some(at);
    let cases: Vec<usize> = database.cases.iter().enumerate().filter_map(train).collect();
    let folder = tempfile::tempdir().expect("a folder");
    run_of(&database, &mesh, &cases, folder.path());
    let units = ["--length-unit", "m", "--stress-unit", "pa", "--steps", "all"];
    let import =
        [&["import", "results", "run", "--inputs", "inputs.csv", "--out", "db", "--json"][..], &units]
            .concat();
    let done: Value = serde_json::from_str(&succeeds(folder.path(), &import)).expect("JSON");
    assert_eq!(done["states"], cases.len(), "{done}");
    // One kernel: which is the best is not the question.
    let config = "[contact]\nkernels = [{ kernel = \"cubic\", tail = \"linear\" }]\nshear = [0.0, -0.2]\n";
    fs::write(folder.path().join("train.toml"), config).expect("written");
    succeeds(
        folder.path(),
        &["train", "--database", "db", "--config", "train.toml", "--out", "pneunets.twin"],
    );
    let evaluate = ["evaluate", "pneunets.twin", "--database", "db", "--split", "test", "--json"];
    let found: Value = serde_json::from_str(&succeeds(folder.path(), &evaluate)).expect("JSON");
    let mut judged = 0;
    for regime in found["regimes"].as_array().expect("regimes") {
        // Mean over the held-out states, each at its worst node.
        let fields = regime["fields"].as_array().expect("fields");
        let mean = |name: &str| {
            let field = fields.iter().find(|field| field["field"] == name).expect("a field");
            field["normalised"][0].as_f64().expect("a number")
        };
        assert!(mean("displacement") < 0.002 && mean("von_mises") < 0.02, "{regime:#}");
        assert!(regime["force_normalised"][0].as_f64().is_none_or(|force| force < 0.002), "{regime:#}");
        judged += 1;
    }
    assert_eq!(judged, 2, "free and contact: {found:#}");
}
