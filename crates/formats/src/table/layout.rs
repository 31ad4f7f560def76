//! The form of a table that a bench wrote: its separator, its first row, the headings and parameters above it.
//!
//! Each separator is tried; the one whose rows of equal width hold most numbers is taken. Headings are the lines directly above the
//! first row. What could be meant in two ways is refused with the key of `[table]` that says it.

use super::number::{Spelling, is_content, is_number, number_of_head, spelling};
use super::{SEPARATORS, Table, TableForm, cells, labelled, lines};
use crate::error::Diagnostic;
use crate::file;
use crate::unit::{self, Dimension};
use std::borrow::Cow;
use std::ops::Range;

/// Most lines of headings: motion capture has body, marker, number, quantity and axis.
const MAX_HEADINGS: usize = 6;
/// Fewest headings of a further line.
const MIN_NAMED: usize = 2;
/// A table of a bench.
pub(crate) struct ForeignTable {
    pub(crate) table: Table,
    /// Lines below the first row that are not rows, and rows among the parameters.
    pub(crate) damaged: Vec<Diagnostic>,
    /// Numbers by name above the table: `Width (mm);6`, `width_mm = 6`.
    pub(crate) parameters: Vec<(String, f64)>,
    pub(crate) separator: char,
    /// A blank may separate groups of thousands.
    pub(crate) blanks: bool,
}

/// Finds the table in a text.
///
/// # Errors
/// No line with a number; a heading that may be that of the first or of the last columns.
pub(crate) fn found(text: String, form: &TableForm) -> Result<ForeignTable, Diagnostic> {
    let (labels, text) = match labelled::rows(&text) {
        Some((labels, rewritten)) => (Some(labels), rewritten),
        None => (None, text),
    };
    let all: Vec<(usize, Range<usize>)> = lines(&text).collect();
    // Tabs at the ends of a line are cells; blanks are not.
    let shown: Vec<(usize, &str)> =
        all.iter().map(|(number, place)| (*number, text[place.clone()].trim_matches(' '))).collect();
    for (number, line) in &shown {
        for separator in SEPARATORS {
            file::check_columns(*number, line.matches(separator).count())?;
        }
    }
    let tried = SEPARATORS.into_iter().filter(|tried| form.separator.is_none_or(|given| given == *tried));
    let layout =
        tried.filter_map(|separator| Layout::of(&shown, separator)).max_by_key(|layout| layout.score);
    let layout = layout.ok_or_else(|| {
        let expected = "lines of numbers in columns (another form: read it in Python, as with pandas.read_csv or \
                        pandas.json_normalize, and write it with to_csv(index=False))";
        Diagnostic::new("content", expected, "none")
    })?;
    let labels = labels.filter(|l| l.len() == layout.width && l.iter().all(|label| !label.is_empty()));
    let header = match labels {
        Some(labels) => labels,
        None => layout.headings(&shown, form)?,
    };
    let (mut rows, mut damaged) = (Vec::new(), Vec::new());
    for (index, (line, shown)) in shown.iter().enumerate().filter(|(_, (_, line))| is_content(line.trim())) {
        let is_row = layout.is_row(shown);
        if index < layout.first {
            if is_row {
                let expected = "a row below the headings";
                damaged.push(Diagnostic::new(format!("line {line}"), expected, "one among parameters"));
            }
        } else if is_row {
            rows.push(all[index].clone());
        } else {
            let found = shown.chars().take(40).collect::<String>();
            let expected = format!("{} cells with numbers", layout.width);
            let found = format!("{} cells, `{found}`", cells(shown, layout.separator).len());
            damaged.push(Diagnostic::new(format!("line {line}"), expected, found));
        }
    }
    let (parameters, separator, blanks) = (layout.parameters(&shown), layout.separator, layout.blanks());
    let table = Table { text, separator, header, rows };
    Ok(ForeignTable { table, damaged, parameters, separator, blanks })
}

