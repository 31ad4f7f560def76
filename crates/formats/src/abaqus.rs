//! Abaqus input files (`.inp`): nodes, tetrahedra, hexahedra, wedges, shells.
//!
//! Materials, steps and the like are ignored. Unknown element types are errors, as are keywords that change the meaning of node
//! numbers: a second part, `*INCLUDE`, generated nodes.

use crate::cells::{Block as Cells, Kind};
use crate::error::{Diagnostic, FormatError};
use crate::file;
use std::collections::HashMap;
use std::path::Path;

/// Diagnostics after which reading stops.
const MAX_DIAGNOSTICS: usize = 50;

/// Mesh of an input file. Indices are 0-based positions in `points`; node order within elements is VTK's, which is Abaqus' too for
/// these types.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AbaqusMesh {
    /// Node positions in the file's unit of length.
    pub points: Vec<[f64; 3]>,
    /// The file's node numbers.
    pub labels: Vec<u64>,
    /// Elements as VTK's cells, one block per kind.
    pub blocks: Vec<Cells>,
}

/// Kind of cell of an element type.
fn kind_of(name: &str) -> Option<Kind> {
    Kind::of(match name {
        "C3D4" | "C3D4H" => 10,
        "C3D10" | "C3D10H" | "C3D10M" | "C3D10MH" | "C3D10HS" => 24,
        "C3D8" | "C3D8H" | "C3D8I" | "C3D8IH" | "C3D8R" | "C3D8RH" => 12,
        "C3D20" | "C3D20H" | "C3D20R" | "C3D20RH" => 25,
        "C3D6" | "C3D6H" => 13,
        "C3D15" | "C3D15H" => 26,
        "S3" | "S3R" | "S3RS" | "M3D3" => 5,
        "S4" | "S4R" | "S4RS" | "S4R5" | "M3D4" | "M3D4R" => 9,
        "STRI65" | "M3D6" => 22,
        "S8R" | "S8R5" | "M3D8" | "M3D8R" => 23,
        _ => return None,
    })
}

/// Block of data lines.
enum Block {
    /// Lines without mesh data.
    Other,
    /// Node lines.
    Nodes,
    /// Element lines, and the numbers of an incomplete element.
    Elements(Kind, Vec<u64>),
}

/// Reads a file.
///
/// # Errors
/// I/O error, or all errors in the content.
pub fn read(path: &Path) -> Result<AbaqusMesh, FormatError> {
    let bytes = file::read_bytes(path, file::MAX_DATA_BYTES)?;
    parse(&String::from_utf8_lossy(&bytes))
        .map_err(|diagnostics| FormatError::Content { path: path.into(), diagnostics })
}

/// [`read`] from memory. Cost and memory are linear in the text.
///
/// # Errors
/// All errors, with line numbers; never empty.
pub fn parse(text: &str) -> Result<AbaqusMesh, Vec<Diagnostic>> {
    let mut reader = Reader::default();
    for (number, line) in text.lines().enumerate() {
        reader.number = number + 1;
        let line = line.trim();
        match line.strip_prefix('*') {
            _ if line.is_empty() || line.starts_with("**") => {}
            Some(keyword) => reader.keyword(keyword),
            None => reader.data(line),
        }
        if reader.diagnostics.len() >= MAX_DIAGNOSTICS {
            break;
        }
    }
    reader.finish()
}

#[derive(Default)]
struct Reader {
    mesh: AbaqusMesh,
    place: HashMap<u64, u32>,
    elements: Vec<(Kind, Vec<u64>, usize)>,
    block: Option<Block>,
    parts: usize,
    number: usize,
    diagnostics: Vec<Diagnostic>,
}

impl Reader {
    fn report(&mut self, expected: impl std::fmt::Display, found: impl std::fmt::Display) {
        self.diagnostics.push(Diagnostic::new(format!("line {}", self.number), expected, found));
    }

