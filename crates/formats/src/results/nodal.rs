//! Abaqus mesh (`run.inp`) with its results in a table (`run.csv`) or in arrays (`run.npz`) of the same name.
//!
//! The table has a column `node` with the numbers of the mesh, `instance` if there are several, optionally `step` and `time`, and one
//! column for each component.
//! Columns of one quantity end in 1, 2, 3 or 11, 22, 33, 12, 13, 23, or in x, y, z, xy, yz, xz: `u1,u2,u3` is the vector `u`,
//! `sx,...` the tensor `s`.

use super::run::{NodalQuantity, Run, Step, same_or_new};
use super::stacks;
use crate::abaqus::{self, AbaqusMesh};
use crate::error::{Diagnostic, FormatError, collect};
use crate::table::Table;
use std::collections::{HashMap, HashSet};
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
    if let Some(place) = mesh.rotated {
        let expected = "an instance without rotation: these results may be in its directions or in the global ones; \
                        write the job as a flat file (noPartsInputFile=ON)";
        return Err(FormatError::one(path, Diagnostic::new(place, expected, "a rotation")));
    }
    if results.extension().is_some_and(|ending| ending == "npz") {
        let steps = stacks::read_fields(results, mesh.points.len())?;
        let AbaqusMesh { points, blocks, left_out, .. } = mesh;
        return Ok(Run { points, blocks, steps, left_out, ..Run::default() });
    }
    with_table(mesh, results)
}

/// Each column once, and one for the instance where the mesh has several.
fn check_header(names: &[String], has_instance: bool, mesh: &AbaqusMesh) -> Result<(), Diagnostic> {
    let again = (0..names.len()).find(|at| {
        !names[*at].is_empty() && names[..*at].iter().any(|name| name.eq_ignore_ascii_case(&names[*at]))
    });
    if let Some(at) = again {
        let found = format!("two columns `{}`", names[at]);
        return Err(Diagnostic::new("header", "every column once", found));
    }
    if !has_instance && mesh.instances.len() > 1 {
        let names: Vec<&str> = mesh.instances.iter().map(|(name, _)| name.as_str()).collect();
        let expected =
            format!("a column `instance` beside `node`: the mesh has the instances {}", names.join(", "));
        return Err(Diagnostic::new("header", expected, "none of that name"));
    }
    Ok(())
}

