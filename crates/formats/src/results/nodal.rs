//! A mesh with its results in a second file of the same name: Abaqus' `run.inp` with a table (`run.csv`), a report (`run.rpt`) or arrays
//! (`run.npz`), Ansys' `run.cdb` with a table or with listings of `PRNSOL` (`run.txt`, `run.lis`).
//!
//! A table has a column `node` with the numbers of the mesh, may be `step` and `time`, and one column for each component. Columns
//! belong together that end in 1, 2, 3 or 11, 22, 33, 12, 13, 23, or in x, y, z, xy, yz, xz: `u1,u2,u3` is the vector `u`,
//! `sx,...` the tensor `s`.

use super::groups::groups;
use super::listing;
use super::middles;
use super::rpt;
use super::run::{Quantity, Run, Step};
use super::stacks;
use crate::cells::Block;
use crate::error::{Diagnostic, FormatError, collect};
use crate::table::Table;
use crate::{abaqus, cdb, file};
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// Reads an Abaqus mesh and the table, report or arrays beside it.
pub(super) fn read(path: &Path) -> Result<Run, FormatError> {
    let expected =
        "one of the same name as .csv (a table), .rpt (a field report) or .npz (arrays): docs/import.md";
    let results = beside(path, &["csv", "rpt", "npz"], expected)?;
    let mesh = abaqus::read(path)?;
    let blocks = mesh.blocks();
    match results.extension() {
        Some(ending) if ending == "rpt" => {
            let steps = text(&results, |text| rpt::parse(text, &mesh.labels))?;
            Ok(Run { points: mesh.points, blocks, steps, ..Run::default() })
        }
        Some(ending) if ending == "npz" => {
            let steps = stacks::read_fields(&results, mesh.points.len())?;
            Ok(Run { points: mesh.points, blocks, steps, ..Run::default() })
        }
        _ => with_table(mesh.points, &mesh.labels, blocks, &results),
    }
}

/// Reads an Ansys archive and the table or the listings beside it.
pub(super) fn read_archive(path: &Path) -> Result<Run, FormatError> {
    let expected = "one of the same name as .csv (a table) or .txt, .lis (PRNSOL): docs/import.md";
    let results = beside(path, &["csv", "txt", "lis"], expected)?;
    let mesh = cdb::read(path)?;
    let mut run = if results.extension().is_some_and(|ending| ending == "csv") {
        with_table(mesh.points, &mesh.labels, mesh.blocks, &results)?
    } else {
        let steps = text(&results, |text| listing::parse(text, &mesh.labels))?;
        Run { points: mesh.points, blocks: mesh.blocks, steps, ..Run::default() }
    };
    middles::fill(&mut run);
    Ok(run)
}

/// The one file of results beside a mesh.
fn beside(mesh: &Path, endings: &[&str], expected: &str) -> Result<PathBuf, FormatError> {
    let mut there: Vec<PathBuf> =
        endings.iter().map(|ending| mesh.with_extension(ending)).filter(|path| path.exists()).collect();
    if there.len() == 1 {
        return Ok(there.swap_remove(0));
    }
    let names: Vec<String> = there.iter().map(|path| path.display().to_string()).collect();
    let found = if names.is_empty() { "none".to_owned() } else { names.join(" and ") };
    Err(FormatError::one(mesh, Diagnostic::new("results", expected, found)))
}

fn text(
    path: &Path,
    parse: impl FnOnce(&str) -> Result<Vec<Step>, Vec<Diagnostic>>,
) -> Result<Vec<Step>, FormatError> {
    let bytes = file::read_bytes(path, file::MAX_DATA_BYTES)?;
    parse(&String::from_utf8_lossy(&bytes))
        .map_err(|diagnostics| FormatError::Content { path: path.into(), diagnostics })
}

fn with_table(
    points: Vec<[f64; 3]>,
    labels: &[u64],
    blocks: Vec<Block>,
    path: &Path,
) -> Result<Run, FormatError> {
    let table = Table::read(path, true)?;
    let names = table.header();
    let column = |name: &str| names.iter().position(|column| column.eq_ignore_ascii_case(name));
    let [step, time] = ["step", "time"].map(column);
    let Some(node) = column("node") else {
        let missing = table.column("node").err().into_iter().collect();
        return Err(FormatError::Content { path: path.into(), diagnostics: missing });
    };
    let values: Vec<usize> =
        (0..names.len()).filter(|at| *at != node && Some(*at) != step && Some(*at) != time).collect();
    let groups = groups(&values, names);
    let place: HashMap<u64, usize> = labels.iter().enumerate().map(|(at, label)| (*label, at)).collect();
    let (nodes, mut steps, mut diagnostics) = (points.len(), Vec::<Step>::new(), Vec::new());
    let empty = |name: String, time| Step {
        name,
        time,
        quantities: groups
            .iter()
            .map(|(name, columns)| Quantity {
                name: name.clone(),
                components: columns.iter().map(|at| names[*at].clone()).collect(),
                values: vec![f64::NAN; nodes * columns.len()],
            })
            .collect(),
    };
    for row in table.rows() {
        let label = row.text(node).parse().ok().and_then(|label: u64| place.get(&label).copied());
        let Some(at) = label else {
            diagnostics.push(row.diagnostic(node, "a node of the mesh"));
            continue;
        };
        let name = format!("step {}", step.map_or("1", |column| row.text(column)));
        if steps.last().is_none_or(|last| last.name != name) {
            if steps.iter().any(|known| known.name == name) {
                diagnostics.push(Diagnostic::new(row.place(), "the rows of a step together", &name));
                break;
            }
            steps.push(empty(name, time.and_then(|column| row.number(column).ok())));
        }
        let Some(last) = steps.last_mut() else { continue };
        for (quantity, (_, columns)) in last.quantities.iter_mut().zip(&groups) {
            for (k, column) in columns.iter().enumerate() {
                if let Some(value) = collect(row.number(*column), &mut diagnostics) {
                    quantity.values[at * columns.len() + k] = value;
                }
            }
        }
    }
    let run = Run { points, blocks, steps, ..Run::default() };
    FormatError::check(run, path, diagnostics)
}