    fn keyword(&mut self, text: &str) {
        self.close_element();
        let mut words = text.split(',').map(|word| word.trim().to_ascii_uppercase());
        let name = words.next().unwrap_or_default();
        let options: HashMap<String, String> = words
            .map(|word| {
                word.split_once('=')
                    .map_or((word.clone(), String::new()), |(k, v)| (k.trim().into(), v.trim().into()))
            })
            .collect();
        self.block = Some(match name.as_str() {
            "NODE" => Block::Nodes,
            "ELEMENT" => self.elements_of(options.get("TYPE").map_or("", String::as_str)),
            "PART" => {
                self.parts += 1;
                if self.parts > 1 {
                    self.report("one part (node numbers are repeated in each)", "a second *PART");
                }
                Block::Other
            }
            "INCLUDE" | "NGEN" | "NFILL" | "NCOPY" | "ELGEN" | "ELCOPY" => {
                self.report("all nodes and elements written out in this file", format!("*{name}"));
                Block::Other
            }
            _ => Block::Other,
        });
    }

    fn elements_of(&mut self, kind: &str) -> Block {
        if let Some(kind) = kind_of(kind) {
            return Block::Elements(kind, Vec::new());
        }
        let expected = "tetrahedra (C3D4, C3D10...), hexahedra (C3D8, C3D20...), wedges (C3D6, C3D15) or shells (S3, S4, \
                        STRI65, S8R)";
        self.report(expected, format!("element type {kind:?}"));
        Block::Other
    }

    fn data(&mut self, line: &str) {
        match self.block.take() {
            Some(Block::Nodes) => {
                self.node(line);
                self.block = Some(Block::Nodes);
            }
            Some(Block::Elements(kind, mut numbers)) => {
                numbers.extend(self.integers(line));
                if numbers.len() > kind.nodes {
                    self.elements.push((kind, std::mem::take(&mut numbers), self.number));
                }
                self.block = Some(Block::Elements(kind, numbers));
            }
            other => self.block = other,
        }
    }

    fn node(&mut self, line: &str) {
        let mut words = line.split(',').map(str::trim);
        let label = words.next().and_then(|word| word.parse::<u64>().ok());
        let mut point = [0.0; 3]; // coordinates left out are zero
        let mut fine = true;
        for value in &mut point {
            match words.next().filter(|word| !word.is_empty()).map(str::parse::<f64>) {
                Some(Ok(number)) if number.is_finite() => *value = number,
                Some(_) => fine = false,
                None => {}
            }
        }
        let Some(label) = label.filter(|_| fine) else {
            return self.report("a node number and up to three coordinates", line);
        };
        if self.place.insert(label, self.mesh.points.len() as u32).is_some() {
            self.report("every node once", format!("node {label} again"));
        }
        self.mesh.points.push(point);
        self.mesh.labels.push(label);
    }

    fn integers(&mut self, line: &str) -> Vec<u64> {
        let mut numbers = Vec::new();
        for word in line.split(',').map(str::trim).filter(|word| !word.is_empty()) {
            match word.parse() {
                Ok(number) => numbers.push(number),
                Err(_) => self.report("integers", word),
            }
        }
        numbers
    }

    /// Ends the element before a keyword; an incomplete one is an error.
    fn close_element(&mut self) {
        if let Some(Block::Elements(kind, numbers)) = self.block.take()
            && !numbers.is_empty()
        {
            self.report(format!("{} nodes", kind.nodes), numbers.len() - 1);
        }
    }

    fn finish(mut self) -> Result<AbaqusMesh, Vec<Diagnostic>> {
        self.close_element();
        for (kind, numbers, line) in std::mem::take(&mut self.elements) {
            self.number = line;
            self.element(kind, &numbers[1..]);
        }
        if self.mesh.points.is_empty() {
            self.diagnostics.push(Diagnostic::new("file", "a *NODE block", "none"));
        }
        if self.diagnostics.is_empty() { Ok(self.mesh) } else { Err(self.diagnostics) }
    }

    fn element(&mut self, kind: Kind, labels: &[u64]) {
        let missing = labels.iter().find(|label| !self.place.contains_key(label)).copied();
        if missing.is_some() || labels.len() != kind.nodes {
            let found = missing
                .map_or(format!("{} nodes", labels.len()), |label| format!("node {label}, which is nowhere"));
            return self.report(format!("{} nodes of the *NODE block", kind.nodes), found);
        }
        Cells::add(&mut self.mesh.blocks, kind, labels.iter().map(|label| self.place[label]));
    }
}
