//! The database folder: what is written is read back; what is wrong is named.

use crate::common::{case, database};
use formats::FormatError;
use formats::database::{ObstacleKind, obstacle_kinds, read, write};
use proptest::prelude::*;
use rom::snapshots::Split;
use std::path::Path;

fn small(dir: &Path) -> rom::snapshots::Database {
    let cases = vec![
        case("a", Split::Train, 0.01, None),
        case("b", Split::Test, 0.02, None),
        case("c", Split::Check, 0.05, Some(3.0)),
    ];
    let (database, tets) = database(cases);
    write(dir, &database, formats::vtu::Cells::QuadraticTets(&tets)).unwrap();
    database
}

fn replace(path: &Path, from: &str, to: &str) {
    let text = std::fs::read_to_string(path).unwrap();
    assert!(text.contains(from), "`{from}` is not in {}", path.display());
    std::fs::write(path, text.replacen(from, to, 1)).unwrap();
}

fn refusal(dir: &Path) -> String {
    read(dir, ObstacleKind::Plate).unwrap_err().to_string()
}

#[test]
fn round_trip() {
    let dir = tempfile::tempdir().unwrap();
    let written = small(dir.path());
    let back = read(dir.path(), ObstacleKind::Plate).unwrap();
    assert_eq!(back.cases, written.cases);
    assert_eq!(back.fields, written.fields);
    assert_eq!(back.snapshots, written.snapshots);
    assert_eq!(back.undeformed_mm, written.undeformed_mm);
    assert_eq!(back.obstacle, written.obstacle);
    assert_eq!(back.hash, written.hash);
    assert_eq!(obstacle_kinds(dir.path()).unwrap(), [ObstacleKind::Plate]);
}

#[test]
fn surface_is_closed_and_oriented_outwards() {
    let dir = tempfile::tempdir().unwrap();
    small(dir.path());
    let back = read(dir.path(), ObstacleKind::Plate).unwrap();
    let points = back.undeformed_mm.unwrap();
    // Divergence theorem: an outward closed surface encloses the bar's 30 x 10 x 10 mm3.
    let volume: f64 = back
        .surface_triangles
        .iter()
        .map(|t| t.map(|i| points[i as usize]))
        .map(|[a, b, c]| {
            let cross = [b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2], b[0] * c[1] - b[1] * c[0]];
            (a[0] * cross[0] + a[1] * cross[1] + a[2] * cross[2]) / 6.0
        })
        .sum();
    assert!((volume - 3000.0).abs() < 1e-9, "{volume}");
    let bottom = back.node_sets.iter().find(|set| set.name == "bottom").unwrap();
    assert!(!bottom.nodes.is_empty());
    assert!(bottom.nodes.iter().all(|i| points[*i as usize][1] == 0.0));
}

#[test]
fn all_invalid_cells_are_reported_together() {
    let dir = tempfile::tempdir().unwrap();
    small(dir.path());
    let table = "case,regime,split,pressure_mpa,gap_mm,contact_force_n\n\
        a,free,train,nan,,0\na,flying,train,0.1,,0\nc,contact,train,0.1,,0\nd,free,never,1e999,,zero\ne,free\n";
    std::fs::write(dir.path().join("cases.csv"), table).unwrap();
    let text = refusal(dir.path());
    for part in [
        "line 2, column pressure_mpa: expected a finite number, found `nan`",
        "line 3, column regime: expected free, contact or gripper; a structure with several shapes",
        "found `flying`",
        "line 4, column gap_mm: expected a gap in mm",
        "line 5, column split: expected one of train, test, check, found `never`",
        "line 5, column pressure_mpa: expected a finite number, found `1e999`",
        "line 5, column contact_force_n: expected a finite number, found `zero`",
        "line 6: expected 6 cells, found 2",
    ] {
        assert!(text.contains(part), "`{part}` is not in\n{text}");
    }
}

