//! Abaqus input files (`.inp`): nodes, tetrahedra, hexahedra, wedges, shells, node sets.
//!
//! Only the mesh is read; materials, steps and the like are passed over. An element type that is not known is refused by
//! its name, and so is what would change the meaning of node numbers: a second part, `*INCLUDE`, generated nodes.

use crate::cells::{Block as Cells, Kind as Shape};
use crate::error::{Diagnostic, FormatError};
use crate::file;
use crate::mesh_file::MeshFile;
use std::collections::{BTreeMap, HashMap};
use std::path::Path;

/// Diagnostics after which reading stops: a file of another kind has one in every line.
const MAX_DIAGNOSTICS: usize = 50;
/// Largest step count of a `GENERATE` line; real sets stay far below, and a typing error must not fill the memory.
const MAX_GENERATED: u64 = 10_000_000;

/// The mesh of an input file. Indices are 0-based positions in `points`; node order within elements is VTK's, which is
/// Abaqus' own for these types.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AbaqusMesh {
    /// Node positions in the file's unit of length.
    pub points: Vec<[f64; 3]>,
    /// The file's node numbers.
    pub labels: Vec<u64>,
    /// 10-node tetrahedra (`C3D10` and its variants).
    pub tets: Vec<[u32; 10]>,
    /// 20-node hexahedra (`C3D20` and its variants).
    pub hexahedra: Vec<[u32; 20]>,
    /// First-order solids and wedges, by VTK's number of the kind.
    pub others: BTreeMap<u8, Vec<u32>>,
    /// Shells and membranes: 3, 4, 6 or 8 nodes each.
    pub shells: Vec<Vec<u32>>,
    /// Named node sets, ascending.
    pub node_sets: BTreeMap<String, Vec<u32>>,
}

impl AbaqusMesh {
    /// The body alone; shells have no volume and are passed over.
    ///
    /// # Errors
    /// A mesh that holds hexahedra, or no tetrahedra at all.
    pub fn tetrahedra(self) -> Result<MeshFile, Diagnostic> {
        if self.tets.is_empty() || !self.hexahedra.is_empty() || !self.others.is_empty() {
            let (tets, hexahedra) = (self.tets.len(), self.hexahedra.len());
            let found =
                format!("{tets} tetrahedra, {hexahedra} hexahedra and {} other kinds", self.others.len());
            return Err(Diagnostic::new("elements", "10-node tetrahedra only (C3D10...)", found));
        }
        Ok(MeshFile { points_mm: self.points, tets: self.tets, ..MeshFile::default() })
    }

    /// All elements as VTK's cells, one block a kind.
    pub fn blocks(&self) -> Vec<Cells> {
        let mut blocks = vec![
            Cells { kind: 24, nodes_per_cell: 10, nodes: self.tets.as_flattened().to_vec() },
            Cells { kind: 25, nodes_per_cell: 20, nodes: self.hexahedra.as_flattened().to_vec() },
        ];
        for (kind, nodes) in &self.others {
            let nodes_per_cell = Shape::of((*kind).into()).map_or(1, |shape| shape.nodes);
            blocks.push(Cells { kind: *kind, nodes_per_cell, nodes: nodes.clone() });
        }
        for (nodes_per_cell, kind) in [(3, 5), (4, 9), (6, 22), (8, 23)] {
            let cells = self.shells.iter().filter(|shell| shell.len() == nodes_per_cell);
            blocks.push(Cells { kind, nodes_per_cell, nodes: cells.flatten().copied().collect() });
        }
        blocks.retain(|block| !block.nodes.is_empty());
        blocks
    }
}

/// What an element type is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Tetrahedron,
    Hexahedron,
    /// VTK's number and nodes.
    Other(u8, usize),
    Shell(usize),
}

impl Kind {
    fn of(name: &str) -> Option<Self> {
        match name {
            "C3D10" | "C3D10H" | "C3D10M" | "C3D10MH" | "C3D10HS" => Some(Self::Tetrahedron),
            "C3D20" | "C3D20H" | "C3D20R" | "C3D20RH" => Some(Self::Hexahedron),
            "C3D4" | "C3D4H" => Some(Self::Other(10, 4)),
            "C3D6" | "C3D6H" => Some(Self::Other(13, 6)),
            "C3D8" | "C3D8H" | "C3D8I" | "C3D8IH" | "C3D8R" | "C3D8RH" => Some(Self::Other(12, 8)),
            "C3D15" | "C3D15H" => Some(Self::Other(26, 15)),
            "S3" | "S3R" | "S3RS" | "M3D3" => Some(Self::Shell(3)),
            "S4" | "S4R" | "S4RS" | "S4R5" | "M3D4" | "M3D4R" => Some(Self::Shell(4)),
            "STRI65" | "M3D6" => Some(Self::Shell(6)),
            "S8R" | "S8R5" | "M3D8" | "M3D8R" => Some(Self::Shell(8)),
            _ => None,
        }
    }

    fn nodes(self) -> usize {
        match self {
            Self::Tetrahedron => 10,
            Self::Hexahedron => 20,
            Self::Shell(nodes) | Self::Other(_, nodes) => nodes,
        }
    }
}

/// The block that data lines belong to.
enum Block {
    /// Lines that are not the mesh's.
    Other,
    /// Node lines, also collected into a set when one is named.
    Nodes(Option<String>),
    /// Element lines and the numbers of the element begun.
    Elements(Kind, Vec<u64>),
    /// Members of a node set; with `GENERATE`: first, last, step.
    Set { name: String, generate: bool },
}

