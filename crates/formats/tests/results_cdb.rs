//! Ansys archives with tables and listings. `data/*.cdb` were written by mapdl-archive 0.4.2 (`scripts/checks/cdb_fixtures.py`): a
//! hexahedron, a wedge, a pyramid and a tetrahedron 3 apart, as collapsed hexahedra where they are linear. No Ansys was at hand.

use crate::common::{data, quantity};
use formats::cdb;
use formats::cells::surface;
use formats::results::{self, Quantity, parse_listing};
use proptest::prelude::*;
use std::collections::HashMap;
use std::fmt::Write as _;
use std::fs;
use std::path::PathBuf;

/// What the surface of a mesh encloses, and whether it is closed.
fn volume(points: &[[f64; 3]], skin: &[[u32; 3]]) -> (f64, bool) {
    let (mut edges, mut volume) = (HashMap::<(u32, u32), i32>::new(), 0.0);
    for [a, b, c] in skin {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            *edges.entry((*from.min(to), *from.max(to))).or_default() += if from < to { 1 } else { -1 };
        }
        let [p, q, r] = [a, b, c].map(|node| points[*node as usize]);
        let cross = [q[1] * r[2] - q[2] * r[1], q[2] * r[0] - q[0] * r[2], q[0] * r[1] - q[1] * r[0]];
        volume += (0..3).map(|k| p[k] * cross[k]).sum::<f64>() / 6.0;
    }
    (volume, edges.values().all(|count| *count == 0))
}

fn refused(text: &str) -> String {
    let problems = cdb::parse(text).expect_err("refused");
    problems.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n")
}

#[test]
fn collapsed_hexahedra_become_the_cells_that_they_are() {
    for (name, expected, nodes) in
        [("linear.cdb", [12_u8, 13, 14, 10], 23), ("quadratic.cdb", [25, 26, 27, 24], 58)]
    {
        let mesh = cdb::read(&data(name)).unwrap();
        let kinds: Vec<u8> = mesh.blocks.iter().map(|block| block.kind).collect();
        assert_eq!(kinds, expected, "{name}");
        assert_eq!((mesh.points.len(), mesh.labels[0], mesh.points[1]), (nodes, 101, [1.0, 0.0, 0.0]));
        let (found, closed) = volume(&mesh.points, &surface(&mesh.points, &mesh.blocks));
        assert!(closed && (found - (1.0 + 0.5 + 1.0 / 3.0 + 1.0 / 6.0)).abs() < 1e-12, "{name}: {found}");
    }
    let text = cdb::read(&data("linear.cdb")).unwrap().tetrahedra().unwrap_err().to_string();
    assert!(text.contains("SOLID187") && text.contains("1 elements of 8 nodes"), "{text}");
}

/// As releases since 2019 write it, in both forms of the blocks: numbers touch, trailing zeros are left out, types by number and name,
/// contact elements and a shell beside a quadratic tetrahedron collapsed from SOLID186.
const MODEL: &str = include_str!("data/model.cdb");

#[test]
fn blocks_in_both_forms_are_read_and_what_has_no_body_is_passed_over() {
    let mesh = cdb::parse(MODEL).unwrap();
    assert_eq!(mesh.labels, [1, 2, 3, 999, 5, 6, 7, 8, 9, 10]);
    assert_eq!(mesh.points[3], [0.0, 0.0, 1.0]);
    let cells: Vec<(u8, &[u32])> =
        mesh.blocks.iter().map(|block| (block.kind, block.nodes.as_slice())).collect();
    assert_eq!(cells, [(24, &[0, 1, 2, 3, 4, 5, 6, 7, 8, 9][..]), (5, &[0, 2, 1])]);
    assert_eq!(mesh.tetrahedra().unwrap().tets, [[0, 1, 2, 3, 4, 5, 6, 7, 8, 9]]);
    // Without any of the mid-sides the element is linear.
    let linear = MODEL.replace(
        "        5        6        3        7      999",
        "        0        0        3        0      999",
    );
    let linear =
        linear.replace("        8        9       10       10\n", "        0        0        0        0\n");
    assert_eq!(cdb::parse(&linear).unwrap().blocks[0].kind, 10);
}

