//! Tables of benches as numbers by column, and their mapping to quantities.

use crate::error::{Diagnostic, FormatError};
use crate::file;
use crate::table::{TableForm, layout, number};
pub use description::{TableColumn, TableDescription, describe};
pub use mapping::Channel;
pub use mapping::Column;
pub use mapping::Frame;
pub use mapping::Further;
pub use mapping::Mapping;
pub use mapping::TimeColumn;
use std::borrow::Cow;
use std::path::Path;

mod clock;
mod description;
mod mapping;

/// Largest log that is read: 512 MiB.
const MAX_LOG_BYTES: u64 = 1 << 29;

/// A table of a bench, by column: any separator, headings above or none, comments, decimal commas, any end of line, clocks.
#[derive(Clone, Debug, PartialEq)]
pub struct Log {
    /// Heading of each column; empty without one.
    pub headings: Vec<String>,
    /// Values by column; NaN if missing or not a number.
    pub columns: Vec<Vec<f64>>,
    /// Why a column has no values although it has numbers: they can be read in two ways.
    pub doubts: Vec<Option<String>>,
    /// Line of each row, counted from 1.
    pub lines: Vec<usize>,
    /// Separator; a blank stands for any number of blanks.
    pub separator: char,
    /// Lines below the first row that are not rows.
    pub damaged: Vec<Diagnostic>,
    /// Numbers by name above the table: `Width (mm);6`, `width_mm = 6`.
    pub parameters: Vec<(String, f64)>,
    /// What was read by a convention of the table, such as groups of thousands.
    pub remarks: Vec<String>,
}

impl Log {
    /// Reads a log; `form` says what the table leaves open. Cost: linear in the bytes.
    ///
    /// # Errors
    /// I/O error; no line with a number; headings that fit two sets of columns.
    pub fn read(path: &Path, form: &TableForm) -> Result<Self, FormatError> {
        let bytes = file::read_bytes(path, MAX_LOG_BYTES)?;
        let text = decoded(&bytes).map_err(|found| FormatError::one(path, found))?;
        Self::parse(text, form).map_err(|found| FormatError::one(path, found))
    }

    /// [`Log::read`] from memory.
    ///
    /// # Errors
    /// As [`Log::read`].
    pub fn parse(text: impl Into<String>, form: &TableForm) -> Result<Self, Diagnostic> {
        form.check()?;
        let found = layout::found(text.into(), form)?;
        let numbers = number::numbers(&found.table, form, found.blanks);
        Ok(Self {
            headings: found.table.header().to_vec(),
            columns: numbers.columns,
            doubts: numbers.doubts,
            lines: found.table.rows().map(|row| row.line).collect(),
            separator: found.separator,
            damaged: found.damaged,
            parameters: found.parameters,
            remarks: numbers.remarks,
        })
    }

    /// A log of arrays with their names, all of one length, as a program has them.
    #[must_use]
    pub fn of_columns(columns: Vec<(String, Vec<f64>)>) -> Self {
        let (headings, columns): (Vec<_>, Vec<_>) = columns.into_iter().unzip();
        Self {
            doubts: vec![None; columns.len()],
            lines: (1..=columns.first().map_or(0, Vec::len)).collect(),
            headings,
            columns,
            separator: ',',
            damaged: Vec::new(),
            parameters: Vec::new(),
            remarks: Vec::new(),
        }
    }

    #[must_use]
    pub fn rows(&self) -> usize {
        self.lines.len()
    }
}

/// Text of UTF-8, of UTF-16 with its mark, or of Latin-1 (what spreadsheets and oscilloscopes write).
fn decoded(bytes: &[u8]) -> Result<Cow<'_, str>, Diagnostic> {
    let wide = |from: fn([u8; 2]) -> u16| -> Cow<'_, str> {
        let units: Vec<u16> = bytes[2..].chunks_exact(2).map(|pair| from([pair[0], pair[1]])).collect();
        String::from_utf16_lossy(&units).into()
    };
    let text = match bytes {
        [0xff, 0xfe, ..] => wide(u16::from_le_bytes),
        [0xfe, 0xff, ..] => wide(u16::from_be_bytes),
        _ if let Some(found) = file::other_than_text(bytes) => {
            return Err(Diagnostic::new("content", "a table as text", found));
        }
        _ => match std::str::from_utf8(bytes) {
            Ok(text) => text.into(),
            Err(_) => bytes.iter().map(|byte| char::from(*byte)).collect::<String>().into(),
        },
    };
    Ok(text)
}

// ---- a log as quantities ----

/// One quantity over the rows.
#[derive(Clone, Debug, PartialEq)]
pub struct LogColumn {
    /// Name with its unit.
    pub name: String,
    /// Values; NaN if missing.
    pub values: Vec<f64>,
}

/// A log as quantities.
#[derive(Clone, Debug, PartialEq)]
pub struct Recording {
    /// Time of the first row, s; from the clock's zero.
    pub start_s: f64,
    /// Time of the rows from the first one, s.
    pub time_s: Vec<f64>,
    pub inputs: Vec<LogColumn>,
    pub outputs: Vec<LogColumn>,
    /// Remarks on times, missing values, flat tops, negative pressures.
    pub remarks: Vec<String>,
}

impl Recording {
    /// Every `step`-th row, at least each.
    #[must_use]
    pub fn every(&self, step: usize) -> Self {
        let thin = |values: &[f64]| values.iter().copied().step_by(step.max(1)).collect();
        let all = |series: &[LogColumn]| {
            series.iter().map(|s| LogColumn { name: s.name.clone(), values: thin(&s.values) }).collect()
        };
        Self {
            start_s: self.start_s,
            time_s: thin(&self.time_s),
            inputs: all(&self.inputs),
            outputs: all(&self.outputs),
            remarks: self.remarks.clone(),
        }
    }

    /// The recording as a trace: comma-separated, columns by name.
    #[must_use]
    pub fn csv(&self) -> String {
        let all = || self.inputs.iter().chain(&self.outputs);
        let mut text: String = "t_s".into();
        all().for_each(|series| text += &format!(",{}", series.name));
        for (row, t_s) in self.time_s.iter().enumerate() {
            text += &format!("\n{t_s}");
            all().for_each(|series| text += &format!(",{}", series.values[row]));
        }
        text + "\n"
    }
}
