//! Delimited text with named columns: the one reader of tables, and a writer.
//!
//! Every table is lines of cells between separators, with the names of the columns above. The project's own tables (cases, traces,
//! targets, inputs of imported states) have commas and the names in the first line: [`Table`]. What benches write has any separator,
//! decimal commas, headings somewhere above and clocks: [`Log`](crate::log::Log), whose form `layout` finds or refuses.

mod labelled;
pub(crate) mod layout;
pub(crate) mod number;

use crate::error::{Diagnostic, FormatError, collect};
use crate::file;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::fmt::{Display, Write as _};
use std::io::{self, Write};
use std::ops::Range;
use std::path::Path;

/// Order of a date with slashes whose year is last.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum DateOrder {
    /// 31/12/2024.
    #[serde(rename = "day/month/year")]
    DayFirst,
    /// 12/31/2024.
    #[serde(rename = "month/day/year")]
    MonthFirst,
}

/// Candidates of the separator, of equal ones the last; a blank stands for any number of blanks.
const SEPARATORS: [char; 4] = [' ', ',', '\t', ';'];

/// What a user says of a table that could be read in two ways: `[table]` of a mapping, `table` of a material test.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TableForm {
    /// `,`, `;`, a tab or a blank (any number of them).
    pub separator: Option<char>,
    /// `.` or `,`; the other one separates groups of thousands.
    pub decimal: Option<char>,
    /// The first column has no heading (names or numbers of the rows), so that the headings are those of the other columns.
    pub row_names: Option<bool>,
    /// Order of dates with slashes.
    pub dates: Option<DateOrder>,
}

impl TableForm {
    /// # Errors
    /// A separator that is none.
    pub fn check(&self) -> Result<(), Diagnostic> {
        if let Some(found) = self.separator.filter(|separator| !SEPARATORS.contains(separator)) {
            return Err(Diagnostic::new(
                "table.separator",
                "`,`, `;`, a tab or a blank",
                format!("`{found}`"),
            ));
        }
        match self.decimal.filter(|decimal| !['.', ','].contains(decimal)) {
            Some(found) => Err(Diagnostic::new("table.decimal", "`.` or `,`", format!("`{found}`"))),
            None => Ok(()),
        }
    }
}

/// A table in memory: the text, where its rows are, and the names of its columns. Rows are split into cells as they are asked for.
#[derive(Clone, Debug)]
pub struct Table {
    text: String,
    separator: char,
    header: Vec<String>,
    /// Number of each row's line, counted from 1, and its place in the text.
    rows: Vec<(usize, Range<usize>)>,
}

impl Table {
    /// Reads a table in the project's own form, of at most [`file::MAX_TEXT_BYTES`]: commas, the names of the columns in the first line.
    /// Blank lines are ignored, and with `comments` also those that begin with `#`. Cost: linear in the bytes.
    ///
    /// # Errors
    /// I/O error; text that is not UTF-8; more than [`file::MAX_COLUMNS`] columns; two columns of one name.
    pub fn read(path: &Path, comments: bool) -> Result<Self, FormatError> {
        let text = file::read_text(path, file::MAX_TEXT_BYTES)?;
        Self::parse(text, comments).map_err(|diagnostic| FormatError::one(path, diagnostic))
    }

    /// [`Table::read`] from memory.
    ///
    /// # Errors
    /// More than [`file::MAX_COLUMNS`] columns; two columns of one name.
    pub fn parse(text: impl Into<String>, comments: bool) -> Result<Self, Diagnostic> {
        let text = text.into();
        let mut rows = content(&text, comments)?;
        let header: Vec<String> = match rows.is_empty() {
            true => Vec::new(),
            false => cells(&text[rows.remove(0).1], ',').into_iter().map(Cow::into_owned).collect(),
        };
        let is_name = |cell: &str| !cell.is_empty() && cell.parse::<f64>().is_err();
        let is_repeated =
            |index: &usize| is_name(&header[*index]) && header[..*index].contains(&header[*index]);
        if let Some(at) = (0..header.len()).find(is_repeated) {
            let found = format!("two columns `{}`", header[at]);
            return Err(Diagnostic::new("header", "every column once", found));
        }
        Ok(Self { text, separator: ',', header, rows })
    }

    /// Reads a file without a header, of at most `limit` bytes, whose columns have these names.
    ///
    /// # Errors
    /// As [`Table::read`].
    pub fn read_without_header(path: &Path, names: &[&str], limit: u64) -> Result<Self, FormatError> {
        let text = file::read_text(path, limit)?;
        let rows = content(&text, false).map_err(|diagnostic| FormatError::one(path, diagnostic))?;
        let header = names.iter().map(|&name| name.to_owned()).collect();
        Ok(Self { text, separator: ',', header, rows })
    }