#[test]
fn what_cannot_be_read_is_refused_by_line_and_element() {
    let with = |from: &str, to: &str| refused(&MODEL.replacen(from, to, 1));
    assert!(with("ET,        1,186", "ET,1,SOLID999").contains("element type 999 at element 7"));
    assert!(with("ET,        1,186", "ET,_T,186").contains("line 4: expected ET,NUMBER,ELEMENT"));
    assert!(
        with("ET,2,CONTA174\n", "")
            .contains("line 24: expected a type that ET names, found type 2 at element 8")
    );
    assert!(
        with("        8        9       10       10\n", "        8        9       11       10\n")
            .contains("node 11 of element 7")
    );
    assert!(with("        5        6        3", "        0        6        3").contains("EMID,ADD"));
    assert!(
        with("        3        3      999", "        3        2      999").contains("collapse to a wedge")
    );
    assert!(
        with("        2        0        0 1.0", "        1        0        0 1.0").contains("node 1 again")
    );
    assert!(with("(3i9,6e21.13e3)", "1 2 3").contains("the columns of the block"));
    assert!(with(" 1.0000000000000E+000\n", " 1.00000_0000000E+000\n").contains("up to three coordinates"));
    let cut = &MODEL[..MODEL.find("N,R5.3").unwrap()];
    assert!(refused(cut).contains("the end of the file: it is cut short"), "{}", refused(cut));
    let unblocked = "/PREP7\nET,1,187\nN,R5.3,LOC,       1,  0.0,  0.0,  0.0\n";
    assert!(refused(unblocked).contains("CDWRITE,DB,run,cdb,,,,BLOCKED"));
    assert!(refused("a song\n").contains("expected NBLOCK with nodes and EBLOCK"));
}

/// What `PRNSOL,U` and `PRNSOL,S` print for the tetrahedron of [`MODEL`]: stresses at corners only, as with /GRAPHICS,FULL.
fn listings() -> String {
    let mut text = String::new();
    for (substep, load) in [(1, 0.5), (2, 1.0)] {
        let head = |text: &mut String, what: &str, of: &str| {
            write!(
                text,
                " PRINT {what}    NODAL SOLUTION PER NODE\n \n  ***** POST1 NODAL {of} LISTING *****\n \n  LOAD STEP=     1  \
                 SUBSTEP=     {substep}\n   TIME=   {load:.4}      LOAD CASE=   0\n \n"
            )
            .unwrap();
        };
        text += "1          ***** ANSYS - ENGINEERING ANALYSIS SYSTEM  RELEASE 14.0 *****\n";
        head(&mut text, "U", "DEGREE OF FREEDOM");
        text += "  THE FOLLOWING DEGREE OF FREEDOM RESULTS ARE IN THE GLOBAL COORDINATE SYSTEM\n \n    NODE       UX           UY           UZ           USUM\n";
        for node in [1, 2, 3, 5, 6, 7, 8, 9, 10, 999] {
            let u = load * f64::from(node);
            writeln!(text, "{node:8}  {u:.5}     -{u:.5}E-002-{u:.5}E-003  0.0000").unwrap();
        }
        text += "\n MAXIMUM ABSOLUTE VALUES\n NODE        999        999        999        999\n VALUE   999.00     -999.00E-002-1.E-003  0.0000\n \n";
        head(&mut text, "S", "STRESS");
        text += "  THE FOLLOWING X,Y,Z VALUES ARE IN GLOBAL COORDINATES\n \n    NODE     SX           SY           SZ           SXY          SYZ          SXZ\n";
        for node in [1, 2, 3, 999] {
            writeln!(
                text,
                "{node:8}   {:.5}     0.0000      0.0000      0.0000      0.0000     -0.0000",
                load * f64::from(node)
            )
            .unwrap();
        }
        text += "\n MINIMUM VALUES\n NODE          1          1          1          1          1          1\n VALUE    1.0 0.0 0.0 0.0 0.0 0.0\n";
    }
    text
}

fn job(results: &[(&str, &str)]) -> (tempfile::TempDir, PathBuf) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.cdb");
    fs::write(&path, MODEL).unwrap();
    results.iter().for_each(|(name, text)| fs::write(dir.path().join(name), text).unwrap());
    (dir, path)
}

#[test]
fn listings_of_prnsol_become_states_with_stress_at_the_mid_sides() {
    let (_dir, path) = job(&[("run.txt", &listings())]);
    let run = results::read(&path).unwrap();
    let states: Vec<(&str, Option<f64>)> =
        run.steps.iter().map(|step| (step.name.as_str(), step.time)).collect();
    assert_eq!(states, [("step 1 substep 1", Some(0.5)), ("step 1 substep 2", Some(1.0))]);
    let u = quantity(&run, 0, "U");
    assert_eq!(
        (&u.components[..], &u.values[3..6]),
        (&["UX", "UY", "UZ"].map(String::from)[..], &[1.0, -0.01, -0.001][..])
    );
    let s = quantity(&run, 1, "S");
    assert_eq!(s.components, ["SX", "SY", "SZ", "SXY", "SYZ", "SXZ"]);
    let along: Vec<f64> = s.values.chunks(6).map(|tensor| tensor[0]).collect();
    assert_eq!(along, [1.0, 2.0, 3.0, 999.0, 1.5, 2.5, 2.0, 500.0, 500.5, 501.0]);
}

