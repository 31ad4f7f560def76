//! Numbers in rows and columns, without a header.

use crate::error::{Diagnostic, FormatError};
use crate::file;
use std::path::Path;

/// Number of errors after which reading stops.
const MAX_DIAGNOSTICS: usize = 50;

/// Table of finite numbers.
pub(crate) struct Matrix {
    pub(crate) rows: usize,
    columns: usize,
    values: Vec<f32>,
}

impl Matrix {
    /// Reads a table with `columns` columns.
    pub(crate) fn read(path: &Path, columns: usize) -> Result<Self, FormatError> {
        let text = file::read_text(path, file::MAX_DATA_BYTES)?;
        let (mut values, mut diagnostics, mut rows) = (Vec::new(), Vec::new(), 0);
        for (line, row) in text.lines().enumerate().filter(|(_, row)| !row.trim().is_empty()) {
            let before = values.len();
            for (column, cell) in row.split(',').enumerate() {
                match cell.trim().parse::<f32>() {
                    Ok(value) if value.is_finite() => values.push(value),
                    _ => {
                        let place = format!("line {}, column {}", line + 1, column + 1);
                        diagnostics.push(Diagnostic::new(
                            place,
                            "a finite number",
                            format!("`{}`", shorten(cell)),
                        ));
                        values.push(0.0); // counted, so that the number of columns is not reported as well
                    }
                }
            }
            if values.len() - before != columns {
                let expected = format!("{columns} columns, one a case in the parameter list");
                diagnostics.push(Diagnostic::new(
                    format!("line {}", line + 1),
                    expected,
                    values.len() - before,
                ));
            }
            if diagnostics.len() >= MAX_DIAGNOSTICS {
                break;
            }
            rows += 1;
        }
        if rows == 0 && diagnostics.is_empty() {
            diagnostics.push(Diagnostic::new("rows", "at least one", "none"));
        }
        FormatError::check(Self { rows, columns, values }, path, diagnostics)
    }

    /// Value at a row and column.
    pub(crate) fn at(&self, row: usize, column: usize) -> f32 {
        self.values[row * self.columns + column]
    }

    /// Values of a column.
    pub(crate) fn column(&self, column: usize) -> impl Iterator<Item = f32> + '_ {
        self.values.iter().skip(column).step_by(self.columns).copied()
    }
}

fn shorten(cell: &str) -> String {
    cell.trim().chars().take(24).collect()
}
