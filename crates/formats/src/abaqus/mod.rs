//! Abaqus and CalculiX input files (`.inp`): nodes, tetrahedra, hexahedra, wedges, shells, named sets and surfaces.
//!
//! Applied: `*SYSTEM`, `*NODE, SYSTEM=C|S`, parts, instances with translation and rotation, `*INCLUDE` and `INPUT=`. Elements without
//! a body (springs, trusses, rigid faces, connectors) are left out and listed, as are keywords that change results.
//! Keywords that would change the mesh and are not applied are errors: generated nodes, other continuum elements, imperfections.
//! Materials, steps and the like are ignored.

mod placement;
mod sets;

use crate::cells::{Block as Cells, CellKind};
use crate::error::{Diagnostic, FormatError};
use crate::file;
use crate::mesh_file::Tri6;
use placement::{Coordinates, Placement};
use sets::Set;
use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};

/// Diagnostics after which reading stops.
const MAX_DIAGNOSTICS: usize = 50;
/// Files that may include each other.
const MAX_DEPTH: usize = 8;

/// Mesh of an input file. Indices are 0-based positions in `points`; node order within elements is VTK's, which is Abaqus' too for
/// these types.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AbaqusMesh {
    /// Node positions in the file's unit of length.
    pub points: Vec<[f64; 3]>,
    /// The file's node numbers; unique within an instance.
    pub labels: Vec<u64>,
    /// Names of the instances in upper case with the number of their nodes, in the order of `points`; one without a name for a
    /// file without parts.
    pub instances: Vec<(String, usize)>,
    /// Elements as VTK's cells, one block per kind.
    pub blocks: Vec<Cells>,
    /// Triangles of named surfaces and of sets of triangles, and outer faces between the nodes of sets.
    pub surfaces: BTreeMap<String, Vec<Tri6>>,
    /// Positions among the 10-node tetrahedra of the elements of named sets.
    pub volumes: BTreeMap<String, Vec<u32>>,
    /// The first instance that is rotated: whether results there are in its directions or the global ones, a table does not say.
    pub rotated: Option<String>,
    /// Elements and keywords that were left out, with the first line.
    pub left_out: Vec<String>,
}

/// Kind of cell of an element type. The letters behind the number of nodes change the formulation, not the shape.
fn kind_of(name: &str) -> Option<CellKind> {
    let body = name.strip_prefix("C3D").map(|rest| rest.trim_end_matches(|c: char| c.is_ascii_uppercase()));
    CellKind::of(match (body, name) {
        (Some("4"), _) => 10,
        (Some("10"), _) => 24,
        (Some("8"), _) => 12,
        (Some("20"), _) => 25,
        (Some("6"), _) => 13,
        (Some("15"), _) => 26,
        (_, "S3" | "S3R" | "S3RS" | "M3D3") => 5,
        (_, "S4" | "S4R" | "S4RS" | "S4R5" | "M3D4" | "M3D4R") => 9,
        // Gmsh writes the faces of a body as elements of plane stress.
        (_, "CPS3") => 5,
        (_, "STRI65" | "M3D6" | "CPS6") => 22,
        (_, "S8R" | "S8R5" | "M3D8" | "M3D8R") => 23,
        _ => return None,
    })
}

/// A body that would be missing in the mesh: a continuum element of another shape or dimension.
fn is_body(name: &str) -> bool {
    ["C3D", "CPE", "CPS", "CAX", "CCL", "SC6", "SC8", "CSS", "CIN", "EC3D", "PC3D"]
        .iter()
        .any(|start| name.starts_with(start))
}

/// Keywords that make or move nodes in ways that are not applied.
const REFUSED: [&str; 9] = [
    "NGEN",
    "NFILL",
    "NCOPY",
    "NMAP",
    "ELGEN",
    "ELCOPY",
    "IMPERFECTION",
    "IMPORT",
    "SYMMETRIC MODEL GENERATION",
];
/// Keywords that change results or nodes of an analysis, not the mesh as written.
const NAMED: [&str; 5] = ["TRANSFORM", "ORIENTATION", "ADJUST", "MODEL CHANGE", "INITIAL CONDITIONS"];
/// Distance of two places of one node that are equal, as a fraction of its coordinates.
const SAME: f64 = 1e-9;

/// Block of data lines.
enum Block {
    /// Lines without mesh data.
    Other,
    Nodes(Coordinates),
    /// Element lines, and the numbers of an incomplete element.
    Elements(CellKind, Vec<u64>),
    /// Lines of `*SYSTEM`.
    System(Vec<Vec<f64>>),
    /// Lines of an instance before its first keyword.
    Instance(Vec<Vec<f64>>),
    Set(Set),
}

