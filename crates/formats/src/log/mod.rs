//! Tables of benches as numbers by column, and their mapping to quantities.

mod clock;
mod mapping;
mod recording;

pub use mapping::{Channel, Column, Frame, Further, Mapping, TimeColumn};
pub use recording::{Recording, Series};

use crate::error::{Diagnostic, FormatError};
use crate::file;
use crate::table::{TableForm, layout, number};
use std::borrow::Cow;
use std::path::Path;

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

    /// Number of rows.
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
