//! Grouping of a table's columns into quantities.

use std::collections::{HashMap, HashSet};

/// Endings of components in their order.
const ORDERS: [&[&str]; 2] =
    [&["1", "2", "3", "11", "22", "33", "12", "13", "23"], &["x", "y", "z", "xy", "yz", "xz"]];
/// Endings that must all exist before letters count as components: `energy` has no component.
const AXES: [&str; 3] = ["x", "y", "z"];
/// Characters allowed between a name and the number of a component.
const BETWEEN: [char; 4] = ['-', '.', '_', ':'];

/// Columns by the name without the number or the axes of the component; quantities in the order of the table, their components
/// in the order 1, 2, 3, 11, 22, 33, 12, 13, 23 or x, y, z, xy, yz, xz.
pub(super) fn groups(columns: &[usize], names: &[String]) -> Vec<(String, Vec<usize>)> {
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