#[test]
fn duplicate_case_name_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    small(dir.path());
    replace(&dir.path().join("cases.csv"), "\nb,", "\na,");
    assert!(refusal(dir.path()).contains("line 3, column case: "));
}

#[test]
fn counts_must_agree() {
    let dir = tempfile::tempdir().unwrap();
    small(dir.path());
    replace(&dir.path().join("database.toml"), "nodes = ", "nodes = 1");
    let text = refusal(dir.path());
    assert!(text.contains("shape: ") && text.contains("[3, 1"), "{text}");
}

#[test]
fn unknown_keys_escaping_paths_and_columns_are_refused() {
    for (file, from, to, part) in [
        ("database.toml", "actuator", "speed = 1\nactuator", "unknown field `speed`"),
        ("database.toml", "layout = 1", "layout = 2", "layout: expected 1, found 2"),
        (
            "database.toml",
            "\"cases.csv\"",
            "\"../cases.csv\"",
            "cases: expected the name of a file in the same folder",
        ),
        ("database.toml", "\"y\"", "\"x\"", "[[field]] 2: expected a name used once, found x"),
        ("cases.csv", "split,", "colour,", "expected a column `split`"),
        ("cases.csv", "contact_force_n", "contact_force_n,tip_mm", "declared as [[extra]]"),
    ] {
        let dir = tempfile::tempdir().unwrap();
        small(dir.path());
        replace(&dir.path().join(file), from, to);
        let text = refusal(dir.path());
        assert!(text.contains(part), "`{part}` is not in\n{text}");
    }
}

#[test]
fn each_scene_reads_its_cases_only() {
    let dir = tempfile::tempdir().unwrap();
    small(dir.path());
    replace(&dir.path().join("cases.csv"), "c,contact", "c,gripper");
    assert_eq!(read(dir.path(), ObstacleKind::Plate).unwrap().cases.len(), 2);
    assert_eq!(read(dir.path(), ObstacleKind::Block).unwrap().cases.len(), 1);
    replace(&dir.path().join("cases.csv"), "c,gripper", "c,contact");
    assert!(read(dir.path(), ObstacleKind::Block).unwrap_err().to_string().ends_with("found none"));
}

#[test]
fn a_missing_file_is_named() {
    let dir = tempfile::tempdir().unwrap();
    small(dir.path());
    std::fs::remove_file(dir.path().join("snapshots.npy")).unwrap();
    let error = read(dir.path(), ObstacleKind::Plate).unwrap_err();
    assert!(matches!(&error, FormatError::Io { path, .. } if path.ends_with("snapshots.npy")), "{error}");
}