    /// Names of the columns.
    pub fn header(&self) -> &[String] {
        &self.header
    }

    /// Rows below the header.
    pub fn rows(&self) -> impl Iterator<Item = TableRow<'_>> {
        self.rows.iter().map(|(line, place)| TableRow {
            line: *line,
            header: &self.header,
            cells: cells(&self.text[place.clone()], self.separator),
        })
    }

    /// Position of the column `name`.
    ///
    /// # Errors
    /// No such column.
    pub fn column(&self, name: &str) -> Result<usize, Diagnostic> {
        let found = self.header.iter().position(|column| column == name);
        found.ok_or_else(|| Diagnostic::new("header", format!("a column `{name}`"), "none of that name"))
    }

    /// Positions of the named columns.
    ///
    /// # Errors
    /// A diagnostic per missing column.
    pub fn columns<const N: usize>(&self, names: [&str; N]) -> Result<[usize; N], Vec<Diagnostic>> {
        let mut missing = Vec::new();
        let found = names.map(|name| collect(self.column(name), &mut missing).unwrap_or_default());
        if missing.is_empty() { Ok(found) } else { Err(missing) }
    }
}

/// Numbers and places of the lines that are neither blank nor, with `comments`, begin with `#`.
fn content(text: &str, comments: bool) -> Result<Vec<(usize, Range<usize>)>, Diagnostic> {
    let is_content = |line: &str| !(line.trim().is_empty() || comments && line.trim_start().starts_with('#'));
    let mut found = Vec::new();
    for (number, place) in lines(text).filter(|(_, place)| is_content(&text[place.clone()])) {
        file::check_columns(number, 1 + text[place.clone()].matches(',').count())?;
        found.push((number, place));
    }
    Ok(found)
}

/// Numbers (from 1) and places of the lines of a text, whatever ends them: `\n`, `\r\n` or `\r`. A byte order mark is no part of the first.
fn lines(text: &str) -> impl Iterator<Item = (usize, Range<usize>)> + '_ {
    let mut begin = if text.starts_with('\u{feff}') { '\u{feff}'.len_utf8() } else { 0 };
    let mut number = 0;
    std::iter::from_fn(move || {
        let rest = text.get(begin..)?;
        let length = rest.find(['\n', '\r']);
        let end = begin + length.unwrap_or(rest.len());
        let place = begin..end;
        let skipped = if text[end..].starts_with("\r\n") { 2 } else { 1 };
        begin = if length.is_some() { end + skipped } else { usize::MAX };
        number += 1;
        Some((number, place))
    })
}

/// Cells of a line, trimmed. A quote begins a cell in which separators are text (`""` is a quote then); a quote elsewhere, or one that
/// nothing closes, is a character like others (`Extension (")`). A blank as separator stands for any number of blanks.
fn cells(line: &str, separator: char) -> Vec<Cow<'_, str>> {
    if separator == ' ' {
        return line.split_whitespace().map(|cell| cell.trim_matches('"').into()).collect();
    }
    let (mut cells, mut rest) = (Vec::new(), line);
    loop {
        let quoted =
            rest.trim_start_matches(' ').strip_prefix('"').and_then(|inner| quoted(inner, separator));
        let (cell, behind) = quoted.unwrap_or_else(|| match rest.split_once(separator) {
            Some((cell, behind)) => (cell.trim().into(), Some(behind)),
            None => (rest.trim().into(), None),
        });
        cells.push(cell);
        match behind {
            Some(behind) => rest = behind,
            None => return cells,
        }
    }
}

/// A cell that ends with a quote, without it, and what is behind the separator; `None` if no quote closes it.
fn quoted(inner: &str, separator: char) -> Option<(Cow<'_, str>, Option<&str>)> {
    let mut from = 0;
    while let Some(length) = inner[from..].find('"') {
        let (end, behind) = (from + length, &inner[from + length + 1..]);
        if behind.starts_with('"') {
            from = end + 2;
            continue;
        }
        let behind = behind.trim_start_matches(' ');
        let cell = || match inner[..end].contains('"') {
            true => inner[..end].replace("\"\"", "\"").trim().to_owned().into(),
            false => inner[..end].trim().into(),
        };
        return match behind.strip_prefix(separator) {
            Some(behind) => Some((cell(), Some(behind))),
            None => behind.is_empty().then(|| (cell(), None)),
        };
    }
    None
}

