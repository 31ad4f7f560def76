//! Parameter list: one row per case, in the order of the snapshots' columns.

use crate::database::cases::SPLITS;
use crate::error::{Diagnostic, FormatError, collect};
use crate::table::{Row, Table};
use rom::snapshots::{Case, RegimeKind, Split};
use std::path::Path;

/// Columns by name; a list without a header has the first three in this order.
const COLUMNS: [&str; 4] = ["pressure_mpa", "gap_mm", "contact_force_n", "split"];

/// Reads the list; cases are named by their number from `first` on.
pub(crate) fn read(path: &Path, regime: RegimeKind, first: usize) -> Result<Vec<Case>, FormatError> {
    let mut table = Table::read(path, false)?;
    if table.header().first().is_some_and(|cell| cell.parse::<f64>().is_ok()) {
        table = table.with_header(&COLUMNS[..3]);
    }
    let mut diagnostics = Vec::new();
    for name in table.header().iter().filter(|name| !COLUMNS.contains(&name.as_str())) {
        diagnostics.push(Diagnostic::new("header", format!("columns of {COLUMNS:?}"), format!("`{name}`")));
    }
    let needed = if regime == RegimeKind::Contact { 3 } else { 1 };
    for name in &COLUMNS[..needed] {
        collect(table.column(name), &mut diagnostics);
    }
    let mut cases = Vec::new();
    // A wrong header makes every row an error.
    if diagnostics.is_empty() {
        let columns = COLUMNS.map(|name| table.column(name).ok());
        for row in table.rows() {
            cases.extend(case(&row, &columns, regime, first + cases.len(), &mut diagnostics));
        }
    }
    if cases.is_empty() && diagnostics.is_empty() {
        diagnostics.push(Diagnostic::new("rows", "at least one case", "none"));
    }
    FormatError::check(cases, path, diagnostics)
}

fn case(
    row: &Row<'_>,
    [pressure, gap, force, split]: &[Option<usize>; 4],
    regime: RegimeKind,
    number: usize,
    diagnostics: &mut Vec<Diagnostic>,
) -> Option<Case> {
    collect(row.check_width(true), diagnostics)?;
    let split = split.filter(|column| !row.text(*column).is_empty());
    let split = split.map_or(Ok(Split::Train), |column| row.choice(column, &SPLITS));
    let contact = regime == RegimeKind::Contact;
    let mut value = |column: &Option<usize>| collect(row.number((*column)?), diagnostics);
    let pressure_mpa = value(pressure);
    let gap_mm = if contact { value(gap).map(Some) } else { Some(None) };
    let contact_force_n = if contact { value(force) } else { Some(0.0) };
    Some(Case {
        name: number.to_string(),
        regime,
        split: collect(split, diagnostics)?,
        pressure_mpa: pressure_mpa?,
        gap_mm: gap_mm?,
        contact_force_n: contact_force_n?,
        parameters: Vec::new(),
    })
}
