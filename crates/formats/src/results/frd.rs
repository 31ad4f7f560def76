//! CalculiX results (`.frd`, ASCII), which ccx writes for `*NODE FILE` and `*EL FILE`.
//!
//! Columns are fixed, without separators: `-1`, the node in 10 (short form: 5) characters, 12 characters per value.
//! A job that fails stores the state of the failed increment and omits the last line, `9999`.

use super::run::{NodalQuantity, Run, Step, Total, same_or_new};
use crate::cells::{Block, CellKind};
use crate::error::{Diagnostic, FormatError};
use crate::file;
use std::collections::HashMap;
use std::path::Path;

/// Diagnostics after which reading stops.
const MAX_DIAGNOSTICS: usize = 20;
/// Characters of a value.
const VALUE: usize = 12;
/// A quantity at fewer than one in `SPARSE` nodes is ignored.
const SPARSE: usize = 16;
/// Values of a line.
const VALUES: usize = 6;

/// Reads a file.
pub(super) fn read(path: &Path) -> Result<Run, FormatError> {
    let bytes = file::read_bytes(path, file::MAX_DATA_BYTES)?;
    let run = parse(&bytes).map_err(|diagnostics| FormatError::Content { path: path.into(), diagnostics })?;
    Ok(Run { totals: totals_beside(path)?, ..run })
}

/// Reads the content of a file. Cost and memory are linear in the bytes.
///
/// # Errors
/// All errors, with line numbers; never empty.
pub fn parse(bytes: &[u8]) -> Result<Run, Vec<Diagnostic>> {
    let mut reader = FrdReader::default();
    // A job that was killed leaves half a line.
    let whole = bytes.iter().rposition(|byte| *byte == b'\n').map_or(bytes, |at| &bytes[..at]);
    for (number, line) in whole.split(|byte| *byte == b'\n').enumerate() {
        reader.number = number + 1;
        let line = line.strip_suffix(b"\r").unwrap_or(line);
        match std::str::from_utf8(line).ok().filter(|text| text.is_ascii()) {
            Some(text) => reader.line(text),
            // The header holds names of files and people, in any encoding.
            None if line.starts_with(b"    1U") => {}
            None => {
                reader.report(
                    "text (a binary .frd comes from *NODE OUTPUT: write *NODE FILE, *EL FILE)",
                    "other bytes",
                );
                break;
            }
        }
        if reader.diagnostics.len() >= MAX_DIAGNOSTICS || reader.ended {
            break;
        }
    }
    reader.finish()
}

/// Block of the lines that follow.
#[derive(Default)]
enum Section {
    #[default]
    Other,
    /// Nodes, with the width of their numbers.
    Nodes(usize),
    /// Elements, with the width of the numbers and an incomplete element.
    Elements(usize, Option<Element>),
    /// Width of the numbers, a quantity with its values in the order of the lines, and their nodes.
    Values(usize, NodalQuantity, Vec<u32>),
}

struct Element {
    kind: Option<CellKind>,
    number: usize,
    nodes: Vec<u32>,
    line: usize,
}

#[derive(Default)]
struct FrdReader {
    run: Run,
    place: HashMap<u64, u32>,
    section: Section,
    /// Number and time in `100C` by which quantities belong to one state.
    state: Option<(String, String)>,
    /// Step and increment of the last `1PSTEP`.
    step: String,
    number: usize,
    beams: usize,
    ended: bool,
    diagnostics: Vec<Diagnostic>,
}

impl FrdReader {
    fn report(&mut self, expected: impl std::fmt::Display, found: impl std::fmt::Display) {
        let found: String = found.to_string().chars().take(60).collect();
        self.diagnostics.push(Diagnostic::new(format!("line {}", self.number), expected, found));
    }

    fn line(&mut self, line: &str) {
        match line.get(..3).unwrap_or_default() {
            " -1" => self.first(line),
            " -2" => self.further(line),
            " -3" => self.close(),
            " -4" => self.quantity(line),
            " -5" => self.component(line),
            _ => self.header(line),
        }
    }

    fn header(&mut self, line: &str) {
        let key = line.get(..6).unwrap_or(line).trim();
        match key {
            "2C" | "3C" => {
                self.close();
                if let Some(width) = self.width(line) {
                    self.section =
                        if key == "2C" { Section::Nodes(width) } else { Section::Elements(width, None) };
                }
            }
            "100C" => self.block(line),
            "9999" => self.ended = true,
            _ if line.starts_with("    1PSTEP") => {
                let words: Vec<&str> = line.split_whitespace().collect();
                if let [_, _, increment, step, ..] = words.as_slice() {
                    self.step = format!("step {step} increment {increment}");
                }
            }
            _ => {}
        }
    }

    /// Width of a node's number in the form given by the header's last word.
    fn width(&mut self, line: &str) -> Option<usize> {
        match line.split_whitespace().last() {
            Some("0") => Some(5),
            Some("1") => Some(10),
            other => {
                let found = format!("form {}", other.unwrap_or_default());
                self.report("text, form 0 or 1 (binary comes from *NODE OUTPUT: write *NODE FILE)", found);
                None
            }
        }
    }