/// Reads a file.
///
/// # Errors
/// The operating system's refusal, or everything that is wrong with the content.
pub fn read(path: &Path) -> Result<AbaqusMesh, FormatError> {
    let bytes = file::read_bytes(path, file::MAX_DATA_BYTES)?;
    parse(&String::from_utf8_lossy(&bytes))
        .map_err(|diagnostics| FormatError::Content { path: path.into(), diagnostics })
}

/// [`read`] from memory. Cost and memory are linear in the text.
///
/// # Errors
/// Everything that is wrong, with line numbers; never empty.
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
    sets: BTreeMap<String, Vec<u64>>,
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
            "NODE" => Block::Nodes(options.get("NSET").cloned()),
            "ELEMENT" => self.elements_of(options.get("TYPE").map_or("", String::as_str)),
            "NSET" => Block::Set {
                name: options.get("NSET").cloned().unwrap_or_default(),
                generate: options.contains_key("GENERATE"),
            },
            "PART" => {
                self.parts += 1;
                if self.parts > 1 {
                    self.report("one part (node numbers begin anew in each)", "a second *PART");
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
        if let Some(kind) = Kind::of(kind) {
            return Block::Elements(kind, Vec::new());
        }
        let expected = "tetrahedra (C3D4, C3D10...), hexahedra (C3D8, C3D20...), wedges (C3D6, C3D15) or shells (S3, S4, \
                        STRI65, S8R)";
        self.report(expected, format!("element type {kind:?}"));
        Block::Other
    }

    fn data(&mut self, line: &str) {
        match self.block.take() {
            Some(Block::Nodes(set)) => {
                self.node(line, set.as_deref());
                self.block = Some(Block::Nodes(set));
            }
            Some(Block::Elements(kind, mut numbers)) => {
                numbers.extend(self.integers(line));
                if numbers.len() > kind.nodes() {
                    self.elements.push((kind, std::mem::take(&mut numbers), self.number));
                }
                self.block = Some(Block::Elements(kind, numbers));
            }
            Some(Block::Set { name, generate }) => {
                self.members(line, &name, generate);
                self.block = Some(Block::Set { name, generate });
            }
            other => self.block = other,
        }
    }

    fn node(&mut self, line: &str, set: Option<&str>) {
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
        if let Some(set) = set {
            self.sets.entry(set.to_owned()).or_default().push(label);
        }
    }

    fn integers(&mut self, line: &str) -> Vec<u64> {
        let mut numbers = Vec::new();
        for word in line.split(',').map(str::trim).filter(|word| !word.is_empty()) {
            match word.parse() {
                Ok(number) => numbers.push(number),
                Err(_) => self.report("whole numbers", word),
            }
        }
        numbers
    }

    fn members(&mut self, line: &str, name: &str, generate: bool) {
        let is_number = |word: &str| word.trim().bytes().all(|byte| byte.is_ascii_digit());
        if !generate && !line.split(',').all(is_number) {
            return; // the name of another set: sets of sets are not needed for a mesh
        }
        let numbers = self.integers(line);
        let members: Vec<u64> = match numbers.as_slice() {
            [first, last, rest @ ..] if generate => {
                let step = rest.first().copied().unwrap_or(1).max(1);
                if last.saturating_sub(*first) / step > MAX_GENERATED {
                    return self.report(format!("at most {MAX_GENERATED} generated nodes"), line);
                }
                (*first..=*last).step_by(step as usize).collect()
            }
            _ => numbers,
        };
        self.sets.entry(name.to_owned()).or_default().extend(members);
    }

    /// A keyword ends the element before it, complete or not.
    fn close_element(&mut self) {
        if let Some(Block::Elements(kind, numbers)) = self.block.take()
            && !numbers.is_empty()
        {
            self.report(format!("{} nodes", kind.nodes()), numbers.len() - 1);
        }
    }

    fn finish(mut self) -> Result<AbaqusMesh, Vec<Diagnostic>> {
        self.close_element();
        for (kind, numbers, line) in std::mem::take(&mut self.elements) {
            self.number = line;
            self.element(kind, &numbers[1..]);
        }
        for (name, labels) in std::mem::take(&mut self.sets) {
            let mut nodes: Vec<u32> =
                labels.iter().filter_map(|label| self.place.get(label).copied()).collect();
            nodes.sort_unstable();
            nodes.dedup();
            self.mesh.node_sets.insert(name, nodes);
        }
        if self.mesh.points.is_empty() {
            self.diagnostics.push(Diagnostic::new("file", "a *NODE block", "none"));
        }
        if self.diagnostics.is_empty() { Ok(self.mesh) } else { Err(self.diagnostics) }
    }

    fn element(&mut self, kind: Kind, labels: &[u64]) {
        let missing = labels.iter().find(|label| !self.place.contains_key(label)).copied();
        if missing.is_some() || labels.len() != kind.nodes() {
            let found = missing
                .map_or(format!("{} nodes", labels.len()), |label| format!("node {label}, which is nowhere"));
            return self.report(format!("{} nodes of the *NODE block", kind.nodes()), found);
        }
        let nodes: Vec<u32> = labels.iter().map(|label| self.place[label]).collect();
        match kind {
            Kind::Tetrahedron => self.mesh.tets.push(std::array::from_fn(|k| nodes[k])),
            Kind::Hexahedron => self.mesh.hexahedra.push(std::array::from_fn(|k| nodes[k])),
            Kind::Other(kind, _) => self.mesh.others.entry(kind).or_default().extend(nodes),
            Kind::Shell(_) => self.mesh.shells.push(nodes),
        }
    }
}
