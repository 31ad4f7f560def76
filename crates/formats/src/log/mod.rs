//! Tables as benches write them: any separator, headings above or none, comments, decimal comma, any end of line, clocks.

mod cell;
mod clock;
mod labelled;
mod mapping;
mod recording;
pub mod unit;

pub use mapping::{Channel, Column, Frame, Further, Mapping, TimeColumn};
pub use recording::{Recording, Series};

use cell::{is_content, number};

use unit::Quantity;

use crate::error::{Diagnostic, FormatError};
use crate::file;
use std::borrow::Cow;
use std::path::Path;

/// Largest log that is read: 512 MiB.
const MAX_LOG_BYTES: u64 = 1 << 29;
/// Most lines of headings: motion capture has body, marker, number, quantity and axis.
const MAX_HEADINGS: usize = 6;
/// Fewest headings of a further line.
const MIN_NAMED: usize = 2;
/// Candidates of the separator, of equal ones the last; a blank stands for any number of blanks.
const SEPARATORS: [char; 4] = [' ', ',', '\t', ';'];

/// Columns of a log, by position.
#[derive(Clone, Debug, PartialEq)]
pub struct Log {
    /// Heading of each column; empty without one.
    pub headings: Vec<String>,
    /// Values by column; NaN if missing or not a number.
    pub columns: Vec<Vec<f64>>,
    /// Line of each row, counted from 1.
    pub lines: Vec<usize>,
    /// Separator; a blank stands for any number of blanks.
    pub separator: char,
    /// Lines below the first row that are not rows.
    pub damaged: Vec<Diagnostic>,
    /// Numbers by name above the table: `Width (mm);6`, `width_mm = 6`.
    pub parameters: Vec<(String, f64)>,
}

impl Log {
    /// Reads a log. Cost: linear in the bytes.
    ///
    /// # Errors
    /// I/O error; no line with a number.
    pub fn read(path: &Path) -> Result<Self, FormatError> {
        let bytes = file::read_bytes(path, MAX_LOG_BYTES)?;
        let text = decoded(&bytes).map_err(|found| FormatError::one(path, found))?;
        Self::parse(&text).map_err(|found| FormatError::one(path, found))
    }