    /// `100C`: name, time, nodes, type of analysis, number of the state, form.
    fn block(&mut self, line: &str) {
        self.close();
        let text = |from: usize, to: usize| line.get(from..to.min(line.len())).unwrap_or_default().trim();
        let (time, kind, number) = (text(12, 24), text(56, 58), text(58, 63));
        let Some(width) = self.width(line) else { return };
        let is_shape = matches!(kind, "2" | "4");
        let state = (number.to_owned(), time.to_owned());
        if self.state.as_ref() != Some(&state) {
            let name = if self.step.is_empty() { format!("step {number}") } else { self.step.clone() };
            if is_shape {
                self.run.left_out.push(format!("{name}: a mode of vibration or buckling, not a state"));
            } else {
                self.run.steps.push(Step { name, time: time.parse().ok(), quantities: Vec::new() });
            }
            self.state = Some(state);
        }
        self.section = if is_shape {
            Section::Other
        } else {
            Section::Values(width, NodalQuantity::default(), Vec::new())
        };
    }

    fn quantity(&mut self, line: &str) {
        if let Section::Values(_, quantity, _) = &mut self.section {
            line.get(3..)
                .unwrap_or_default()
                .split_whitespace()
                .next()
                .unwrap_or_default()
                .clone_into(&mut quantity.name);
        }
    }

    fn component(&mut self, line: &str) {
        if let Section::Values(_, quantity, _) = &mut self.section {
            let words: Vec<&str> = line.get(3..).unwrap_or_default().split_whitespace().collect();
            // Value 6 of a component marks one that viewers compute, such as ALL, without a column.
            if let Some(name) = words.first().filter(|_| words.get(5).is_none()) {
                quantity.components.push((*name).to_owned());
            }
        }
    }

    fn first(&mut self, line: &str) {
        let nodes = self.run.points.len();
        match &mut self.section {
            Section::Nodes(width) => {
                let (label, values) = (integer(line, 3, *width), numbers(line, 3 + *width, 3));
                match (label, values) {
                    (Some(label), Some([x, y, z, ..])) if (x + y + z).is_finite() => {
                        self.run.points.push([x, y, z]);
                        if self.place.insert(label, nodes as u32).is_some() {
                            self.report("every node once", format!("node {label} again"));
                        }
                    }
                    _ => self.report("a node and three coordinates", line),
                }
            }
            Section::Elements(width, open) => {
                let number = line.get(3 + *width..8 + *width).and_then(|t| t.trim().parse::<usize>().ok());
                let begun = number.map(|number| Element {
                    kind: kind(number),
                    number,
                    nodes: Vec::new(),
                    line: self.number,
                });
                let ended = std::mem::replace(open, begun);
                self.element(ended);
            }
            Section::Values(width, quantity, rows) => {
                let now = quantity.components.len().min(VALUES);
                let node = integer(line, 3, *width).and_then(|label| self.place.get(&label).copied());
                let (Some(node), Some(values)) = (node, numbers(line, 3 + *width, now)) else {
                    return self.report(format!("a node of this file and {now} values"), line);
                };
                rows.push(node);
                quantity.values.extend(&values[..now]);
            }
            Section::Other => {}
        }
    }

    fn further(&mut self, line: &str) {
        match &mut self.section {
            Section::Elements(width, Some(element)) => {
                let (width, place) = (*width, &self.place);
                let cells = line.get(3..).unwrap_or_default().as_bytes().chunks(width);
                let words = cells.map(|cell| std::str::from_utf8(cell).unwrap_or_default().trim());
                let nodes: Option<Vec<u32>> = words
                    .filter(|word| !word.is_empty())
                    .map(|word| word.parse().ok().and_then(|label: u64| place.get(&label).copied()))
                    .collect();
                match nodes {
                    Some(nodes) => element.nodes.extend(nodes),
                    None => self.report("nodes of this file", line),
                }
            }
            Section::Values(width, quantity, rows) => {
                let left = (rows.len() * quantity.components.len()).saturating_sub(quantity.values.len());
                match numbers(line, 3 + *width, left.min(VALUES)) {
                    Some(values) => quantity.values.extend(&values[..left.min(VALUES)]),
                    None => self.report(format!("{} further values", left.min(VALUES)), line),
                }
            }
            _ => {}
        }
    }

    fn element(&mut self, element: Option<Element>) {
        let Some(Element { kind, number, mut nodes, line }) = element else { return };
        if matches!(number, 11 | 12) {
            self.beams += 1; // they have no surface
            return;
        }
        let Some(kind) = kind.filter(|kind| kind.nodes == nodes.len()) else {
            let found = format!("type {number} with {} nodes", nodes.len());
            let place = format!("line {line}");
            return self.diagnostics.push(Diagnostic::new(
                place,
                "an element of types 1 to 10 with its nodes",
                found,
            ));
        };
        // The mid-sides of the upright edges stand before those of the upper face here.
        match kind.number {
            25 => nodes[12..].rotate_left(4),
            26 => nodes[9..].rotate_left(3),
            _ => {}
        }
        Block::add(&mut self.run.blocks, kind, nodes);
    }

