//! The authors' layouts: both give the database ours gives; what is wrong is named by row and column.

use crate::common::{case, database};
use formats::database::{ObstacleKind, read, write};
use proptest::prelude::*;
use rom::snapshots::{Database, Split};
use std::fmt::Write as _;
use std::path::Path;

fn source() -> (Database, Vec<[u32; 10]>) {
    database(vec![
        case("0", Split::Train, 0.01, None),
        case("1", Split::Test, 0.02, None),
        case("2", Split::Train, 0.05, Some(3.0)),
    ])
}

/// Rows of `entries(entry)` by columns of `cases`.
fn table(database: &Database, cases: &[usize], entries: impl Iterator<Item = usize>) -> String {
    let mut text = String::new();
    for entry in entries {
        let row: Vec<String> = cases.iter().map(|c| database.snapshot(*c)[entry].to_string()).collect();
        let _ = writeln!(text, "{}", row.join(","));
    }
    text
}

/// The free cases stacked, the contact case by field.
fn folder(dir: &Path) -> Database {
    let (database, tets) = source();
    write(&dir.join("ours"), &database, formats::vtu::Cells::QuadraticTets(&tets)).unwrap();
    std::fs::copy(dir.join("ours/mesh.vtu"), dir.join("mesh.vtu")).unwrap();
    let text = "actuator = \"bar\"\nmesh = \"mesh.vtu\"\n[[set]]\nregime = \"free\"\nparameters = \"free_p.csv\"\nstacked = \"free.csv\"\n\
        [[set]]\nregime = \"contact\"\nparameters = \"contact_p.csv\"\n\
        fields = { x = \"X.csv\", y = \"Y.csv\", z = \"Z.csv\", displacement = \"U.csv\", von_mises = \"S.csv\" }\n";
    std::fs::write(dir.join("authors.toml"), text).unwrap();
    std::fs::write(dir.join("free_p.csv"), "split,pressure_mpa\ntrain,0.01\ntest,0.02\n").unwrap();
    std::fs::write(dir.join("contact_p.csv"), "0.05,3,2\n").unwrap();
    std::fs::write(dir.join("free.csv"), table(&database, &[0, 1], 0..database.entries())).unwrap();
    for (field, name) in ["X", "Y", "Z", "U", "S"].into_iter().enumerate() {
        let entries = (field..database.entries()).step_by(5);
        std::fs::write(dir.join(format!("{name}.csv")), table(&database, &[2], entries)).unwrap();
    }
    database
}

#[test]
fn both_layouts_give_the_same_database_as_ours() {
    let dir = tempfile::tempdir().unwrap();
    let expected = folder(dir.path());
    let found = read(dir.path(), ObstacleKind::Plate).unwrap();
    assert_eq!(found.cases, expected.cases);
    assert_eq!(found.snapshots, expected.snapshots);
    assert_eq!(found.hash, expected.hash);
    assert_eq!(found.undeformed_mm, expected.undeformed_mm);
}

#[test]
fn wrong_cells_are_named() {
    for (file, text, part) in [
        ("free.csv", "1,2\n3,x\n", "line 2, column 2: expected a finite number, found `x`"),
        ("free.csv", "1,2\n3\n4,5\n6,7\n8,9\n", "line 2: expected 2 cells, found 1"),
        ("free.csv", "1,2\n3,4\n", "rows: expected 5 a node (X, Y, Z, U, S), found 2"),
        ("free.csv", "1,nan\n", "found `nan`"),
        ("free.csv", "", "rows: expected at least one, found none"),
        ("free_p.csv", "split,speed\ntrain,1\n", "header: expected columns of"),
        ("free_p.csv", "0.1,,,\n", "line 1: expected at most 3 cells, found 4"),
        (
            "contact_p.csv",
            "pressure_mpa,gap_mm\n0.05,3\n",
            "header: expected a column `contact_force_n`, found none of that name",
        ),
        ("Y.csv", "1\n2\n", "nodes as in X.csv, found 2"),
        ("authors.toml", "actuator = \"bar\"\nspeed = 1\n", "unknown field `speed`"),
        (
            "authors.toml",
            "actuator = \"bar\"\n[[set]]\nregime = \"free\"\nparameters = \"free_p.csv\"\n",
            "expected either `stacked` or `fields`, found neither",
        ),
    ] {
        let dir = tempfile::tempdir().unwrap();
        folder(dir.path());
        std::fs::write(dir.path().join(file), text).unwrap();
        let error = read(dir.path(), ObstacleKind::Plate).unwrap_err().to_string();
        assert!(error.contains(part), "`{part}` is not in {error}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn random_text_never_panics(text in "[0-9a-z,.\n-]{0,120}", which in 0_usize..3) {
        let dir = tempfile::tempdir().unwrap();
        folder(dir.path());
        std::fs::write(dir.path().join(["free.csv", "free_p.csv", "contact_p.csv"][which]), &text).unwrap();
        if let Ok(database) = read(dir.path(), ObstacleKind::Plate) {
            prop_assert_eq!(database.snapshots.len(), database.cases.len() * database.entries());
        }
    }
}