#[test]
fn tables_with_axes_in_their_names_are_read_like_numbered_ones() {
    let (dir, path) = job(&[]);
    let mut csv = "NODE,STEP,SXY,UX,UY,UZ,SX,SY,SZ,SYZ,SXZ,energy\n".to_owned();
    for node in [1, 2, 3, 5, 6, 7, 8, 9, 10, 999] {
        writeln!(csv, "{node},1,4,0.1,0.2,{node},1,2,3,5,6,7").unwrap();
    }
    fs::write(dir.path().join("run.csv"), &csv).unwrap();
    let run = results::read(&path).unwrap();
    assert_eq!(quantity(&run, 0, "U").values[9..12], [0.1, 0.2, 999.0]);
    assert_eq!(quantity(&run, 0, "S").values[..6], [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
    assert_eq!(quantity(&run, 0, "energy").components, ["energy"]);
    // Arrays of Ansys have a zero where it has no stress.
    let zeros = csv.replace("NODE,STEP", "NODE,seqv").replace("999,1,", "999,4,");
    let zeros: String = ["5", "6", "7", "8", "9", "10"]
        .iter()
        .fold(zeros, |text, n| text.replace(&format!("\n{n},1,"), &format!("\n{n},0,")));
    fs::write(dir.path().join("run.csv"), zeros).unwrap();
    let run = results::read(&path).unwrap();
    assert_eq!(quantity(&run, 0, "seqv").values, [1.0, 1.0, 1.0, 4.0, 1.0, 1.0, 1.0, 2.5, 2.5, 2.5]);
    fs::write(dir.path().join("run.lis"), "").unwrap();
    let text = results::read(&path).unwrap_err().to_string();
    assert!(text.contains("run.csv and") && text.contains("run.lis"), "{text}");
    fs::remove_file(dir.path().join("run.csv")).unwrap();
    fs::remove_file(dir.path().join("run.lis")).unwrap();
    let text = results::read(&path).unwrap_err().to_string();
    assert!(
        text.contains("run.cdb: results: expected one of the same name") && text.contains("found none"),
        "{text}"
    );
}

#[test]
fn listings_that_cannot_be_taken_say_the_command_that_helps() {
    let labels = cdb::parse(MODEL).unwrap().labels;
    let with = |from: &str, to: &str| {
        let problems = parse_listing(&listings().replacen(from, to, 1), &labels).expect_err("refused");
        problems[0].to_string()
    };
    assert!(with("ARE IN THE GLOBAL COORDINATE SYSTEM", "ARE IN COORDINATE SYSTEM   11").contains("RSYS,0"));
    let text = with("       2  1.0", "       4  1.0");
    assert!(text.contains("line 13: expected a node of the mesh, found 4"), "{text}");
    assert!(
        with("       3  1.5", "       2  1.5")
            .contains("step 1 substep 1, columns UX UY UZ USUM: expected every node once")
    );
    assert!(with("TIME=   0.5000", "FREQ=   0.5000").contains("a mode of vibration"));
    assert!(with("     0.0000      0.0000", " ******* 0.0000").contains("expected a node and 6 numbers"));
    assert!(
        with("    NODE       UX ", "    KNOTEN     UX ")
            .contains("a line NODE with the names of the columns")
    );
    assert!(parse_listing("", &labels).unwrap_err()[0].to_string().contains("listings of PRNSOL"));
}

proptest! {
    #[test]
    fn damaged_archives_are_read_or_refused(at in 0_usize..3000, bytes in prop::collection::vec(any::<u8>(), 0..20)) {
        let mut file = MODEL.as_bytes().to_vec();
        let at = at.min(file.len());
        file.splice(at..(at + bytes.len()).min(file.len()), bytes);
        if let Ok(mesh) = cdb::parse(&String::from_utf8_lossy(&file)) {
            let nodes = mesh.points.len();
            prop_assert!(mesh.blocks.iter().all(|block| block.nodes.iter().all(|node| (*node as usize) < nodes)));
            prop_assert!(mesh.blocks.iter().all(|block| block.nodes.len().is_multiple_of(block.nodes_per_cell)));
        }
    }

    #[test]
    fn damaged_listings_are_read_or_refused(at in 0_usize..5000, bytes in prop::collection::vec(any::<u8>(), 0..20)) {
        let labels = [1, 2, 3, 999, 5, 6, 7, 8, 9, 10];
        let mut file = listings().into_bytes();
        let at = at.min(file.len());
        file.splice(at..(at + bytes.len()).min(file.len()), bytes);
        if let Ok(steps) = parse_listing(&String::from_utf8_lossy(&file), &labels) {
            let sized = |q: &Quantity| q.values.len() == labels.len() * q.components.len();
            prop_assert!(steps.iter().all(|step| step.quantities.iter().all(sized)));
        }
    }
}