/// Nodes and elements whose numbers belong together: of a part, an instance, or the whole file.
#[derive(Default)]
struct Scope {
    points: Vec<[f64; 3]>,
    labels: Vec<u64>,
    place: HashMap<u64, u32>,
    /// Kind, numbers with that of the element, place in the file.
    elements: Vec<(CellKind, Vec<u64>, String)>,
    sets: Vec<Set>,
}

struct Instance {
    name: String,
    part: String,
    placement: Placement,
    own: Scope,
    place: String,
}

/// Where nodes and elements go.
#[derive(Clone, PartialEq)]
enum Current {
    File,
    Part(String),
    Assembly,
    Instance,
}

/// Reads a file and those that it includes.
///
/// # Errors
/// I/O error, or all errors in the content.
pub fn read(path: &Path) -> Result<AbaqusMesh, FormatError> {
    let bytes = file::read_bytes(path, file::MAX_DATA_BYTES)?;
    run(&String::from_utf8_lossy(&bytes), Some(path))
        .map_err(|diagnostics| FormatError::Content { path: path.into(), diagnostics })
}

/// [`read`] from memory, where other files are refused. Cost and memory are linear in the text.
///
/// # Errors
/// All errors, with line numbers; never empty.
pub fn parse(text: &str) -> Result<AbaqusMesh, Vec<Diagnostic>> {
    run(text, None)
}

fn run(text: &str, path: Option<&Path>) -> Result<AbaqusMesh, Vec<Diagnostic>> {
    let mut reader = InpReader {
        path: path.map(Path::to_owned),
        files: Vec::new(),
        number: 0,
        file: Scope::default(),
        parts: BTreeMap::new(),
        instances: Vec::new(),
        current: Current::File,
        system: Placement::IDENTITY,
        block: Block::Other,
        set: None,
        assembly: Vec::new(),
        plane: None,
        left_out: BTreeMap::new(),
        diagnostics: Vec::new(),
    };
    reader.lines(text);
    reader.finish()
}

struct InpReader {
    /// The file; `None` if other files are refused.
    path: Option<PathBuf>,
    /// Names of the included files that are being read.
    files: Vec<String>,
    number: usize,
    file: Scope,
    parts: BTreeMap<String, Scope>,
    instances: Vec<Instance>,
    current: Current,
    system: Placement,
    block: Block,
    /// Set that the elements of the block belong to.
    set: Option<String>,
    assembly: Vec<Set>,
    /// First element of plane stress: a face of a body, or a part of a plane model.
    plane: Option<Diagnostic>,
    /// First place and count.
    left_out: BTreeMap<String, (String, usize)>,
    diagnostics: Vec<Diagnostic>,
}

impl InpReader {
    fn place(&self) -> String {
        let file = self.files.last().map_or(String::new(), |file| format!("{file}, "));
        format!("{file}line {}", self.number)
    }

    fn report(&mut self, expected: impl std::fmt::Display, found: impl std::fmt::Display) {
        self.diagnostics.push(Diagnostic::new(self.place(), expected, found));
    }

    fn leave_out(&mut self, what: String) {
        let place = self.place();
        self.left_out.entry(what).or_insert((place, 0)).1 += 1;
    }

    fn lines(&mut self, text: &str) {
        let mut lines = text.lines().enumerate();
        while let Some((number, line)) = lines.next() {
            self.number = number + 1;
            let line = line.trim();
            if line.is_empty() || line.starts_with("**") {
                continue;
            }
            let Some(keyword) = line.strip_prefix('*') else {
                self.data(line);
                continue;
            };
            let mut keyword = keyword.to_owned();
            while keyword.ends_with(',') {
                let Some((_, more)) = lines.next() else { break };
                keyword.push_str(more.trim());
            }
            self.keyword(&keyword);
            self.number = number + 1;
            if self.diagnostics.len() >= MAX_DIAGNOSTICS {
                break;
            }
        }
        if self.files.is_empty() {
            self.close();
        }
    }

