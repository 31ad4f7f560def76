//! Abaqus mesh (`run.inp`) with its results in a table (`run.csv`) or in arrays (`run.npz`) of the same name.
//!
//! The table has a column `node` with the numbers of the mesh, optionally `step` and `time`, and one column for each component.
//! Columns of one quantity end in 1, 2, 3 or 11, 22, 33, 12, 13, 23, or in x, y, z, xy, yz, xz: `u1,u2,u3` is the vector `u`,
//! `sx,...` the tensor `s`.

use super::groups::groups;
use super::run::{Quantity, Run, Step};
use super::stacks;
use crate::abaqus;
use crate::cells::Block;
use crate::error::{Diagnostic, FormatError, collect};
use crate::table::Table;
use std::collections::HashMap;
use std::path::Path;

/// Reads the mesh and its table or arrays.
pub(super) fn read(path: &Path) -> Result<Run, FormatError> {
    let there =
        ["csv", "npz"].map(|ending| path.with_extension(ending)).into_iter().filter(|path| path.exists());
    let there: Vec<_> = there.collect();
    let [results] = there.as_slice() else {
        let expected = "one of the same name as .csv (a table) or .npz (arrays): docs/import.md; softtwin-convert makes the table \
                        of a field report (.rpt)";
        let names: Vec<String> = there.iter().map(|path| path.display().to_string()).collect();
        let found = if names.is_empty() { "none".to_owned() } else { names.join(" and ") };
        return Err(FormatError::one(path, Diagnostic::new("results", expected, found)));
    };
    let mesh = abaqus::read(path)?;
    if results.extension().is_some_and(|ending| ending == "npz") {
        let steps = stacks::read_fields(results, mesh.points.len())?;
        return Ok(Run { points: mesh.points, blocks: mesh.blocks, steps, ..Run::default() });
    }
    with_table(mesh.points, &mesh.labels, mesh.blocks, results)
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