#[test]
fn the_shared_database_is_read() {
    let dir = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/database");
    if !dir.exists() {
        println!("skipped: no ../shared/database beside this repository");
        return;
    }
    let database = read(&dir, ObstacleKind::Plate).unwrap();
    assert_eq!((database.cases.len(), database.node_count, database.fields.len()), (111, 25022, 5));
    let undeformed = database.undeformed_mm.as_ref().unwrap();
    // Column U of the database is |x - x0|: an independent check that mesh and snapshots share node order and frame.
    let worst = (0..database.node_count)
        .map(|node| {
            let row = &database.snapshot(60)[node * 5..node * 5 + 5];
            let d = [0, 1, 2].map(|k| f64::from(row[k]) - undeformed[node][k]);
            (d.iter().map(|v| v * v).sum::<f64>().sqrt() - f64::from(row[3])).abs()
        })
        .fold(0.0, f64::max);
    assert!(worst < 1e-3, "{worst}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Columns of the list of cases in any order: the same cases. A column or a case twice is refused.
    #[test]
    fn columns_of_cases_in_any_order_are_the_same_cases(
        order in Just((0_usize..6).collect::<Vec<_>>()).prop_shuffle(), twice in 0_usize..6, row in 1_usize..4,
    ) {
        let dir = tempfile::tempdir().unwrap();
        let written = small(dir.path());
        let path = dir.path().join("cases.csv");
        let text = std::fs::read_to_string(&path).unwrap();
        let lines: Vec<Vec<&str>> = text.lines().map(|line| line.split(',').collect()).collect();
        let columns = lines[0].len();
        let order: Vec<usize> = order.into_iter().filter(|column| *column < columns).chain(6..columns).collect();
        let table = |columns: &[usize], rows: &[usize]| -> String {
            let line = |row: &usize| columns.iter().map(|c| lines[*row][*c]).collect::<Vec<_>>().join(",") + "\n";
            rows.iter().map(line).collect()
        };
        std::fs::write(&path, table(&order, &[0, 1, 2, 3])).unwrap();
        prop_assert_eq!(read(dir.path(), ObstacleKind::Plate).unwrap().cases, written.cases);
        let longer = [&order[..], &[twice % columns]].concat();
        std::fs::write(&path, table(&longer, &[0, 1, 2, 3])).unwrap();
        prop_assert!(read(dir.path(), ObstacleKind::Plate).is_err(), "{} twice", lines[0][twice % columns]);
        std::fs::write(&path, table(&order, &[0, 1, 2, 3, row])).unwrap();
        prop_assert!(read(dir.path(), ObstacleKind::Plate).is_err(), "{} twice", lines[row][0]);
    }

    #[test]
    fn random_tables_never_panic(text in "[a-z0-9,.\n\"-]{0,200}") {
        let dir = tempfile::tempdir().unwrap();
        small(dir.path());
        std::fs::write(dir.path().join("cases.csv"), &text).unwrap();
        prop_assert!(read(dir.path(), ObstacleKind::Plate).is_err());
        std::fs::write(dir.path().join("database.toml"), &text).unwrap();
        prop_assert!(read(dir.path(), ObstacleKind::Plate).is_err());
    }
}

fn with_parameters(folder: &Path) -> rom::snapshots::Database {
    use crate::synthetic::design;
    let states: Vec<_> = design::states(0, 12).into_iter().map(|s| (Split::Train, s)).collect();
    let made = design::database(&states, true);
    write(folder, &made, formats::vtu::Cells::QuadraticTets(&[])).expect("writable");
    made
}

#[test]
fn parameters_and_derivatives_survive_the_round_trip() {
    let dir = tempfile::tempdir().unwrap();
    let made = with_parameters(dir.path());
    let text = std::fs::read_to_string(dir.path().join("cases.csv")).unwrap();
    let header =
        "case,regime,split,pressure_mpa,gap_mm,elastomer.law.mu_mpa,chambers.length_mm,contact_force_n";
    assert_eq!(text.lines().next(), Some(header));
    let found = read(dir.path(), ObstacleKind::Plate).unwrap();
    assert_eq!((&found.parameters, &found.cases), (&made.parameters, &made.cases));
    assert_eq!(found.sensitivities, made.sensitivities);
    assert_eq!(found.hash, made.hash);
}

#[test]
fn invalid_parameters_and_derivatives_are_reported() {
    for (file, from, to, part) in [
        ("cases.csv", "elastomer.law.mu_mpa", "elastomer.law.mu", "expected a column `elastomer.law.mu_mpa`"),
        ("database.toml", "nominal = 0.8", "", "nominal = a number"),
        ("database.toml", "chambers.length_mm", "elastomer.law.mu_mpa", "a name used once"),
        ("database.toml", "\"pressure_mpa\"", "\"gap_mm\"", "[[input]] 1 (gap_mm): expected mm"),
        ("database.toml", "\"sensitivities.npy\"", "\"../sensitivities.npy\"", "a file in the same folder"),
        ("sensitivities.csv", "11,", "12,", "a case of the table of cases"),
        ("sensitivities.csv", "chambers.length_mm", "chambers.width_mm", "one of pressure_mpa, gap_mm"),
    ] {
        let dir = tempfile::tempdir().unwrap();
        with_parameters(dir.path());
        replace(&dir.path().join(file), from, to);
        let text = refusal(dir.path());
        assert!(text.contains(part), "`{part}` is not in\n{text}");
    }
}
