//! The line protocol: one reading a line, `pressure`, `pressure; gap`, `pressure; gap; force`, or a JSON object.

use serde::Deserialize;

/// Longest accepted line; what is longer is skipped to its end.
pub const MAX_LINE_BYTES: usize = 512;

/// Why a line is no reading.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum LineError {
    /// Longer than [`MAX_LINE_BYTES`].
    #[error("a line has more than {MAX_LINE_BYTES} bytes")]
    TooLong,
    /// Not text.
    #[error("a line is not UTF-8")]
    NotText,
    /// A cell that is no number.
    #[error("expected a number, found `{found}`")]
    NotANumber {
        /// The cell.
        found: String,
    },
    /// More cells than there are quantities.
    #[error("expected 1 to 3 numbers (pressure, gap, force), found {found}")]
    TooMany {
        /// How many.
        found: usize,
    },
    /// A comma that may be a decimal comma.
    #[error(
        "`{found}`: a comma between digits may be a decimal comma; expected a decimal point, and `;` or `, ` between numbers \
         (or `comma_separates = true` in the scene's source)"
    )]
    Comma {
        /// The line.
        found: String,
    },
    /// A JSON line without what is needed.
    #[error("expected JSON such as {{\"pressure\": 0.03, \"gap\": 40}}: {cause}")]
    Json {
        /// The parser's message.
        cause: String,
    },
}

#[derive(Deserialize)]
struct JsonLine {
    #[serde(alias = "pressure_mpa")]
    pressure: f64,
    #[serde(alias = "gap_mm", default = "unknown")]
    gap: f64,
    #[serde(alias = "measured_force_n", default = "unknown")]
    force: f64,
}

fn unknown() -> f64 {
    f64::NAN
}

/// Parses one line without its end into pressure, gap and force in the units of the line, NaN for what it does not
/// contain. `None` for empty lines and comments (`#`). `comma_separates`: a comma between digits is never a decimal comma.
///
/// # Errors
/// [`LineError`].
pub fn parse_line(line: &[u8], comma_separates: bool) -> Result<Option<[f64; 3]>, LineError> {
    if line.len() > MAX_LINE_BYTES {
        return Err(LineError::TooLong);
    }
    let text = std::str::from_utf8(line).map_err(|_| LineError::NotText)?.trim();
    if text.is_empty() || text.starts_with('#') {
        return Ok(None);
    }
    if text.starts_with('{') {
        let line: JsonLine =
            serde_json::from_str(text).map_err(|error| LineError::Json { cause: error.to_string() })?;
        return Ok(Some([line.pressure, line.gap, line.force]));
    }
    if !comma_separates && has_doubtful_comma(text) {
        return Err(LineError::Comma { found: text.chars().take(40).collect() });
    }
    let mut numbers = [f64::NAN; 3];
    let cells: Vec<&str> = text.split([',', ';', '\t']).collect();
    if cells.len() > numbers.len() {
        return Err(LineError::TooMany { found: cells.len() });
    }
    for (number, cell) in numbers.iter_mut().zip(&cells) {
        let cell = cell.trim();
        *number =
            cell.parse().map_err(|_| LineError::NotANumber { found: cell.chars().take(40).collect() })?;
    }
    Ok(Some(numbers))
}

/// Whether a comma between two digits may be a decimal comma: nothing else in the line is a decimal point, or something else
/// separates its numbers.
fn has_doubtful_comma(text: &str) -> bool {
    let mut three = text.as_bytes().windows(3);
    let is_tight =
        three.any(|bytes| matches!(bytes, [a, b',', b] if a.is_ascii_digit() && b.is_ascii_digit()));
    is_tight && (!text.contains('.') || text.contains([';', '\t']) || text.contains(", "))
}

/// Cuts a stream of bytes into lines without ever keeping more than [`MAX_LINE_BYTES`] + 1 of them.
#[derive(Debug, Default)]
pub struct LineBuffer {
    line: Vec<u8>,
    comma_separates: bool,
}

impl LineBuffer {
    /// An empty buffer; `comma_separates`: a comma between digits is never a decimal comma.
    pub fn new(comma_separates: bool) -> Self {
        Self { line: Vec::new(), comma_separates }
    }

    /// Takes bytes as they come and calls `each` with every finished line.
    pub fn push(&mut self, bytes: &[u8], mut each: impl FnMut(Result<Option<[f64; 3]>, LineError>)) {
        for byte in bytes {
            match byte {
                b'\n' | b'\r' => {
                    if !self.line.is_empty() {
                        each(parse_line(&self.line, self.comma_separates));
                    }
                    self.line.clear();
                }
                // One byte too many is kept: it makes the line an error when its end comes.
                byte if self.line.len() <= MAX_LINE_BYTES => self.line.push(*byte),
                _ => {}
            }
        }
    }
}

#[cfg(test)]
#[path = "../../../tests/unit/source_sensor_lines.rs"]
mod tests;