    fn keyword(&mut self, text: &str) {
        self.close();
        let mut words = text.split(',').map(str::trim);
        let name = words.next().unwrap_or_default().to_ascii_uppercase();
        let options: HashMap<String, &str> = words
            .map(|word| word.split_once('=').unwrap_or((word, "")))
            .map(|(key, value)| (key.trim().to_ascii_uppercase(), value.trim().trim_matches('"')))
            .collect();
        let option = |key: &str| options.get(key).map(|value| value.to_ascii_uppercase());
        self.block = match name.as_str() {
            "NODE" => self.nodes_of(option("SYSTEM")),
            "ELEMENT" => {
                self.set = options.get("ELSET").map(|name| (*name).to_owned());
                self.elements_of(&option("TYPE").unwrap_or_default())
            }
            "ELSET" | "NSET" | "SURFACE" => Set::begun(&name, &options).map_or(Block::Other, Block::Set),
            "SYSTEM" => Block::System(Vec::new()),
            "PART" => {
                let part = option("NAME").unwrap_or_default();
                if self.parts.insert(part.clone(), Scope::default()).is_some() {
                    self.report("every part once", format!("*PART, NAME={part} again"));
                }
                self.enter(Current::Part(part))
            }
            "END PART" | "END ASSEMBLY" => self.enter(Current::File),
            "ASSEMBLY" | "END INSTANCE" => self.enter(Current::Assembly),
            "INSTANCE" => self.instance(option("NAME"), option("PART"), options.contains_key("LIBRARY")),
            _ => {
                if REFUSED.contains(&name.as_str()) {
                    self.report("all nodes and elements written out", format!("*{name}"));
                } else if NAMED.contains(&name.as_str()) {
                    self.leave_out(format!("*{name} is not applied"));
                }
                Block::Other
            }
        };
        let mesh = ["NODE", "ELEMENT", "INCLUDE"].contains(&name.as_str());
        if let Some(file) = options.get("INPUT").filter(|_| mesh) {
            self.include(file);
        } else if name == "INCLUDE" {
            self.report("*INCLUDE, INPUT=FILE", "no INPUT");
        }
    }

    fn enter(&mut self, current: Current) -> Block {
        (self.current, self.system) = (current, Placement::IDENTITY);
        Block::Other
    }

    fn include(&mut self, name: &str) {
        let Some(path) = &self.path else {
            return self.report("all nodes and elements written out", format!("INPUT={name}"));
        };
        if self.files.len() >= MAX_DEPTH {
            return self.report(
                format!("at most {MAX_DEPTH} files that include each other"),
                format!("INPUT={name}"),
            );
        }
        match file::read_bytes(&file::named_in(path, name), file::MAX_DATA_BYTES) {
            Ok(bytes) => {
                let number = self.number;
                self.files.push(name.into());
                self.lines(&String::from_utf8_lossy(&bytes));
                self.files.pop();
                self.number = number;
            }
            Err(FormatError::Io { source, .. }) => {
                self.report(format!("a readable file INPUT={name}"), source);
            }
            Err(error) => self.report(format!("a readable file INPUT={name}"), error),
        }
    }

    fn nodes_of(&mut self, system: Option<String>) -> Block {
        Block::Nodes(match system.as_deref() {
            None | Some("R") => Coordinates::Rectangular,
            Some("C") => Coordinates::Cylindrical,
            Some("S") => Coordinates::Spherical,
            Some(other) => {
                self.report("SYSTEM=R, C or S", format!("SYSTEM={other}"));
                return Block::Other;
            }
        })
    }

    fn elements_of(&mut self, kind: &str) -> Block {
        if kind.starts_with("CPS") && self.plane.is_none() {
            let expected = "a body: tetrahedra with their faces as elements of plane stress, not those alone";
            self.plane = Some(Diagnostic::new(self.place(), expected, format!("element type {kind:?}")));
        }
        if let Some(kind) = kind_of(kind) {
            if self.current == Current::Assembly {
                self.report("elements of parts and instances", "elements of the assembly");
            }
            return Block::Elements(kind, Vec::new());
        }
        if kind.is_empty() || is_body(kind) {
            let expected = "tetrahedra (C3D4, C3D10...), hexahedra (C3D8, C3D20...), wedges (C3D6, C3D15) or shells (S3, S4, \
                            STRI65, S8R)";
            self.report(expected, format!("element type {kind:?}"));
        } else {
            self.leave_out(format!("elements of type {kind}"));
        }
        Block::Other
    }

    fn instance(&mut self, name: Option<String>, part: Option<String>, library: bool) -> Block {
        if library {
            self.report("parts of this file", "*INSTANCE, LIBRARY=");
        }
        let (name, part) = (name.unwrap_or_default(), part.unwrap_or_default());
        if self.instances.iter().any(|instance| instance.name == name) {
            self.report("every instance once", format!("*INSTANCE, NAME={name} again"));
        }
        let place = self.place();
        let (own, placement) = (Scope::default(), Placement::IDENTITY);
        self.instances.push(Instance { name, part, placement, own, place });
        self.enter(Current::Instance);
        Block::Instance(Vec::new())
    }

