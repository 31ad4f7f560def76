//! A structure that is no actuator, from another program's results to predictions: a cantilever with load and thickness as inputs,
//! as VTU files of linear hexahedra with an analytic bending field.

use crate::program::{run, succeeds};
use serde_json::Value;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use tests::cantilever::{beam, cells, simulations, vtu};

const UNITS: [&str; 4] = ["--length-unit", "m", "--stress-unit", "pa"];

#[test]
fn a_cantilever_is_imported_trained_evaluated_and_predicted() {
    let dir = tempfile::tempdir().unwrap();
    let names = simulations(dir.path());
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let pattern =
        ["--pattern", "beam_f{load_n}_t{thickness_mm}.vtu", "--out", "db", "--test-every", "6", "--json"];
    let import = [&["import", "results"], &names[..], &UNITS, &pattern].concat();
    let done: Value = serde_json::from_str(&succeeds(dir.path(), &import)).unwrap();
    assert_eq!(
        (&done["states"], &done["testing"], &done["shape_varies"]),
        (&28.into(), &4.into(), &true.into())
    );
    assert_eq!(done["inputs"], serde_json::json!(["load_n", "thickness_mm"]));
    succeeds(dir.path(), &["train", "--database", "db", "--out", "beam.twin"]);
    succeeds(dir.path(), &["evaluate", "--model", "beam.twin", "--database", "db"]);
    let question = ["--set", "load_n=2.6", "--set", "thickness_mm=7.3", "--out", "state.csv"];
    let answer = succeeds(dir.path(), &[&["predict", "--model", "beam.twin"], &question[..]].concat());
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

#[test]
fn what_is_missing_is_asked_for_by_name() {
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
    assert!(refused(&UNITS).contains("--inputs FILE.csv, --pattern or --ramp"));
    let with = |more: &[&str]| refused(&[&UNITS, more].concat());
    assert!(
        with(&["--pattern", "beam_f{load_n}.vtu"]).contains("expected a number for load_n in beam_f2_t7.vtu")
    );
    assert!(with(&["--pattern", "{load}_t{t}.vtu"]).contains("a number for load"));
    assert!(
        with(&["--pattern", "beam_f{load}_t{thickness_mm}.vtu"]).contains("input load: expected its unit")
    );
    assert!(with(&["--ramp", "load_n=2"]).contains("does not give"));
    assert!(with(&[&pattern[..], &["--field", "heat=K"]].concat()).contains("quantities u, mises"));
    table("file,load_n\nother.vtu,1\n");
    assert!(with(&["--inputs", "inputs.csv"]).contains("a row with beam_f2_t7.vtu in column file"));
    table("file,load_n\nbeam_f2_t7,many\n");
    assert!(with(&["--inputs", "inputs.csv"]).contains("line 2, column load_n: expected a finite number"));
    table("file,load_n,step\nbeam_f2_t7,1,4\n");
    assert!(
        with(&["--inputs", "inputs.csv"]).contains("expected a step of beam_f2_t7.vtu from 1 to 1, found 4")
    );
    table("file,load_n\nbeam_f2_t7,1\nbeam_f2_t7,1\n");
    assert!(with(&["--inputs", "inputs.csv"]).contains("expected inputs that no other state has"));
    table("file,pressure_mpa,gap_mm\nbeam_f2_t7,0.02,40\n");
    assert!(with(&["--inputs", "inputs.csv"]).contains("expected gap_mm and contact_force_n"));
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
    assert!(text.contains("left out: cutback.frd, step 2 increment 1: not converged"), "{text}");
    let cases = fs::read_to_string(dir.path().join("db/cases.csv")).unwrap();
    let rows: Vec<&str> = cases.lines().collect();
    assert_eq!(rows[1..], ["cutback-1,free,train,0,,0.1,0", "cutback-2,free,train,0,,0.2,0"]);
    assert!(fs::read_to_string(dir.path().join("db/database.toml")).unwrap().contains("name = \"ener\""));
}

/// FEniCS' layout: one collection a function, data in HDF5. A file that is cut short is named, and nothing is written.
/// What CalculiX prints beside its results is the contact force of the states that have a gap.
#[test]
fn a_total_force_beside_a_job_is_the_contact_force() {
    let dir = tempfile::tempdir().unwrap();
    let frd = concat!(env!("CARGO_MANIFEST_DIR"), "/../formats/tests/data/cutback.frd");
    fs::copy(frd, dir.path().join("job.frd")).unwrap();
    fs::write(dir.path().join("inputs.csv"), "file,pressure_mpa,gap_mm\njob.frd,0.02,3\n").unwrap();
    let line =
        ["import", "results", "job.frd", "--inputs", "inputs.csv", "--out", "db", "--force-from", "PLATE"];
    let units = ["--length-unit", "mm", "--stress-unit", "mpa"];
    let import = [&line[..], &units[..]].concat();
    let (code, _, err) = run(dir.path(), &import);
    assert!(
        code == 78 && err.contains("TOTALS=ONLY") && err.contains("found totals of: none"),
        "{code} {err}"
    );
    let totals = "\n total force (fx,fy,fz) for set NPLATE and time  0.1000000E+01\n\n  0.0 -2.5E-01 0.0\n";
    fs::write(dir.path().join("job.dat"), totals).unwrap();
    let (code, _, err) = run(dir.path(), &import);
    assert!(code == 78 && err.contains("found totals of: NPLATE"), "{code} {err}");
    fs::write(dir.path().join("job.dat"), totals.replace("NPLATE", "PLATE")).unwrap();
    succeeds(dir.path(), &import);
    let cases = fs::read_to_string(dir.path().join("db/cases.csv")).unwrap();
    assert!(cases.contains("contact") && cases.contains("0.25"), "{cases}");
}

#[test]
fn grids_of_an_xdmf_series_become_states() {
    let dir = tempfile::tempdir().unwrap();
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../formats/tests/data");
    for name in ["fenics.xdmf", "fenics.h5"] {
        fs::copy(data.join(name), dir.path().join(name)).unwrap();
    }
    let units = ["--length-unit", "mm", "--stress-unit", "mpa", "--steps", "all", "--ramp", "load_n=3"];
    let args = [&["import", "results", "fenics.xdmf", "--out", "db"], &units[..]].concat();
    let text = succeeds(dir.path(), &args);
    assert!(text.contains("2 states to train on, 0 to test, 8 nodes"), "{text}");
    let cases = fs::read_to_string(dir.path().join("db/cases.csv")).unwrap();
    let rows: Vec<&str> = cases.lines().collect();
    assert_eq!(rows[1..], ["fenics-1,free,train,0,,1.5,0", "fenics-2,free,train,0,,3,0"]);
    let bytes = fs::read(dir.path().join("fenics.h5")).unwrap();
    fs::write(dir.path().join("fenics.h5"), &bytes[..bytes.len() - 1]).unwrap();
    let args = [&["import", "results", "fenics.xdmf", "--out", "again"], &units[..]].concat();
    let (code, _, err) = run(dir.path(), &args);
    assert_eq!(code, 78, "{err}");
    assert!(err.contains("fenics.h5: file: expected") && err.contains("cut short"), "{err}");
    assert!(!dir.path().join("again").exists());
}

/// Ansys' archive of the beam and its listings, of which the numbers have five digits.
fn archive(load_n: f64, thickness_mm: f64) -> (String, String) {
    let (nodes, cells) = (beam(load_n, thickness_mm), cells());
    let mut mesh = format!("/PREP7\nET,1,SOLID185\nNBLOCK,6,SOLID,{0},{0}\n(3i9,6e21.13e3)\n", nodes.len());
    let mut listing = "  LOAD STEP=     1  SUBSTEP=     1\n   TIME=    1.0000      LOAD CASE=   0\n\n    NODE  UX  UY  UZ  USUM\n".to_owned();
    let mut stress = "\n PRINT S    PRIN NODAL SOLUTION PER NODE\n\n  LOAD STEP=     1  SUBSTEP=     1\n\n    NODE  S1  S2  S3  SINT  SEQV\n".to_owned();
    for (at, (point, u, mises_mpa)) in nodes.iter().enumerate() {
        let [x, y, z] = point.map(|v| format!("{v:21.13e}"));
        writeln!(mesh, "{:9}{:9}{:9}{x}{y}{z}", at + 1, 0, 0).unwrap();
        writeln!(listing, "{:8} {:.4e} {:.4e} {:.4e} 0.0000", at + 1, u[0], u[1], u[2]).unwrap();
        writeln!(stress, "{:8} 0.0000 0.0000 0.0000 0.0000 {mises_mpa:.4e}", at + 1).unwrap();
    }
    writeln!(mesh, "N,R5.3,LOC,       -1,\nEBLOCK,19,SOLID,{0},{0}\n(19i9)", cells.len()).unwrap();
    for (at, cell) in cells.iter().enumerate() {
        let head = [1, 1, 1, 1, 0, 0, 0, 0, 8, 0, at + 1];
        head.iter()
            .copied()
            .chain(cell.iter().map(|node| node + 1))
            .for_each(|n| write!(mesh, "{n:9}").unwrap());
        mesh.push('\n');
    }
    (mesh + "       -1\nFINISH\n", listing + &stress)
}

#[test]
fn ansys_archives_with_listings_become_a_database_that_trains() {
    let dir = tempfile::tempdir().unwrap();
    let mut names = Vec::new();
    for (load, thickness) in (0..4).flat_map(|load| (0..5).map(move |thickness| (load, thickness))) {
        let (load_n, thickness_mm) = (1.0 + f64::from(load), 6.0 + 0.5 * f64::from(thickness));
        let (mesh, listing) = archive(load_n, thickness_mm);
        let name = format!("beam_f{load_n}_t{thickness_mm}");
        fs::write(dir.path().join(format!("{name}.cdb")), mesh).unwrap();
        fs::write(dir.path().join(format!("{name}.txt")), listing).unwrap();
        names.push(format!("{name}.cdb"));
    }
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let options = [
        "--length-unit",
        "mm",
        "--stress-unit",
        "mpa",
        "--pattern",
        "beam_f{load_n}_t{thickness_mm}.cdb",
        "--out",
        "db",
    ];
    let text = succeeds(dir.path(), &[&["import", "results"], &names[..], &options].concat());
    assert!(
        text.contains("20 states to train on, 0 to test, 189 nodes, fields x, y, z, displacement, von_mises"),
        "{text}"
    );
    tip_bends(dir.path(), &["--set", "load_n=2.6", "--set", "thickness_mm=7.3"], (2.6, 7.3));
    // A single one is a mesh too.
    let text = succeeds(dir.path(), &["import", names[0], "--out", "mesh.vtu"]);
    assert!(text.contains("189 nodes, 80 8-node hexahedra"), "{text}");
}

/// Trains, and compares the largest displacement at the question with that of the formulas.
fn tip_bends(dir: &Path, question: &[&str], (load_n, thickness_mm): (f64, f64)) {
    succeeds(dir, &["train", "--database", "db", "--out", "beam.twin"]);
    succeeds(dir, &[&["predict", "--model", "beam.twin", "--out", "state.csv"], question].concat());
    let table = fs::read_to_string(dir.join("state.csv")).unwrap();
    let cells = |line: &str| line.split(',').filter_map(|cell| cell.parse().ok()).collect::<Vec<f64>>();
    let moved_mm =
        table.lines().map(cells).filter(|row| row.len() >= 6).map(|row| row[4]).fold(0.0, f64::max);
    let size = |u: &[f64; 3]| u.iter().map(|v| v * v).sum::<f64>().sqrt();
    let exact_mm = beam(load_n, thickness_mm).iter().map(|node| size(&node.1)).fold(0.0, f64::max);
    assert!((moved_mm - exact_mm).abs() <= 0.01 * exact_mm, "{moved_mm} {exact_mm}");
}

/// A block of FEBio's plot file.
fn block(number: u32, data: &[u8]) -> Vec<u8> {
    [&number.to_le_bytes(), &(data.len() as u32).to_le_bytes(), data].concat()
}

fn words(number: u32, words: impl IntoIterator<Item = u32>) -> Vec<u8> {
    block(number, &words.into_iter().flat_map(u32::to_le_bytes).collect::<Vec<u8>>())
}

fn floats(number: u32, values: impl IntoIterator<Item = f64>) -> Vec<u8> {
    words(number, values.into_iter().map(|value| (value as f32).to_bits()))
}

/// The beam of 6 mm in FEBio's plot file: a state each tenth of the load, stress by element.
fn plot_file(load_n: f64) -> Vec<u8> {
    let (nodes, cells) = (beam(load_n, 6.0), cells());
    let name = |name: &str| block(0x0102_0004, &[name.as_bytes(), &[0; 64]].concat()[..64]);
    let item = |kind, format, text: &str| {
        block(0x0102_0001, &[words(0x0102_0002, [kind]), words(0x0102_0003, [format]), name(text)].concat())
    };
    let header = block(0x0101_0000, &[words(0x0101_0001, [0x35]), words(0x0101_0004, [0])].concat());
    let items =
        [block(0x0102_3000, &item(1, 0, "displacement")), block(0x0102_4000, &item(2, 1, "stress"))].concat();
    let root = block(0x0100_0000, &[header, block(0x0102_0000, &items)].concat());
    let count = nodes.len() as u32;
    let size = block(0x0104_1100, &[words(0x0104_1101, [count]), words(0x0104_1102, [3])].concat());
    let row = |(at, node): (usize, &([f64; 3], [f64; 3], f64))| {
        let [x, y, z] = node.0.map(|v| (v as f32).to_bits());
        [at as u32 + 1, x, y, z]
    };
    let points = words(0x0104_1200, nodes.iter().enumerate().flat_map(row));
    let element = |(at, cell): (usize, &[usize; 8])| {
        words(0x0104_2201, std::iter::once(at as u32 + 1).chain(cell.iter().map(|node| *node as u32)))
    };
    let elements = block(0x0104_2200, &cells.iter().enumerate().flat_map(element).collect::<Vec<u8>>());
    let domain = block(0x0104_2100, &[block(0x0104_2101, &words(0x0104_2102, [0])), elements].concat());
    let mesh = block(
        0x0104_0000,
        &[block(0x0104_1000, &[size, points].concat()), block(0x0104_2000, &domain)].concat(),
    );
    let variable = |values: Vec<u8>| {
        block(0x0202_0001, &[words(0x0202_0002, [1]), block(0x0202_0003, &values)].concat())
    };
    let state = |tenth: u32| {
        let time = f64::from(tenth) / 10.0;
        let u = floats(0, nodes.iter().flat_map(|node| node.1.map(|v| time * v)));
        let along = |cell: &[usize; 8]| cell.iter().map(|node| time * nodes[*node].2 / 8.0).sum::<f64>();
        let stress = floats(1, cells.iter().flat_map(|cell| [along(cell), 0.0, 0.0, 0.0, 0.0, 0.0]));
        let data = [block(0x0202_0300, &variable(u)), block(0x0202_0400, &variable(stress))].concat();
        let header = block(0x0201_0000, &[floats(0x0201_0002, [time]), words(0x0201_0003, [0])].concat());
        block(0x0200_0000, &[header, block(0x0202_0000, &data)].concat())
    };
    let states: Vec<u8> = (1..=10).flat_map(state).collect();
    [b"BEF\0".to_vec(), root, mesh, states].concat()
}

#[test]
fn states_of_febio_become_a_database_that_trains() {
    let dir = tempfile::tempdir().unwrap();
    fs::write(dir.path().join("ramp.xplt"), plot_file(4.0)).unwrap();
    let options = [
        "--length-unit",
        "mm",
        "--stress-unit",
        "mpa",
        "--steps",
        "all",
        "--ramp",
        "load_n=4",
        "--out",
        "db",
    ];
    let text = succeeds(dir.path(), &[&["import", "results", "ramp.xplt"], &options[..]].concat());
    assert!(
        text.contains("10 states to train on, 0 to test, 189 nodes, fields x, y, z, displacement, von_mises"),
        "{text}"
    );
    tip_bends(dir.path(), &["--set", "load_n=2.6"], (2.6, 6.0));
}