    /// Ends the section.
    fn close(&mut self) {
        match std::mem::take(&mut self.section) {
            Section::Elements(_, element) => self.element(element),
            Section::Values(_, quantity, rows) => self.values(quantity, &rows),
            _ => {}
        }
    }

    /// Sorts the values of a quantity by node; a quantity at few nodes is ignored.
    fn values(&mut self, mut quantity: NodalQuantity, rows: &[u32]) {
        let (nodes, count) = (self.run.points.len(), quantity.components.len());
        if quantity.values.len() != rows.len() * count {
            return self
                .report(format!("{count} values for each of {} nodes", rows.len()), quantity.values.len());
        }
        if rows.len() * SPARSE < nodes || count == 0 {
            return;
        }
        let mut values = vec![f64::NAN; nodes * count];
        let mut again = None;
        for (node, row) in rows.iter().zip(quantity.values.chunks_exact(count)) {
            let known = &mut values[*node as usize * count..][..count];
            if !same_or_new(known, row) {
                again = Some(*node);
            }
            known.copy_from_slice(row);
        }
        if let Some(node) = again {
            self.report(
                format!("one value of {} per node", quantity.name),
                format!("two at node {}", node + 1),
            );
        }
        quantity.values = values;
        if let Some(step) = self.run.steps.last_mut() {
            step.quantities.push(quantity);
        }
    }

    fn finish(mut self) -> Result<Run, Vec<Diagnostic>> {
        if self.beams > 0 {
            self.run.left_out.push(format!("{} beams (elements of type 11 or 12)", self.beams));
        }
        if !self.ended
            && let Some(last) = self.run.steps.pop()
        {
            let reason = "not converged or incomplete: the job did not end (no 9999 at the end of the file)";
            self.run.left_out.push(format!("{}: {reason}", last.name));
        }
        if self.diagnostics.is_empty() && (self.run.points.is_empty() || self.run.blocks.is_empty()) {
            self.report("nodes and elements of a .frd (did the job end?)", "the end of the file");
        }
        if self.diagnostics.is_empty() { Ok(self.run) } else { Err(self.diagnostics) }
    }
}

fn kind(number: usize) -> Option<CellKind> {
    let vtk = [12, 13, 10, 25, 26, 24, 5, 22, 9, 23];
    number.checked_sub(1).and_then(|at| vtk.get(at)).and_then(|number| CellKind::of(*number))
}

fn integer(line: &str, from: usize, width: usize) -> Option<u64> {
    line.get(from..from + width)?.trim().parse().ok()
}

/// Values of a line, at most [`VALUES`].
fn numbers(line: &str, from: usize, count: usize) -> Option<[f64; VALUES]> {
    let mut values = [f64::NAN; VALUES];
    for (k, value) in values.iter_mut().enumerate().take(count) {
        let begin = from + k * VALUE;
        *value = line.get(begin..(begin + VALUE).min(line.len()))?.trim().parse().ok()?;
    }
    Some(values)
}

/// Words before the name of the set, and between it and the time.
const TOTAL_WORDS: [&str; 2] = ["total force (fx,fy,fz) for set ", " and time "];

/// Total forces that CalculiX prints into `job.dat`, next to `job.frd`, for `*NODE PRINT, NSET=PLATE, TOTALS=ONLY` with `RF`; empty if
/// there is no such file.
fn totals_beside(frd: &Path) -> Result<Vec<Total>, FormatError> {
    let path = frd.with_extension("dat");
    if !path.is_file() {
        return Ok(Vec::new());
    }
    let bytes = file::read_bytes(&path, file::MAX_DATA_BYTES)?;
    parse_dat(&String::from_utf8_lossy(&bytes))
        .map_err(|diagnostics| FormatError::Content { path, diagnostics: vec![diagnostics] })
}

/// Reads the content of a `.dat`; other output is ignored. The file of a killed job may be cut short.
///
/// # Errors
/// A total without a time, or without its three numbers.
pub fn parse_dat(text: &str) -> Result<Vec<Total>, Diagnostic> {
    let mut totals = Vec::new();
    let mut lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    while let Some((at, line)) = lines.next() {
        let Some(rest) = line.trim().strip_prefix(TOTAL_WORDS[0]) else { continue };
        let place = format!("line {}", at + 1);
        let known =
            rest.rsplit_once(TOTAL_WORDS[1]).and_then(|(set, time)| Some((set.trim(), finite(time)?)));
        let Some((set, time)) = known else {
            return Err(Diagnostic::new(place, "a set and a time", rest));
        };
        let Some((at, numbers)) = lines.next() else { break };
        let force: Option<Vec<f64>> = numbers.split_ascii_whitespace().map(finite).collect();
        let Some(force) = force.and_then(|force| <[f64; 3]>::try_from(force).ok()) else {
            return Err(Diagnostic::new(
                format!("line {}", at + 1),
                "three numbers, the force along x, y and z",
                numbers,
            ));
        };
        totals.push(Total { set: set.to_owned(), time, force });
    }
    Ok(totals)
}

fn finite(word: &str) -> Option<f64> {
    word.trim().parse().ok().filter(|value: &f64| value.is_finite())
}
