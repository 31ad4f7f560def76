//! An Abaqus mesh (`run.inp`) with a table of results at its nodes (`run.csv`): a column `node` with the numbers of the mesh, may
//! be `step` and `time`, and one column for each component. Columns that end in 1, 2, 3 or 11, 22, 33, 12, 13, 23 belong
//! together: `u1,u2,u3` is the vector `u`, `s11,...` the tensor `s`.

use super::run::{Quantity, Run, Step};
use crate::abaqus;
use crate::error::{Diagnostic, FormatError, collect};
use crate::table::Table;
use std::collections::HashMap;
use std::path::Path;

/// Reads both files.
pub(super) fn read(path: &Path) -> Result<Run, FormatError> {
    let mesh = abaqus::read(path)?;
    let table_path = path.with_extension("csv");
    let table = Table::read(&table_path, true)?;
    let wrong = |diagnostics| FormatError::Content { path: table_path.clone(), diagnostics };
    let node = table.column("node").map_err(|diagnostic| wrong(vec![diagnostic]))?;
    let [step, time] = ["step", "time"].map(|name| table.column(name).ok());
    let names = table.header();
    let values: Vec<usize> =
        (0..names.len()).filter(|at| *at != node && Some(*at) != step && Some(*at) != time).collect();
    let groups = groups(&values, names);
    let place: HashMap<u64, usize> = mesh.labels.iter().enumerate().map(|(at, label)| (*label, at)).collect();
    let (nodes, mut steps, mut diagnostics) = (mesh.points.len(), Vec::<Step>::new(), Vec::new());
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
    let blocks = mesh.blocks();
    let run = Run { points: mesh.points, blocks, steps, left_out: Vec::new() };
    FormatError::check(run, &table_path, diagnostics)
}

/// Columns by the name without the number of the component, in the order of the table.
fn groups(columns: &[usize], names: &[String]) -> Vec<(String, Vec<usize>)> {
    let mut groups: Vec<(String, Vec<usize>)> = Vec::new();
    for at in columns {
        let name = names[*at].trim_end_matches(['1', '2', '3']);
        let name = name.trim_end_matches(['-', '.', '_', ':']);
        match groups.iter_mut().find(|group| group.0 == name) {
            Some(group) => group.1.push(*at),
            None => groups.push((name.to_owned(), vec![*at])),
        }
    }
    groups
}