    fn data(&mut self, line: &str) {
        let mut block = std::mem::replace(&mut self.block, Block::Other);
        match &mut block {
            Block::Other => {}
            Block::Nodes(coordinates) => self.node(line, *coordinates),
            Block::Elements(kind, numbers) => {
                for word in line.split(',').map(str::trim).filter(|word| !word.is_empty()) {
                    match word.parse() {
                        Ok(number) => numbers.push(number),
                        Err(_) => self.report("integers", word),
                    }
                }
                if numbers.len() > kind.nodes {
                    let (label, set) = (numbers[0].to_string(), self.set.clone());
                    let element = (*kind, std::mem::take(numbers), self.place());
                    if let Some(scope) = self.scope() {
                        scope.elements.push(element);
                        sets::include(&mut scope.sets, set, label);
                    }
                }
            }
            Block::Set(set) => set.add(line),
            Block::System(lines) | Block::Instance(lines) => lines.push(self.numbers(line)),
        }
        self.block = block;
    }

    /// Where nodes and elements go; those of an assembly itself (reference points) belong to no body.
    fn scope(&mut self) -> Option<&mut Scope> {
        match &self.current {
            Current::File => Some(&mut self.file),
            Current::Part(name) => self.parts.get_mut(name),
            Current::Assembly => None,
            Current::Instance => self.instances.last_mut().map(|instance| &mut instance.own),
        }
    }

    fn node(&mut self, line: &str, coordinates: Coordinates) {
        let mut words = line.split(',').map(str::trim);
        let label = words.next().and_then(|word| word.parse::<u64>().ok());
        let mut point = [0.0; 3]; // coordinates left out are zero
        let mut fine = true;
        for value in &mut point {
            match words.next().filter(|word| !word.is_empty()).map(number) {
                Some(Some(number)) => *value = number,
                Some(None) => fine = false,
                None => {}
            }
        }
        let Some(label) = label.filter(|_| fine) else {
            return self.report("a node number and up to three coordinates", line);
        };
        let point = self.system.apply(coordinates.rectangular(point));
        let Some(scope) = self.scope() else { return };
        if let Some(known) = scope.place.get(&label) {
            let known = scope.points[*known as usize];
            let largest = point.iter().fold(0.0_f64, |largest, value| largest.max(value.abs()));
            if (0..3).any(|k| (known[k] - point[k]).abs() > SAME * largest) {
                self.report("every node once", format!("node {label} again, which was at {known:?}"));
            }
            return;
        }
        scope.place.insert(label, scope.points.len() as u32);
        scope.points.push(point);
        scope.labels.push(label);
    }

    /// Numbers of a line; one left out is zero.
    fn numbers(&mut self, line: &str) -> Vec<f64> {
        let line = line.trim_end_matches([',', ' ', '\t']);
        let mut numbers = Vec::new();
        for word in line.split(',').map(str::trim) {
            match number(if word.is_empty() { "0" } else { word }) {
                Some(number) => numbers.push(number),
                None => self.report("finite numbers", word),
            }
        }
        numbers
    }

    /// Ends a block before a keyword.
    fn close(&mut self) {
        match std::mem::replace(&mut self.block, Block::Other) {
            Block::Elements(kind, numbers) if !numbers.is_empty() => {
                self.report(format!("{} nodes", kind.nodes), numbers.len() - 1);
            }
            Block::System(lines) => match Placement::system(&lines) {
                Some(system) => self.system = system,
                None => self.report(
                    "*SYSTEM with an origin, a point on the local x axis and one in the local xy plane",
                    format!("{lines:?}"),
                ),
            },
            Block::Instance(lines) => match (Placement::instance(&lines), self.instances.last_mut()) {
                (Some(placement), Some(instance)) => instance.placement = placement,
                _ => self.report(
                    "*INSTANCE with a translation (3 numbers) and a rotation (two points of its axis and degrees)",
                    format!("{lines:?}"),
                ),
            },
            Block::Set(set) => match self.scope() {
                Some(scope) => scope.sets.push(set),
                None => self.assembly.push(set),
            },
            _ => {}
        }
    }