/// A row, split into its cells.
#[derive(Clone, Debug)]
pub struct TableRow<'a> {
    /// Number of its line, counted from 1.
    pub line: usize,
    header: &'a [String],
    cells: Vec<Cow<'a, str>>,
}

impl TableRow<'_> {
    /// `line 7`, counted from 1.
    pub fn place(&self) -> String {
        format!("line {}", self.line)
    }

    /// Checks that the row has as many cells as the header; with `or_fewer`, at most as many.
    ///
    /// # Errors
    /// A diagnostic with both numbers.
    pub fn check_width(&self, or_fewer: bool) -> Result<(), Diagnostic> {
        let (expected, found) = (self.header.len(), self.cells.len());
        if found == expected || or_fewer && found < expected {
            return Ok(());
        }
        let limit = if or_fewer { "at most " } else { "" };
        Err(Diagnostic::new(self.place(), format!("{limit}{expected} cells"), found))
    }

    /// Cell; empty if the row is too short.
    pub fn text(&self, column: usize) -> &str {
        self.cells.get(column).map_or("", AsRef::as_ref)
    }

    /// Error in a cell.
    pub fn diagnostic(&self, column: usize, expected: &str) -> Diagnostic {
        let name = self.header.get(column).map_or("", String::as_str);
        let place = format!("{}, column {name}", self.place());
        Diagnostic::new(place, expected, format!("`{}`", self.text(column)))
    }

    /// Number of a cell; `nan` and `inf` are numbers too, as gauges send them.
    ///
    /// # Errors
    /// Anything else.
    pub fn any_number(&self, column: usize) -> Result<f64, Diagnostic> {
        self.text(column).parse().map_err(|_| self.diagnostic(column, "a number"))
    }

    /// Finite number of a cell.
    ///
    /// # Errors
    /// Anything else.
    pub fn number(&self, column: usize) -> Result<f64, Diagnostic> {
        let number = self.text(column).parse::<f64>().ok().filter(|value| value.is_finite());
        number.ok_or_else(|| self.diagnostic(column, "a finite number"))
    }

    /// Finite number of a cell; `None` if it is empty.
    ///
    /// # Errors
    /// Anything else.
    pub fn optional_number(&self, column: usize) -> Result<Option<f64>, Diagnostic> {
        if self.text(column).is_empty() { Ok(None) } else { self.number(column).map(Some) }
    }

    /// Value of the word in a cell.
    ///
    /// # Errors
    /// A word that is not a choice.
    pub fn choice<T: Copy>(&self, column: usize, choices: &[(&str, T)]) -> Result<T, Diagnostic> {
        let found = choices.iter().find(|(word, _)| *word == self.text(column)).map(|(_, value)| *value);
        found.ok_or_else(|| {
            let words: Vec<&str> = choices.iter().map(|(word, _)| *word).collect();
            self.diagnostic(column, &format!("one of {}", words.join(", ")))
        })
    }
}

/// Writer of a comma-separated table; cells are quoted if necessary.
pub struct TableWriter<W: Write> {
    out: csv::Writer<W>,
    cell: String,
}

impl<W: Write> TableWriter<W> {
    /// Creates a writer that appends to `out`.
    pub fn new(out: W) -> Self {
        Self { out: csv::WriterBuilder::new().flexible(true).from_writer(out), cell: String::new() }
    }

    /// Adds a row.
    ///
    /// # Errors
    /// I/O error of the writer.
    pub fn row(&mut self, cells: impl IntoIterator<Item = impl Display>) -> io::Result<()> {
        for cell in cells {
            self.cell.clear();
            let _ = write!(self.cell, "{cell}"); // writing to memory cannot fail
            self.out.write_field(&self.cell)?;
        }
        Ok(self.out.write_record(None::<&[u8]>)?)
    }

    /// Flushes the buffer and returns `out`.
    ///
    /// # Errors
    /// I/O error of the writer.
    pub fn finish(self) -> io::Result<W> {
        self.out.into_inner().map_err(|error| error.into_error())
    }
}

/// Whole table as a string; with an empty header the rows alone.
pub fn to_text<T: Display>(
    header: &[&str],
    rows: impl IntoIterator<Item = impl IntoIterator<Item = T>>,
) -> String {
    let mut table = TableWriter::new(Vec::new());
    let first = if header.is_empty() { Ok(()) } else { table.row(header) };
    let written = first.and_then(|()| rows.into_iter().try_for_each(|row| table.row(row)));
    // Writing to memory cannot fail, and every cell is text.
    written
        .and_then(|()| table.finish())
        .ok()
        .and_then(|bytes| String::from_utf8(bytes).ok())
        .unwrap_or_default()
}
