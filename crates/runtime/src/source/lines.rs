//! Lines of text: numbers between `;`, tabs or `, `, or where there is none of these between blanks; or a JSON object.

use serde_json::{Map, Value};

/// Longest accepted line; what is longer is reported once and skipped to its end.
pub const MAX_LINE_BYTES: usize = 2048;

/// Why a line is no reading.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum LineError {
    /// Longer than [`MAX_LINE_BYTES`].
    #[error("a line has more than {MAX_LINE_BYTES} bytes")]
    TooLong,
    #[error("a line is not UTF-8")]
    NotText,
    /// A cell is not a number.
    #[error("expected a number, found `{found}`")]
    NotANumber { found: String },
    /// A cell that the scene names is empty or missing.
    #[error("cell {cell} is empty or missing, the line has {found}")]
    NoCell { cell: usize, found: usize },
    /// None of the values that the scene names.
    #[error("the line has none of the values that the scene names")]
    NoValue,
    /// A comma that may be a decimal comma.
    #[error(
        "`{found}`: a comma between digits may be a decimal comma; expected a decimal point, and `;` or `, ` between numbers \
         (or `comma_separates = true` of the sensor)"
    )]
    Comma { found: String },
    /// A JSON line without what is needed.
    #[error("expected JSON such as {{\"pressure\": 0.03, \"gap\": 40}}: {cause}")]
    Json { cause: String },
}

/// Cells of a line.
#[derive(Debug, Clone, PartialEq)]
pub enum Cells {
    /// Numbers between separators; `None` where there is nothing. What is no number is an error for who needs it: a device may send
    /// its name, a clock or a status as well.
    Numbers(Vec<Result<Option<f64>, LineError>>),
    Json(Map<String, Value>),
}

/// Takes one line without its end apart. `None` for empty lines and comments (`#`).
pub fn parse_cells(line: &[u8], comma_separates: bool) -> Result<Option<Cells>, LineError> {
    let Some(text) = text_of(line)? else { return Ok(None) };
    if text.trim_start().starts_with('{') {
        let object = serde_json::from_str(text);
        return object.map(|object| Some(Cells::Json(object))).map_err(json_error);
    }
    if !comma_separates && has_doubtful_comma(text) {
        return Err(LineError::Comma { found: text.chars().take(40).collect() });
    }
    let number = |cell: &str| match cell.trim() {
        "" => Ok(None),
        cell => cell.parse().map(Some).map_err(|_| not_a_number(cell)),
    };
    const SEPARATORS: [char; 3] = [',', ';', '\t'];
    let cells = match text.contains(SEPARATORS) {
        true => text.split(SEPARATORS).map(number).collect(),
        false => text.split_whitespace().map(number).collect(),
    };
    Ok(Some(Cells::Numbers(cells)))
}

fn not_a_number(cell: &str) -> LineError {
    LineError::NotANumber { found: cell.chars().take(40).collect() }
}

fn json_error(error: serde_json::Error) -> LineError {
    LineError::Json { cause: error.to_string() }
}

/// The text of a line; `None` for empty lines and comments.
fn text_of(line: &[u8]) -> Result<Option<&str>, LineError> {
    if line.len() > MAX_LINE_BYTES {
        return Err(LineError::TooLong);
    }
    // A tab at either end is a separator beside an empty cell.
    let text = std::str::from_utf8(line).map_err(|_| LineError::NotText)?.trim_matches([' ', '\r', '\0']);
    Ok((!text.trim().is_empty() && !text.trim_start().starts_with('#')).then_some(text))
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
}

impl LineBuffer {
    /// Takes bytes as they come and calls `each` with every finished line, without its end, and at once with the beginning of
    /// one that is too long.
    pub fn split(&mut self, bytes: &[u8], mut each: impl FnMut(&[u8])) {
        for byte in bytes {
            match byte {
                b'\n' | b'\r' => {
                    if (1..=MAX_LINE_BYTES).contains(&self.line.len()) {
                        each(&self.line);
                    }
                    self.line.clear();
                }
                // One byte too many is kept: it makes the line an error.
                byte if self.line.len() <= MAX_LINE_BYTES => {
                    self.line.push(*byte);
                    if self.line.len() > MAX_LINE_BYTES {
                        each(&self.line);
                    }
                }
                _ => {}
            }
        }
    }
}

#[cfg(test)]
#[path = "../../tests/unit/source_lines.rs"]
mod tests;
