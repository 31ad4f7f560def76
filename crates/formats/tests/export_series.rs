//! Series of states: what is written, and what is refused before anything is.

use formats::export::{Label, Moment, StateSeries};
use formats::vtu::Cells;
use formats::{FormatError, npy};
use rom::snapshots::Split;
use std::path::Path;

/// A name that ends a title if it is not escaped, and a number that the second state lacks.
fn label(k: usize) -> Label {
    let gap_mm = if k == 1 { f64::INFINITY } else { 40.0 };
    let numbers = [("pressure_mpa", k as f64 / 100.0), ("gap_mm", gap_mm)];
    let numbers = numbers.map(|(name, value)| (name.to_owned(), value)).to_vec();
    Label { name: format!("state \"{k}\""), numbers }
}

fn write(
    path: &Path,
    count: usize,
    change: impl Fn(&mut Vec<Moment>),
) -> Result<Vec<std::path::PathBuf>, FormatError> {
    let cases = [0.01, 0.02, 0.05].map(|p| crate::common::case(&format!("{p}"), Split::Train, p, None));
    let (database, tets) = crate::common::database(cases.to_vec());
    let state = |k: usize| (0..5).flat_map(|field| database.field(k, field)).collect();
    let mut moments: Vec<Moment> = (0..3)
        .map(|k| Moment { time: k as f64 / 2.0, label: label(k), values: state(k), moved: None })
        .collect();
    change(&mut moments);
    let series = StateSeries {
        fields: &database.fields,
        nodes: database.node_count,
        cells: Cells::QuadraticTets(&tets),
        undeformed: None,
        count,
    };
    series.write(path, moments.into_iter().map(Ok))
}

#[test]
fn every_format_holds_every_state() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    let text = |name: &str| std::fs::read_to_string(at(name)).unwrap();
    let written = write(&at("run.pvd"), 3, |_| {}).unwrap();
    assert_eq!(written.len(), 4, "{written:?}");
    assert!(text("run.pvd").contains("timestep=\"0.5\" part=\"0\" file=\"run_0001.vtu\""));
    write(&at("run.dat"), 3, |_| {}).unwrap();
    assert_eq!(text("run.dat").matches("ZONETYPE=FETETRAHEDRON").count(), 3);
    assert!(text("run.dat").contains("T=\"state '1': pressure_mpa = 0.01\""), "quotes would end the title");
    let (with, without) = (text("run_0000.vtu"), text("run_0001.vtu"));
    assert!(with.contains("Name=\"gap_mm\" NumberOfTuples=\"1\" format=\"ascii\">4e1<"), "{with}");
    assert!(!without.contains("gap_mm") && without.contains("format=\"ascii\">1e-2<"), "{without}");
    assert!(with.contains(">115 116 97 116 101 32 34 48 34<"), "the case's name by its bytes: {with}");
    write(&at("run.xdmf"), 3, |_| {}).unwrap();
    assert_eq!(text("run.xdmf").matches("<Time Value=").count(), 3);
    write(&at("run.csv"), 3, |_| {}).unwrap();
    write(&at("run.npy"), 3, |_| {}).unwrap();
    let array = npy::read_f32(&at("run.npy")).unwrap();
    assert_eq!(array.shape[0], 3);
    let table = text("run.csv");
    let rows: Vec<&str> = table.lines().collect();
    assert_eq!(rows.len(), 1 + 3 * array.shape[1]);
    assert!(rows[0].ends_with(",pressure_mpa,gap_mm,case"), "{}", rows[0]);
    assert!(rows[1].ends_with(",0,40,\"state \"\"0\"\"\""), "{}", rows[1]);
    assert!(rows[1 + array.shape[1]].ends_with(",0.01,,\"state \"\"1\"\"\""), "{}", rows[1 + array.shape[1]]);
}

#[test]
fn what_does_not_fit_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let refused = |name: &str, count, change: fn(&mut Vec<Moment>)| {
        write(&dir.path().join(name), count, change).expect_err("refused").to_string()
    };
    assert!(refused("run.xls", 3, |_| {}).ends_with("found xls"));
    assert!(refused("run.npy", 0, |_| {}).ends_with("found none"));
    assert!(refused("run.npy", 4, |_| {}).ends_with("found 3"));
    let short = refused("run.csv", 3, |moments| {
        moments[1].values.pop();
    });
    assert!(short.contains("state 1"), "{short}");
}