    fn finish(mut self) -> Result<AbaqusMesh, Vec<Diagnostic>> {
        let mut mesh = AbaqusMesh {
            left_out: self
                .left_out
                .iter()
                .map(|(what, (place, count))| match count {
                    1 => format!("{what} ({place})"),
                    count => format!("{what} ({count} times, first {place})"),
                })
                .collect(),
            ..AbaqusMesh::default()
        };
        let file = std::mem::take(&mut self.file);
        let instances = std::mem::take(&mut self.instances);
        if instances.is_empty() && self.parts.len() > 1 {
            let found = format!("{} parts without *INSTANCE", self.parts.len());
            self.diagnostics.push(Diagnostic::new("file", "one part, or an assembly of instances", found));
        }
        if !file.points.is_empty() || !file.elements.is_empty() {
            self.place_scope(&mut mesh, "", &file, Placement::IDENTITY);
        }
        let parts = std::mem::take(&mut self.parts);
        if let (true, Some((name, part))) = (instances.is_empty(), parts.first_key_value()) {
            self.place_scope(&mut mesh, name, part, Placement::IDENTITY);
        }
        for Instance { name, part, placement, own, place } in &instances {
            if placement.rows != Placement::IDENTITY.rows && mesh.rotated.is_none() {
                mesh.rotated = Some(format!("{place}, *INSTANCE, NAME={name}"));
            }
            match parts.get(part) {
                Some(part) => self.place_scope(&mut mesh, name, part, *placement),
                None if own.points.is_empty() => {
                    self.diagnostics.push(Diagnostic::new(
                        place,
                        "a *PART of the instance",
                        format!("PART={part}"),
                    ));
                }
                None => {}
            }
            if !own.points.is_empty() {
                self.place_scope(&mut mesh, name, own, *placement);
            }
        }
        let solid = |block: &Cells| CellKind::of(block.kind.into()).is_some_and(|kind| kind.is_solid);
        if !mesh.blocks.iter().any(solid) {
            self.diagnostics.extend(self.plane.take());
        }
        if mesh.points.is_empty() {
            self.diagnostics.push(Diagnostic::new("file", "a *NODE block", "none"));
        }
        if self.diagnostics.is_empty() { Ok(mesh) } else { Err(self.diagnostics) }
    }

    fn place_scope(&mut self, mesh: &mut AbaqusMesh, name: &str, scope: &Scope, placement: Placement) {
        let first = mesh.points.len() as u32;
        mesh.points.extend(scope.points.iter().map(|point| placement.apply(*point)));
        mesh.labels.extend(&scope.labels);
        mesh.instances.push((name.into(), scope.points.len()));
        let mut known: HashMap<u64, (&[u64], &str)> = HashMap::new();
        let is_of_instance =
            |set: &&Set| set.instance.as_ref().is_none_or(|instance| instance.eq_ignore_ascii_case(name));
        let sets: Vec<&Set> = scope.sets.iter().chain(self.assembly.iter().filter(is_of_instance)).collect();
        let mut elements = HashMap::new();
        for (kind, numbers, place) in &scope.elements {
            if let Some((earlier, at)) = known.insert(numbers[0], (&numbers[1..], place.as_str())) {
                if *earlier != numbers[1..] {
                    let found = format!("element {} with other nodes, first at {at}", numbers[0]);
                    self.diagnostics.push(Diagnostic::new(place, "every element once", found));
                }
                continue;
            }
            let nodes: Vec<Option<u32>> =
                numbers[1..].iter().map(|label| scope.place.get(label).copied()).collect();
            let missing = nodes.iter().position(Option::is_none);
            if missing.is_some() || nodes.len() != kind.nodes {
                let found = missing.map_or(format!("{} nodes", nodes.len()), |at| {
                    format!("node {}, which is nowhere", numbers[1 + at])
                });
                let expected = format!("{} nodes of the *NODE block", kind.nodes);
                self.diagnostics.push(Diagnostic::new(place, expected, found));
                continue;
            }
            let nodes: Vec<u32> = nodes.into_iter().flatten().map(|node| first + node).collect();
            Cells::add(&mut mesh.blocks, *kind, nodes.iter().copied());
            if !sets.is_empty() {
                let count =
                    mesh.blocks.iter().find(|block| block.kind == kind.number).map_or(0, Cells::count);
                elements.insert(numbers[0], (kind.number, count as u32 - 1, nodes));
            }
        }
        let nodes = scope.place.iter().map(|(label, at)| (*label, first + at)).collect();
        sets::resolve(&sets, &elements, &nodes, &mut mesh.surfaces, &mut mesh.volumes);
    }
}

/// A finite number, also with Fortran's exponent (`1.5D-3`).
fn number(word: &str) -> Option<f64> {
    let plain = word.parse().ok().or_else(|| word.replace(['d', 'D'], "e").parse().ok());
    plain.filter(|number: &f64| number.is_finite())
}
