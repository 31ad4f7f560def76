//! Traces: named inputs over time, and the series of a motion, which is a trace with results.

use crate::table::{Table, TableRow};
use crate::{Diagnostic, FormatError, collect};
use std::path::Path;

/// Columns of the series that a motion writes.
pub const SERIES_COLUMNS: [&str; SERIES] = [
    "t_s",
    "pressure_mpa",
    "gap_mm",
    "lowest_y_mm",
    "tip_x_mm",
    "tip_y_mm",
    "contact_force_n",
    "max_stress_mpa",
    "tip_z_mm",
];
pub const SERIES: usize = 9;

/// Position of one of [`SERIES_COLUMNS`]. In a constant, another name does not compile.
pub const fn series_column(name: &str) -> usize {
    let mut column = 0;
    while column < SERIES {
        let (known, wanted) = (SERIES_COLUMNS[column].as_bytes(), name.as_bytes());
        let mut same = 0;
        while same < known.len() && same < wanted.len() && known[same] == wanted[same] {
            same += 1;
        }
        if same == known.len() && same == wanted.len() {
            return column;
        }
        column += 1;
    }
    panic!("no column of a series")
}

/// Leading columns of a series that are inputs.
const INPUTS: usize = 3;
/// Name of the input whose empty cell is no obstacle.
const GAP: &str = "gap_mm";
/// Least time between two rows, s.
const MIN_INTERVAL_S: f64 = 1.0e-6;

/// Inputs by name over time, as a table has them, for no model in particular.
#[derive(Clone, Debug, PartialEq)]
pub struct TraceTable {
    /// Names of the inputs, in the order of the columns.
    pub names: Vec<String>,
    /// Time (s) and a value for each input; an empty gap is infinite. At least two rows.
    pub rows: Vec<(f64, Vec<f64>)>,
}

/// Value of a cell that a program is asked about.
#[derive(Clone, Copy, Debug)]
pub struct Cell<'a> {
    /// Name of the input.
    pub name: &'a str,
    /// Value; infinite for an empty gap.
    pub value: f64,
    /// Value in the first row; `None` there.
    pub first: Option<f64>,
}

impl TraceTable {
    /// Takes the inputs of a table: all columns but the time and the results of a series. `refused` returns what a cell is expected to be
    /// if it is not.
    ///
    /// # Errors
    /// All errors; never empty.
    pub fn of_table(
        table: &Table,
        refused: &dyn Fn(Cell<'_>) -> Option<&'static str>,
    ) -> Result<Self, Vec<Diagnostic>> {
        let [time] = table.columns(["t_s"])?;
        let named = table.header().iter().enumerate();
        let is_input = |name: &str| name != "t_s" && !SERIES_COLUMNS[INPUTS..].contains(&name);
        let columns: Vec<(usize, &str)> =
            named.map(|(index, name)| (index, name.as_str())).filter(|(_, name)| is_input(name)).collect();
        let (mut diagnostics, mut rows): (Vec<Diagnostic>, Vec<(f64, Vec<f64>)>) = Default::default();
        for row in table.rows() {
            let (before, first) = (rows.last().map(|(t_s, _)| *t_s), rows.first().map(|(_, values)| values));
            let read = read_row(&row, (time, &columns), before, first, refused, &mut diagnostics);
            rows.extend(read);
        }
        if rows.len() < 2 && diagnostics.is_empty() {
            diagnostics.push(Diagnostic::new("rows", "at least two instants", rows.len()));
        }
        let names = columns.iter().map(|(_, name)| (*name).to_owned()).collect();
        if diagnostics.is_empty() { Ok(Self { names, rows }) } else { Err(diagnostics) }
    }

    /// Values at a time (s), linear between the rows, those of the first and last row outside.
    pub fn at(&self, t_s: f64) -> Vec<f64> {
        let ([from, to], part) = around(&self.rows, |(row_s, _)| *row_s, t_s);
        from.1.iter().zip(&to.1).map(|(a, b)| if a == b { *a } else { a + part * (b - a) }).collect()
    }

    /// Position of an input.
    pub fn position(&self, name: &str) -> Option<usize> {
        self.names.iter().position(|known| known == name)
    }
}

/// Reads the series of a motion: the values of [`SERIES_COLUMNS`] in each row, NaN for an empty cell.
///
/// # Errors
/// I/O error; all missing columns and cells that are no numbers.
pub fn read_series(path: &Path) -> Result<Vec<Vec<f64>>, FormatError> {
    let table = Table::read(path, true)?;
    let wrong = |diagnostics| FormatError::Content { path: path.into(), diagnostics };
    let columns = table.columns(SERIES_COLUMNS).map_err(wrong)?;
    let mut diagnostics = Vec::new();
    let mut row = |row: TableRow<'_>| {
        let mut cell = |column| collect(row.optional_number(column), &mut diagnostics).flatten();
        columns.iter().map(|column| cell(*column).unwrap_or(f64::NAN)).collect()
    };
    let rows = table.rows().map(&mut row).collect();
    FormatError::check(rows, path, diagnostics)
}

/// The rows before and after a time (s), and its part of the way between them; the first or last row twice outside.
///
/// # Panics
/// Without rows.
pub fn around<Row>(rows: &[Row], time_s: impl Fn(&Row) -> f64, t_s: f64) -> ([&Row; 2], f64) {
    let after = rows.partition_point(|row| time_s(row) <= t_s);
    if after == 0 || after == rows.len() {
        let end = &rows[after.saturating_sub(1)];
        return ([end; 2], 0.0);
    }
    let [from, to] = [&rows[after - 1], &rows[after]];
    ([from, to], (t_s - time_s(from)) / (time_s(to) - time_s(from)))
}

fn read_row(
    row: &TableRow<'_>,
    (time, columns): (usize, &[(usize, &str)]),
    before: Option<f64>,
    first: Option<&Vec<f64>>,
    refused: &dyn Fn(Cell<'_>) -> Option<&'static str>,
    diagnostics: &mut Vec<Diagnostic>,
) -> Option<(f64, Vec<f64>)> {
    let count = diagnostics.len();
    collect(row.check_width(false), diagnostics)?;
    let t_s = collect(row.number(time), diagnostics).unwrap_or(f64::NAN);
    if before.is_some_and(|before| t_s - before < MIN_INTERVAL_S) {
        diagnostics.push(row.diagnostic(time, "a time at least 1e-6 s after the row before"));
    }
    let mut values = Vec::with_capacity(columns.len());
    for (index, (column, name)) in columns.iter().enumerate() {
        let is_open = *name == GAP && row.text(*column).is_empty();
        let number = if is_open { Ok(f64::INFINITY) } else { row.number(*column) };
        let value = collect(number, diagnostics).unwrap_or(f64::NAN);
        let cell = Cell { name, value, first: first.map(|first| first[index]) };
        if let Some(expected) = refused(cell).filter(|_| !value.is_nan()) {
            diagnostics.push(row.diagnostic(*column, expected));
        }
        values.push(value);
    }
    (diagnostics.len() == count).then_some((t_s, values))
}