    /// [`Log::read`] from memory.
    ///
    /// # Errors
    /// No line with a number.
    pub fn parse(text: &str) -> Result<Self, Diagnostic> {
        let text = text.trim_start_matches('\u{feff}').replace("\r\n", "\n").replace('\r', "\n");
        let lines: Vec<(usize, &str)> =
            text.split('\n').enumerate().map(|(at, line)| (at + 1, line.trim())).collect();
        for (at, line) in &lines {
            for separator in SEPARATORS {
                file::check_columns(*at, line.matches(separator).count())?;
            }
        }
        let labelled = labelled::rows(&lines);
        let lines = match &labelled {
            Some(labelled) => labelled.lines.iter().map(|(at, line)| (*at, line.as_str())).collect(),
            None => lines,
        };
        let best = SEPARATORS.into_iter().filter_map(|separator| Layout::of(&lines, separator));
        let layout = best
            .max_by_key(|layout| layout.score)
            .ok_or_else(|| Diagnostic::new("content", "lines of numbers in columns", "none"))?;
        let names = labelled.as_ref().map(|labelled| &labelled.labels);
        let names = names.filter(|l| l.len() == layout.width && l.iter().all(|label| !label.is_empty()));
        let mut log = Self {
            headings: names.cloned().unwrap_or_else(|| layout.headings(&lines)),
            columns: vec![Vec::new(); layout.width],
            lines: Vec::new(),
            separator: layout.separator,
            damaged: Vec::new(),
            parameters: layout.parameters(&lines),
        };
        for (line, text) in lines[..layout.first].iter().filter(|(_, text)| is_content(text)) {
            if layout.is_row(text) {
                let expected = "a row below the headings";
                log.damaged.push(Diagnostic::new(format!("line {line}"), expected, "one among parameters"));
            }
        }
        for (line, text) in lines.iter().skip(layout.first).filter(|(_, text)| is_content(text)) {
            let cells = cells(text, layout.separator);
            if cells.len() == layout.width && is_row(&cells, layout.decimal_comma) {
                log.lines.push(*line);
                for (column, cell) in log.columns.iter_mut().zip(&cells) {
                    column.push(number(cell, layout.decimal_comma).unwrap_or(f64::NAN));
                }
            } else {
                let found = text.chars().take(40).collect::<String>();
                let expected = format!("{} cells with numbers", layout.width);
                let found = format!("{} cells, `{found}`", cells.len());
                log.damaged.push(Diagnostic::new(format!("line {line}"), expected, found));
            }
        }
        Ok(log)
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

/// Cells of a line, without quotes. A separator between quotes is part of the cell.
fn cells(line: &str, separator: char) -> Vec<String> {
    if separator == ' ' {
        return line.split_whitespace().map(|cell| cell.trim_matches('"').to_owned()).collect();
    }
    let (mut cells, mut is_quoted) = (vec![String::new()], false);
    for c in line.chars() {
        match c {
            '"' => is_quoted = !is_quoted,
            c if c == separator && !is_quoted => cells.push(String::new()),
            c => cells.last_mut().into_iter().for_each(|cell| cell.push(c)),
        }
    }
    cells.iter().map(|cell| cell.trim().to_owned()).collect()
}

/// True if at least half of the cells that are not empty are numbers; text columns (`valve open`) stay in the table.
fn is_row(cells: &[String], decimal_comma: bool) -> bool {
    let full: Vec<&String> = cells.iter().filter(|cell| !cell.is_empty()).collect();
    let numbers = full.iter().filter(|cell| number(cell, decimal_comma).is_some_and(|v| !v.is_nan())).count();
    let missing = full.iter().filter(|cell| number(cell, decimal_comma).is_some_and(f64::is_nan)).count();
    !full.is_empty() && 2 * numbers > full.len() - missing && (numbers > 0 || missing == full.len())
}

/// True if a comma within a cell is a decimal one. Between commas a cell that contains one was quoted: it is then decimal if no cell has a
/// decimal point and one of them is no group of thousands (`12,5`, `0,125`).
fn has_decimal_commas(lines: &[(usize, &str)], separator: char) -> bool {
    if separator != ',' {
        return true;
    }
    let mut is_decimal = false;
    for (_, line) in lines.iter().filter(|(_, line)| line.contains('"')) {
        for cell in cells(line, separator) {
            let Some((whole, part)) = cell.split_once(',') else {
                if cell.contains('.') && cell.parse::<f64>().is_ok() {
                    return false;
                }
                continue;
            };
            let digits = whole.trim_start_matches(['-', '+']);
            let is_number = |text: &str| !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
            let is_group = part.len() == 3 && digits.len() <= 3 && digits != "0";
            is_decimal |= is_number(digits) && is_number(part) && !is_group;
        }
    }
    is_decimal
}

/// A separator with the width of most rows.
struct Layout {
    separator: char,
    decimal_comma: bool,
    width: usize,
    /// Numbers in rows of this width, minus twice the other cells: a decimal comma taken for a separator leaves such cells.
    score: i64,
    /// Index of the first row.
    first: usize,
}

impl Layout {
    fn of(lines: &[(usize, &str)], separator: char) -> Option<Self> {
        let decimal_comma = has_decimal_commas(lines, separator);
        // Width, rows, score.
        let mut widths: Vec<(usize, usize, i64)> = Vec::new();
        for (_, line) in lines.iter().filter(|(_, line)| is_content(line)) {
            let cells = cells(line, separator);
            if !is_row(&cells, decimal_comma) {
                continue;
            }
            let others = cells.iter().filter(|cell| number(cell, decimal_comma).is_none()).count();
            let score = cells.len() as i64 - 3 * others as i64;
            match widths.iter_mut().find(|(width, ..)| *width == cells.len()) {
                Some((_, rows, sum)) => (*rows, *sum) = (*rows + 1, *sum + score),
                None => widths.push((cells.len(), 1, score)),
            }
        }
        let (width, _, score) = widths.into_iter().max_by_key(|(_, rows, _)| *rows)?;
        let mut found = Self { separator, decimal_comma, width, score, first: 0 };
        found.first = found.first_row(lines);
        Some(found)
    }

    /// Names and numbers above the table.
    fn parameters(&self, lines: &[(usize, &str)]) -> Vec<(String, f64)> {
        let of = |line: &str| {
            let line = line.trim_start_matches(['#', '%', '!', '/']).trim();
            let cells = cells(line, self.separator);
            let (name, value) = match &cells[..] {
                [name, value, ..] if self.separator != ' ' => (name.as_str(), value.as_str()),
                _ => line.split_once([':', '='])?,
            };
            let value = number(value.trim(), self.decimal_comma).filter(|v| v.is_finite())?;
            let is_name = number(name, self.decimal_comma).is_none();
            // `Width;6;mm`
            let unit = cells.get(2).filter(|cell| self.separator != ' ' && unit::unit(cell).is_some());
            let name =
                unit.map_or_else(|| name.trim().to_owned(), |unit| format!("{} ({unit})", name.trim()));
            is_name.then_some((name, value))
        };
        lines[..self.first].iter().filter_map(|(_, line)| of(line)).collect()
    }

    fn is_row(&self, line: &str) -> bool {
        let cells = cells(line, self.separator);
        cells.len() == self.width && is_row(&cells, self.decimal_comma)
    }

    /// The first row below the parameters: these may contain lines of numbers (`Samples 1200 1200`), but fewer than others.
    fn first_row(&self, lines: &[(usize, &str)]) -> usize {
        let (mut rows, mut others, mut first, mut is_begun) = (0, 0, 0, false);
        for (at, (_, line)) in lines.iter().enumerate().filter(|(_, (_, line))| is_content(line)) {
            if !self.is_row(line) {
                others += 1;
                is_begun &= rows >= others;
                continue;
            }
            rows += 1;
            if !is_begun {
                (first, is_begun) = (at, true);
            }
        }
        first
    }

    /// Headings from the lines directly above the first row, comments included, joined by column. A further line names groups of columns
    /// (`tip,,`): an empty cell continues the one to its left where the heading below it is not unique.
    fn headings(&self, lines: &[(usize, &str)]) -> Vec<String> {
        let above = lines[..self.first].iter().rev().filter(|(_, line)| !line.is_empty());
        let mut above = above.map(|(_, line)| line.trim_start_matches(['#', '%', '!', '/']).trim());
        let first = above.next().and_then(|line| self.heading(line));
        let Some(mut headings) = first else { return vec![String::new(); self.width] };
        let lowest = headings.clone();
        // Further lines of headings have the separator of the rows, sentences have not.
        for line in above.take(MAX_HEADINGS - 1).filter(|_| self.separator != ' ') {
            let found = self.fitted(cells(line, self.separator), MIN_NAMED);
            let Some(mut groups) = found else { break };
            // One more group of all columns tells none from the others.
            if headings != lowest && groups.len() > 2 && groups[2..].iter().all(|group| *group == groups[1]) {
                continue;
            }
            for at in 1..groups.len() {
                let is_repeated = lowest.iter().filter(|other| **other == lowest[at]).count() > 1;
                if groups[at].is_empty() && is_repeated {
                    groups[at] = groups[at - 1].clone();
                }
            }
            for (heading, group) in headings.iter_mut().zip(groups) {
                *heading = format!("{group} {heading}").trim().to_owned();
            }
        }
        self.add_units(&mut headings, lines);
        headings
    }

    /// Adds units that stand apart from the headings: a row of them (`Y_Unit_Label;psi;N`), or one of all positions (`Length Units,Meters`).
    fn add_units(&self, headings: &mut [String], lines: &[(usize, &str)]) {
        let above: Vec<Vec<String>> =
            lines[..self.first].iter().map(|(_, line)| cells(line, self.separator)).collect();
        let is_length = |cell: &&String| unit::unit(cell).is_some_and(|(q, _)| q == Quantity::Length);
        let of_positions = above.iter().flat_map(|cells| cells.windows(2));
        let of_positions = of_positions.filter(|pair| pair[0].to_lowercase().contains("length unit"));
        let of_positions = of_positions.map(|pair| &pair[1]).find(is_length);
        let row = above.iter().find(|cells| {
            let known = cells.iter().skip(1).filter(|cell| unit::unit(cell).is_some()).count();
            cells[0].to_lowercase().contains("unit") && known > 0 && cells.len() <= self.width + 1
        });
        let is_position = |heading: &str| {
            let heading = heading.to_lowercase();
            let axis = heading.rsplit(' ').next().unwrap_or_default();
            ["x", "y", "z"].contains(&axis) && !heading.contains("rotation")
        };
        for (at, heading) in headings.iter_mut().enumerate() {
            let own = row.and_then(|row| row.get(at)).filter(|cell| unit::unit(cell).is_some());
            let common = of_positions.filter(|_| is_position(heading));
            if let Some(unit) = own.or(common).filter(|_| unit::in_heading(heading).is_none()) {
                *heading += &format!(" [{unit}]");
            }
        }
    }

    /// Headings of the line above the rows, with the separator of the rows, two blanks, comma, tab or blanks. A separator too few or too many at
    /// its end is accepted.
    fn heading(&self, line: &str) -> Option<Vec<String>> {
        let spaced = || line.split("  ").map(str::trim).filter(|part| !part.is_empty()).map(str::to_owned);
        let candidates = [
            cells(line, self.separator),
            spaced().collect(),
            cells(line, ','),
            cells(line, '\t'),
            words(line),
        ];
        candidates.into_iter().find_map(|cells| self.fitted(cells, self.width / 2 + 1))
    }

    /// The cells, if they are one heading per column and at least `named` are not empty.
    fn fitted(&self, mut cells: Vec<String>, named: usize) -> Option<Vec<String>> {
        // A column of remarks at the end has cells only where there is one.
        let is_spare = |cell: &String| cell.is_empty() || cell.to_lowercase().starts_with("comment");
        if cells.len() == self.width + 1 && cells.last().is_some_and(is_spare) {
            cells.pop();
        }
        if cells.len() + 1 == self.width && self.separator != ' ' {
            cells.push(String::new());
        }
        let found = cells.iter().filter(|cell| !cell.is_empty()).count();
        let numeric = cells.iter().any(|cell| number(cell, self.decimal_comma).is_some_and(|v| !v.is_nan()));
        (cells.len() == self.width && found >= named.min(self.width) && !numeric).then_some(cells)
    }
}

/// Words of a line, a unit in brackets joined to the word above it.
fn words(line: &str) -> Vec<String> {
    let mut words: Vec<String> = Vec::new();
    for word in line.split_whitespace() {
        match words.last_mut() {
            Some(last) if word.starts_with(['(', '[']) => *last += &format!(" {word}"),
            _ => words.push(word.to_owned()),
        }
    }
    words
}
