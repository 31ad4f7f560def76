//! Commands and blocks of an archive, line by line.

use super::columns::{Columns, is_end};
use super::element::{Begun, Types};
use super::mesh::CdbMesh;
use crate::cells::Block;
use crate::error::Diagnostic;
use std::collections::HashMap;

/// Diagnostics after which reading stops: a file of another kind has one in every line.
const MAX_DIAGNOSTICS: usize = 50;
/// Commands that make nodes or elements, which a file in blocks has none of.
const MAKERS: [&str; 18] = [
    "N", "E", "EN", "EMORE", "NGEN", "EGEN", "ENGEN", "FILL", "NSYM", "ESYM", "ENSYM", "NSCALE", "NREAD",
    "EREAD", "VMESH", "CDREAD", "/INPUT", "*DO",
];
/// The command that writes what is read here.
const WRITE: &str = "CDWRITE,DB,run,cdb,,,,BLOCKED";

/// Reads a text.
pub(super) fn read(text: &str) -> Result<CdbMesh, Vec<Diagnostic>> {
    let mut reader = Reader::default();
    for (number, line) in text.lines().enumerate() {
        reader.number = number + 1;
        reader.line(line);
        if reader.diagnostics.len() >= MAX_DIAGNOSTICS {
            break;
        }
    }
    reader.finish()
}

/// What the lines below belong to.
#[derive(Default)]
enum Section {
    #[default]
    Commands,
    /// A block of which the next line is its columns.
    Begun(Rows),
    Rows(Columns, Rows),
}

/// The rows of a block.
enum Rows {
    Nodes,
    Types,
    /// Whether the block has the word SOLID, and the element that is not complete.
    Elements(bool, Option<Begun>),
}

#[derive(Default)]
struct Reader {
    mesh: CdbMesh,
    place: HashMap<u64, u32>,
    types: Types,
    section: Section,
    number: usize,
    diagnostics: Vec<Diagnostic>,
}

impl Reader {
    fn report(&mut self, expected: impl std::fmt::Display, found: impl std::fmt::Display) {
        let found: String = found.to_string().trim().chars().take(80).collect();
        self.diagnostics.push(Diagnostic::new(format!("line {}", self.number), expected, found));
    }

    fn line(&mut self, line: &str) {
        match std::mem::take(&mut self.section) {
            Section::Commands => self.command(line),
            Section::Begun(rows) => match Columns::parse(line) {
                Some(columns) => self.section = Section::Rows(columns, rows),
                None => self.report("the columns of the block, as (3i9,6e21.13e3)", line),
            },
            Section::Rows(_, Rows::Elements(_, Some(begun))) if is_end(line) => {
                self.report(begun.expected(), "the end of the block");
            }
            Section::Rows(..) if is_end(line) => {}
            Section::Rows(columns, mut rows) => {
                if line.is_ascii() {
                    self.row(line, columns, &mut rows);
                } else {
                    self.report("numbers in columns", line);
                }
                self.section = Section::Rows(columns, rows);
            }
        }
    }

    fn command(&mut self, line: &str) {
        let text = line.split('!').next().unwrap_or_default();
        let words: Vec<String> = text.split(',').map(|word| word.trim().to_ascii_uppercase()).collect();
        let word = |at: usize| words.get(at).map_or("", String::as_str);
        match word(0) {
            "NBLOCK" => self.section = Section::Begun(Rows::Nodes),
            "EBLOCK" => self.section = Section::Begun(Rows::Elements(word(2) == "SOLID", None)),
            "ETBLOCK" => self.section = Section::Begun(Rows::Types),
            "ET" => {
                let digits = word(2).trim_start_matches(|c: char| !c.is_ascii_digit());
                match (word(1).parse(), digits.parse()) {
                    (Ok(number), Ok(name)) => self.types.insert(number, name),
                    _ => self.report("ET,NUMBER,ELEMENT with numbers, as CDWRITE writes it", line),
                }
            }
            "TYPE" => self.types.chosen = word(1).parse().ok(),
            name if MAKERS.contains(&name) && !is_end(line) => {
                let expected = format!("all nodes and elements in blocks ({WRITE})");
                self.report(expected, format!("{name}, which makes others"));
            }
            _ => {}
        }
    }

    fn row(&mut self, line: &str, columns: Columns, rows: &mut Rows) {
        match rows {
            Rows::Nodes => self.node(line, columns),
            Rows::Types => {
                // Some programs do not keep to the columns here.
                let mut words = line.split_ascii_whitespace().map(str::parse::<u64>);
                match (words.next(), words.next()) {
                    (Some(Ok(number)), Some(Ok(name))) => self.types.insert(number, name),
                    _ => self.report("the number of a type and of its element", line),
                }
            }
            Rows::Elements(is_solid, begun) => {
                let numbers: Option<Vec<u64>> = columns.integers(line).collect();
                let Some(numbers) = numbers.filter(|numbers| !numbers.is_empty()) else {
                    return self.report("whole numbers", line);
                };
                let element = match begun.take() {
                    Some(element) => Ok(element.further(&numbers)),
                    None => Begun::first(&numbers, *is_solid, &self.types),
                };
                match element {
                    Ok(element) if element.is_whole() => self.element(&element),
                    Ok(element) => *begun = Some(element),
                    Err((expected, found)) => self.report(expected, found),
                }
            }
        }
    }

    fn node(&mut self, line: &str, columns: Columns) {
        let label = columns.integers(line).next().flatten();
        let point = columns.point(line).filter(|point| point.iter().all(|value| value.is_finite()));
        let (Some(label), Some(point)) = (label, point) else {
            return self.report("a node number and up to three coordinates", line);
        };
        if self.place.insert(label, self.mesh.points.len() as u32).is_some() {
            self.report("every node once", format!("node {label} again"));
        }
        self.mesh.points.push(point);
        self.mesh.labels.push(label);
    }

    fn element(&mut self, element: &Begun) {
        let (kind, labels) = match element.cell(&self.types) {
            Ok(Some(cell)) => cell,
            Ok(None) => return,
            Err((expected, found)) => {
                return self.report(expected, format!("{found} at element {}", element.label));
            }
        };
        let mut nodes = Vec::with_capacity(labels.len());
        for label in labels {
            let Some(node) = self.place.get(&label) else {
                let found = format!("node {label} of element {}, which is nowhere", element.label);
                return self.report("nodes of the NBLOCK above", found);
            };
            nodes.push(*node);
        }
        match self.mesh.blocks.iter_mut().find(|block| block.kind == kind) {
            Some(block) => block.nodes.extend(nodes),
            None => self.mesh.blocks.push(Block { kind, nodes_per_cell: nodes.len(), nodes }),
        }
    }

    fn finish(mut self) -> Result<CdbMesh, Vec<Diagnostic>> {
        if self.diagnostics.is_empty() && !matches!(self.section, Section::Commands) {
            self.report("the end of the block (-1)", "the end of the file: it is cut short");
        }
        if self.diagnostics.is_empty() && (self.mesh.points.is_empty() || self.mesh.blocks.is_empty()) {
            let expected = format!("NBLOCK with nodes and EBLOCK with solids or shells ({WRITE})");
            self.diagnostics.push(Diagnostic::new("file", expected, "none"));
        }
        if self.diagnostics.is_empty() { Ok(self.mesh) } else { Err(self.diagnostics) }
    }
}
