//! Comma-separated tables with a header: reading with diagnostics by line and column, and writing.

use crate::error::{Diagnostic, FormatError, collect};
use crate::file;
use std::fmt::{Display, Write as _};
use std::io::{self, Write};
use std::path::Path;

/// Table in memory; cells are trimmed.
#[derive(Clone, Debug)]
pub struct Table {
    header: Vec<String>,
    rows: Vec<(usize, csv::StringRecord)>,
}

impl Table {
    /// Reads a table of at most [`file::MAX_TEXT_BYTES`]. Blank lines are ignored, and with `comments` also those
    /// that begin with `#`. Cost: linear in the bytes.
    ///
    /// # Errors
    /// I/O error; content that is not comma-separated.
    pub fn read(path: &Path, comments: bool) -> Result<Self, FormatError> {
        let text = file::read_text(path, file::MAX_TEXT_BYTES)?;
        Self::parse(&text, comments).map_err(|diagnostic| FormatError::one(path, diagnostic))
    }

    /// [`Table::read`] from memory.
    ///
    /// # Errors
    /// Content that is not comma-separated; two columns of one name.
    pub fn parse(text: &str, comments: bool) -> Result<Self, Diagnostic> {
        let kept = |line: &&str| {
            let is_comment = comments && line.starts_with('#');
            !line.trim().is_empty() && !is_comment
        };
        let (numbers, lines): (Vec<usize>, Vec<&str>) =
            text.lines().enumerate().filter(|(_, line)| kept(line)).map(|(n, line)| (n + 1, line)).unzip();
        let text = lines.join("\n");
        let mut reader = csv::ReaderBuilder::new()
            .trim(csv::Trim::All)
            .flexible(true)
            .has_headers(false)
            .from_reader(text.as_bytes());
        let mut rows = Vec::new();
        for (record, line) in reader.records().zip(numbers.into_iter().chain(std::iter::repeat(0))) {
            let record = record.map_err(|error| Diagnostic::new("content", "comma-separated text", error))?;
            file::check_columns(line, record.len())?;
            rows.push((line, record));
        }
        let header = if rows.is_empty() { csv::StringRecord::new() } else { rows.remove(0).1 };
        let header: Vec<String> = header.iter().map(str::to_owned).collect();
        let again = |at: &usize| !header[*at].is_empty() && header[..*at].contains(&header[*at]);
        if let Some(at) = (0..header.len()).find(again) {
            return Err(Diagnostic::new(
                "header",
                "every column once",
                format!("two columns `{}`", header[at]),
            ));
        }
        Ok(Self { header, rows })
    }

    /// Table with the given header and the first line as a row, for files without a header.
    #[must_use]
    pub fn with_header(mut self, header: &[&str]) -> Self {
        let first = std::mem::replace(&mut self.header, header.iter().map(|&name| name.to_owned()).collect());
        self.rows.insert(0, (1, first.into()));
        self
    }

    /// Names of the columns.
    pub fn header(&self) -> &[String] {
        &self.header
    }

    /// Rows below the header.
    pub fn rows(&self) -> impl Iterator<Item = Row<'_>> {
        self.rows.iter().map(|(line, record)| Row { line: *line, header: &self.header, record })
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

/// Row of a [`Table`].
#[derive(Clone, Copy, Debug)]
pub struct Row<'a> {
    line: usize,
    header: &'a [String],
    record: &'a csv::StringRecord,
}

impl<'a> Row<'a> {
    /// `line 7`, counted from 1.
    pub fn place(&self) -> String {
        format!("line {}", self.line)
    }

    /// Checks that the row has as many cells as the header; with `or_fewer`, at most as many.
    ///
    /// # Errors
    /// A diagnostic with both numbers.
    pub fn check_width(&self, or_fewer: bool) -> Result<(), Diagnostic> {
        let (expected, found) = (self.header.len(), self.record.len());
        if found == expected || or_fewer && found < expected {
            return Ok(());
        }
        let limit = if or_fewer { "at most " } else { "" };
        Err(Diagnostic::new(self.place(), format!("{limit}{expected} cells"), found))
    }

    /// Cell; empty if the row is too short.
    pub fn text(&self, column: usize) -> &'a str {
        self.record.get(column).unwrap_or("")
    }

    /// Error in a cell.
    pub fn diagnostic(&self, column: usize, expected: &str) -> Diagnostic {
        let name = self.header.get(column).map_or("", String::as_str);
        let place = format!("{}, column {name}", self.place());
        Diagnostic::new(place, expected, format!("`{}`", self.text(column)))
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