/// True if at least half of the cells that are not empty are numbers; text columns (`valve open`) stay in the table.
fn is_row(cells: &[Cow<'_, str>], blanks: bool) -> bool {
    let full = cells.iter().filter(|cell| !cell.is_empty());
    let (mut missing, mut numbers, mut others) = (0, 0, 0);
    for cell in full {
        match spelling(cell, blanks) {
            Spelling::Missing => missing += 1,
            Spelling::Words if !is_number(cell, blanks) => others += 1,
            _ => numbers += 1,
        }
    }
    numbers > others || (others == 0 && numbers == 0 && missing > 0)
}

/// A separator with the width of most rows.
struct Layout {
    separator: char,
    width: usize,
    /// Numbers in rows of this width, minus twice the other cells: a decimal comma taken for a separator leaves such cells.
    score: i64,
    /// Index of the first row.
    first: usize,
    /// Each row ends with an empty cell.
    is_last_empty: bool,
}

impl Layout {
    fn of(lines: &[(usize, &str)], separator: char) -> Option<Self> {
        let mut found = Self { separator, width: 0, score: 0, first: 0, is_last_empty: true };
        // Width, rows, score.
        let mut widths: Vec<(usize, usize, i64, bool)> = Vec::new();
        for (_, line) in lines.iter().filter(|(_, line)| is_content(line.trim())) {
            let cells = cells(line, separator);
            if !is_row(&cells, found.blanks()) {
                continue;
            }
            let is_other = |cell: &Cow<'_, str>| {
                spelling(cell, found.blanks()) == Spelling::Words && !is_number(cell, found.blanks())
            };
            let others = cells.iter().filter(|cell| is_other(cell)).count();
            let score = cells.len() as i64 - 3 * others as i64;
            let ends_empty = cells.last().is_some_and(|cell| cell.is_empty());
            match widths.iter_mut().find(|(width, ..)| *width == cells.len()) {
                Some((_, rows, sum, empty)) => {
                    (*rows, *sum, *empty) = (*rows + 1, *sum + score, *empty && ends_empty)
                }
                None => widths.push((cells.len(), 1, score, ends_empty)),
            }
        }
        let (width, _, score, is_last_empty) = widths.into_iter().max_by_key(|(_, rows, ..)| *rows)?;
        (found.width, found.score, found.is_last_empty) = (width, score, is_last_empty);
        found.first = found.first_row(lines);
        Some(found)
    }

    /// Blanks within cells separate groups of thousands where neither blanks nor commas, beside which blanks stand, separate cells.
    fn blanks(&self) -> bool {
        matches!(self.separator, ';' | '\t')
    }

    fn is_row(&self, line: &str) -> bool {
        let cells = cells(line, self.separator);
        cells.len() == self.width && is_row(&cells, self.blanks())
    }

    /// Names and numbers above the table.
    fn parameters(&self, lines: &[(usize, &str)]) -> Vec<(String, f64)> {
        let decimal_comma = self.separator != ',';
        let parameter = |line: &str| {
            let line = line.trim_start_matches(['#', '%', '!', '/']).trim();
            let cells = cells(line, self.separator);
            let (name, value) = match &cells[..] {
                [name, value, ..] if self.separator != ' ' => (name.as_ref(), value.as_ref()),
                _ => line.split_once([':', '='])?,
            };
            let value = number_of_head(value.trim(), decimal_comma)?;
            let is_name = spelling(name, false) == Spelling::Words;
            // `Width;6;mm`
            let unit = cells.get(2).filter(|cell| self.separator != ' ' && unit::unit(cell).is_some());
            let name =
                unit.map_or_else(|| name.trim().to_owned(), |unit| format!("{} ({unit})", name.trim()));
            is_name.then_some((name, value))
        };
        lines[..self.first].iter().filter_map(|(_, line)| parameter(line)).collect()
    }

    /// The first row below the parameters: these may contain lines of numbers (`Samples 1200 1200`), but fewer than others.
    fn first_row(&self, lines: &[(usize, &str)]) -> usize {
        let (mut rows, mut others, mut first, mut is_begun) = (0, 0, 0, false);
        for (index, (_, line)) in lines.iter().enumerate().filter(|(_, (_, line))| is_content(line.trim())) {
            if !self.is_row(line) {
                others += 1;
                is_begun &= rows >= others;
                continue;
            }
            rows += 1;
            if !is_begun {
                (first, is_begun) = (index, true);
            }
        }
        first
    }

    /// Headings from the lines directly above the first row, comments included, joined by column. A further line names groups of columns
    /// (`tip,,`): an empty cell continues the one to its left where the heading below it is not unique.
    fn headings(&self, lines: &[(usize, &str)], form: &TableForm) -> Result<Vec<String>, Diagnostic> {
        let above = lines[..self.first].iter().rev().filter(|(_, line)| !line.trim().is_empty());
        let mut above = above
            .map(|(number, line)| (*number, line.trim_start_matches(['#', '%', '!', '/']).trim_matches(' ')));
        let first =
            above.next().map(|(number, line)| self.heading(number, line, form)).transpose()?.flatten();
        let Some(mut headings) = first else { return Ok(vec![String::new(); self.width]) };
        let lowest = headings.clone();
        // Further lines of headings have the separator of the rows, sentences have not.
        for (_, line) in above.take(MAX_HEADINGS - 1).filter(|_| self.separator != ' ') {
            let found = self.fitted(owned(cells(line, self.separator)), MIN_NAMED);
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
        Ok(headings)
    }

    /// Adds units that stand apart from the headings: a row of them (`Y_Unit_Label;psi;N`), or one of all positions (`Length Units,Meters`).
    fn add_units(&self, headings: &mut [String], lines: &[(usize, &str)]) {
        let above: Vec<Vec<Cow<'_, str>>> =
            lines[..self.first].iter().map(|(_, line)| cells(line, self.separator)).collect();
        let is_length = |cell: &&Cow<'_, str>| unit::unit(cell).is_some_and(|(q, _)| q == Dimension::Length);
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
        for (index, heading) in headings.iter_mut().enumerate() {
            let own = row.and_then(|row| row.get(index)).filter(|cell| unit::unit(cell).is_some());
            let common = of_positions.filter(|_| is_position(heading));
            if let Some(unit) = own.or(common).filter(|_| unit::in_heading(heading).is_none()) {
                *heading += &format!(" [{unit}]");
            }
        }
    }

    /// Headings of the line above the rows, with the separator of the rows, two blanks, comma, tab or blanks.
    ///
    /// # Errors
    /// One heading too few, which may be that of the first or of the last column.
    fn heading(
        &self,
        number: usize,
        line: &str,
        form: &TableForm,
    ) -> Result<Option<Vec<String>>, Diagnostic> {
        let mut own = owned(cells(line, self.separator));
        let is_named = own.iter().all(|cell| !cell.is_empty() && spelling(cell, false) == Spelling::Words);
        // One cell alone is a title.
        if own.len() > 1
            && own.len() + 1 == self.width
            && self.separator != ' '
            && !self.is_last_empty
            && is_named
        {
            let Some(row_names) = form.row_names else {
                let expected = format!(
                    "a heading for each of {} columns (names of rows in the first column: `row_names = true` in [table], or \
                     pandas.read_csv(FILE, sep=None, engine=\"python\", index_col=0); none in the last: `row_names = false`)",
                    self.width
                );
                return Err(Diagnostic::new(format!("line {number}"), expected, own.len()));
            };
            own.insert(if row_names { 0 } else { own.len() }, String::new());
        }
        let spaced = || line.split("  ").map(str::trim).filter(|part| !part.is_empty()).map(str::to_owned);
        let candidates =
            [own, spaced().collect(), owned(cells(line, ',')), owned(cells(line, '\t')), words(line)];
        Ok(candidates.into_iter().find_map(|cells| self.fitted(cells, self.width / 2 + 1)))
    }

    /// The cells, if they are one heading per column and at least `named` are not empty.
    fn fitted(&self, mut cells: Vec<String>, named: usize) -> Option<Vec<String>> {
        // A column of remarks at the end has cells only where there is one.
        let is_spare = |cell: &String| cell.is_empty() || cell.to_lowercase().starts_with("comment");
        if cells.len() == self.width + 1 && cells.last().is_some_and(is_spare) {
            cells.pop();
        }
        // Rows that end with a separator.
        if cells.len() + 1 == self.width && self.is_last_empty {
            cells.push(String::new());
        }
        let found = cells.iter().filter(|cell| !cell.is_empty()).count();
        let is_numeric = cells.iter().any(|cell| is_number(cell, false));
        (cells.len() == self.width && found >= named.min(self.width) && !is_numeric).then_some(cells)
    }
}

fn owned(cells: Vec<Cow<'_, str>>) -> Vec<String> {
    cells.into_iter().map(Cow::into_owned).collect()
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