fn with_table(mesh: AbaqusMesh, path: &Path) -> Result<Run, FormatError> {
    let table = Table::read(path, true)?;
    let names = table.header();
    let column = |name: &str| names.iter().position(|column| column.eq_ignore_ascii_case(name));
    let [step, time, instance] = ["step", "time", "instance"].map(column);
    let Some(node) = column("node") else {
        let missing = table.column("node").err().into_iter().collect();
        return Err(FormatError::Content { path: path.into(), diagnostics: missing });
    };
    check_header(names, instance.is_some(), &mesh).map_err(|wrong| FormatError::one(path, wrong))?;
    let values: Vec<usize> =
        (0..names.len()).filter(|at| ![Some(node), step, time, instance].contains(&Some(*at))).collect();
    let groups = groups(&values, names);
    let of_instance =
        mesh.instances.iter().flat_map(|(name, count)| std::iter::repeat_n(name.as_str(), *count));
    let place: HashMap<(&str, u64), usize> = of_instance
        .zip(&mesh.labels)
        .enumerate()
        .map(|(index, (name, label))| ((name, *label), index))
        .collect();
    let only = mesh.instances.first().map_or("", |(name, _)| name.as_str());
    let (nodes, mut steps, mut diagnostics) = (mesh.points.len(), Vec::<Step>::new(), Vec::new());
    let mut lines: HashMap<usize, String> = HashMap::new();
    let empty = |name: String, time| Step {
        name,
        time,
        quantities: groups
            .iter()
            .map(|(name, columns)| NodalQuantity {
                name: name.clone(),
                components: columns.iter().map(|at| names[*at].clone()).collect(),
                values: vec![f64::NAN; nodes * columns.len()],
            })
            .collect(),
    };
    for row in table.rows() {
        let instance_name = instance.map_or(only.to_owned(), |column| row.text(column).to_ascii_uppercase());
        let label = row
            .text(node)
            .parse()
            .ok()
            .and_then(|label: u64| place.get(&(instance_name.as_str(), label)).copied());
        let Some(at) = label else {
            diagnostics.push(row.diagnostic(node, "a node of the mesh"));
            continue;
        };
        let now = time.and_then(|column| collect(row.optional_number(column), &mut diagnostics).flatten());
        let name = format!("step {}", step.map_or("1", |column| row.text(column)));
        if steps.last().is_none_or(|last| last.name != name) {
            if steps.iter().any(|known| known.name == name) {
                diagnostics.push(Diagnostic::new(row.place(), "the rows of a step together", &name));
                break;
            }
            steps.push(empty(name, now));
            lines.clear();
        }
        let earlier = lines.insert(at, row.place());
        let Some(last) = steps.last_mut() else { continue };
        if let (Some(column), Some(known), Some(_)) =
            (time, last.time, now.filter(|now| last.time != Some(*now)))
        {
            diagnostics.push(row.diagnostic(column, &format!("{known}, the time of {}", last.name)));
        }
        for (quantity, (_, columns)) in last.quantities.iter_mut().zip(&groups) {
            for (k, column) in columns.iter().enumerate() {
                let Some(value) = collect(row.number(*column), &mut diagnostics) else { continue };
                let known = &mut quantity.values[at * columns.len() + k];
                if !same_or_new(&[*known], &[value]) {
                    let first = earlier.as_deref().unwrap_or("an earlier line");
                    diagnostics
                        .push(row.diagnostic(*column, &format!("{known} of the same node in {first}")));
                }
                *known = value;
            }
        }
    }
    let AbaqusMesh { points, blocks, left_out, .. } = mesh;
    let run = Run { points, blocks, steps, left_out, ..Run::default() };
    FormatError::check(run, path, diagnostics)
}

/// Endings of components in their order.
const ORDERS: [&[&str]; 2] =
    [&["1", "2", "3", "11", "22", "33", "12", "13", "23"], &["x", "y", "z", "xy", "yz", "xz"]];
/// Endings that must all exist before letters count as components: `energy` has no component.
const AXES: [&str; 3] = ["x", "y", "z"];
/// Characters allowed between a name and the number of a component.
const BETWEEN: [char; 4] = ['-', '.', '_', ':'];

/// Columns by the name without the number or the axes of the component; quantities in the order of the table, their components
/// in the order 1, 2, 3, 11, 22, 33, 12, 13, 23 or x, y, z, xy, yz, xz.
fn groups(columns: &[usize], names: &[String]) -> Vec<(String, Vec<usize>)> {
    let lower: HashSet<String> = names.iter().map(|name| name.to_ascii_lowercase()).collect();
    let (mut groups, mut known) = (Vec::<(String, Vec<usize>)>::new(), HashMap::new());
    for at in columns {
        let name = stem(&names[*at], &lower);
        let group = *known.entry(name).or_insert(groups.len());
        if group == groups.len() {
            groups.push((name.to_owned(), Vec::new()));
        }
        groups[group].1.push(*at);
    }
    for (name, columns) in &mut groups {
        columns.sort_by_key(|at| rank(names[*at].get(name.len()..).unwrap_or_default()));
    }
    groups
}

fn stem<'a>(name: &'a str, names: &HashSet<String>) -> &'a str {
    let lower = name.to_ascii_lowercase();
    let letters = ORDERS[1].iter().rev().find_map(|ending| {
        let stem = lower.strip_suffix(ending).filter(|stem| !stem.is_empty())?;
        AXES.iter().all(|axis| names.contains(&format!("{stem}{axis}"))).then_some(stem.len())
    });
    let stem = letters.map_or_else(|| name.trim_end_matches(['1', '2', '3']), |length| &name[..length]);
    stem.trim_end_matches(BETWEEN)
}

fn rank(ending: &str) -> usize {
    let ending = ending.trim_start_matches(BETWEEN).to_ascii_lowercase();
    ORDERS.iter().find_map(|order| order.iter().position(|known| *known == ending)).unwrap_or(usize::MAX)
}
