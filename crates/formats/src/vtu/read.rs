//! Reader: one piece of 10-node tetrahedra, or of any cells with quantities at their nodes; arrays in ASCII, base64 or raw appended, plain or zlib, either byte order.

use super::codec::{self, Coding, Element};
use crate::cells::{Block, Kind};
use crate::error::{Diagnostic, FormatError};
use crate::file;
use crate::mesh_file::{MeshFile, Tri6};
use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};
use std::collections::{BTreeMap, HashMap};
use std::path::Path;

const POINTS: [usize; 2] = [1, 2];
/// Lines: trusses, beams, springs.
const LINES: [usize; 3] = [3, 4, 21];
/// Largest number of nodes of a cell: the triquadratic hexahedron.
const MAX_NODES: usize = 27;

/// Reads nodes and 10-node tetrahedra; VTK's node order is the project's. An integer array of the cells (`gmsh:physical`, `group`, or
/// the only one) groups tetrahedra into volumes and 6-node triangles into surfaces, named by its numbers.
///
/// # Errors
/// I/O error, or all errors in the content.
pub fn read(path: &Path) -> Result<MeshFile, FormatError> {
    let bytes = file::read_bytes(path, file::MAX_DATA_BYTES)?;
    parse(&bytes).map_err(|diagnostics| FormatError::Content { path: path.into(), diagnostics })
}

/// [`read`] from memory. Cost and memory are linear in the bytes given (zlib expands them at most a thousandfold).
///
/// # Errors
/// All errors in the content; never empty.
pub fn parse(bytes: &[u8]) -> Result<MeshFile, Vec<Diagnostic>> {
    let file = File::scan(bytes).map_err(|diagnostic| vec![diagnostic])?;
    let raw = Raw::decode(&file)?;
    let (blocks, _) = raw.blocks()?;
    let groups = file.groups().map_err(|diagnostic| vec![diagnostic])?;
    let (volumes, surfaces) = raw.grouped(&groups);
    let mesh = MeshFile::of_solids(raw.points, &blocks).map_err(|diagnostic| vec![diagnostic])?;
    Ok(MeshFile { surfaces, volumes, ..mesh })
}

/// Mesh of a file and quantities at its nodes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Content {
    /// Node positions in the file's unit.
    pub points: Vec<[f64; 3]>,
    /// Cells; points and lines are ignored.
    pub blocks: Vec<Block>,
    /// Numeric quantities at the nodes.
    pub point_data: Vec<Quantity>,
    /// Cells that were left out.
    pub left_out: Vec<String>,
    /// Time in the file (`TimeValue`).
    pub time: Option<f64>,
}

/// Quantity at the nodes.
#[derive(Clone, Debug, PartialEq)]
pub struct Quantity {
    /// Name in the file.
    pub name: String,
    /// Values per node.
    pub components: usize,
    /// `nodes x components`.
    pub values: Vec<f64>,
}

/// Reads cells of all kinds of [`crate::cells::KINDS`] and the quantities at the nodes.
///
/// # Errors
/// As [`read`].
pub fn read_content(path: &Path) -> Result<Content, FormatError> {
    let bytes = file::read_bytes(path, file::MAX_DATA_BYTES)?;
    parse_content(&bytes).map_err(|diagnostics| FormatError::Content { path: path.into(), diagnostics })
}

/// [`read_content`] from memory; cost as [`parse`].
///
/// # Errors
/// All errors in the content; never empty.
pub fn parse_content(bytes: &[u8]) -> Result<Content, Vec<Diagnostic>> {
    let file = File::scan(bytes).map_err(|diagnostic| vec![diagnostic])?;
    let raw = Raw::decode(&file)?;
    let (blocks, left_out) = raw.blocks()?;
    let mut diagnostics = Vec::new();
    let mut point_data = Vec::new();
    for (name, components, array) in &file.point_data {
        let expected = file.points.saturating_mul(*components);
        match file.decode(name, array, expected) {
            Ok(values) => point_data.push(Quantity { name: name.clone(), components: *components, values }),
            Err(diagnostic) => diagnostics.push(diagnostic),
        }
    }
    let time = file.arrays.get("TimeValue").and_then(|array| file.decode("TimeValue", array, 1).ok());
    let time = time.and_then(|v| v.first().copied());
    let content = Content { points: raw.points, blocks, point_data, left_out, time };
    if diagnostics.is_empty() { Ok(content) } else { Err(diagnostics) }
}

/// Mesh in the arrays of the file.
struct Raw {
    points: Vec<[f64; 3]>,
    types: Vec<f64>,
    offsets: Vec<f64>,
    connectivity: Vec<f64>,
}

impl Raw {
    fn decode(file: &File<'_>) -> Result<Self, Vec<Diagnostic>> {
        let mut diagnostics = Vec::new();
        let mut array = |name: &str, expected: usize| match file.array(name, expected) {
            Ok(values) => values,
            Err(diagnostic) => {
                diagnostics.push(diagnostic);
                Vec::new()
            }
        };
        let points = array("Points", file.points.saturating_mul(3));
        let types = array("types", file.cells);
        let offsets = array("offsets", file.cells);
        let entries = offsets.last().map_or(0, |last| *last as usize);
        let connectivity = if entries <= file.cells.saturating_mul(MAX_NODES) {
            array("connectivity", entries)
        } else {
            let expected = format!("at most {MAX_NODES} nodes for each of {} cells", file.cells);
            diagnostics.push(Diagnostic::new("offsets", expected, entries));
            Vec::new()
        };
        if !diagnostics.is_empty() {
            return Err(diagnostics);
        }
        let points: Vec<[f64; 3]> = points.as_chunks::<3>().0.to_vec();
        if let Some(bad) = points.iter().position(|p| p.iter().any(|v| !v.is_finite())) {
            let place = format!("Points, node {bad}");
            return Err(vec![Diagnostic::new(place, "finite numbers", "NaN or infinity")]);
        }
        Ok(Self { points, types, offsets, connectivity })
    }

    /// Cells by kind, in the order of the file, and what was left out.
    fn blocks(&self) -> Result<(Vec<Block>, Vec<String>), Vec<Diagnostic>> {
        let (mut blocks, mut start, mut lines): (Vec<Block>, usize, usize) = (Vec::new(), 0, 0);
        for (cell, (number, end)) in self.types.iter().zip(&self.offsets).enumerate() {
            let place = || format!("cell {cell}");
            let members = self.connectivity.get(start..*end as usize).ok_or_else(|| {
                vec![Diagnostic::new(format!("offsets, cell {cell}"), "rising offsets", end)]
            })?;
            start = *end as usize;
            lines += usize::from(LINES.contains(&(*number as usize)));
            if LINES.contains(&(*number as usize)) || POINTS.contains(&(*number as usize)) {
                continue;
            }
            let kind =
                Kind::of(*number as usize).filter(|kind| kind.nodes == members.len()).ok_or_else(|| {
                    let found = format!("type {number} with {} nodes", members.len());
                    let expected =
                        "linear or quadratic tetrahedra, hexahedra, wedges, triangles or quadrilaterals";
                    vec![Diagnostic::new(place(), expected, found)]
                })?;
            let points = self.points.len();
            if let Some(bad) = members.iter().find(|n| !(**n >= 0.0 && (**n as usize) < points)) {
                return Err(vec![Diagnostic::new(place(), format!("nodes 0 .. {points}"), bad)]);
            }
            Block::add(&mut blocks, kind, members.iter().map(|node| *node as u32));
        }
        Ok((
            blocks,
            if lines > 0 { vec![format!("{lines} lines (cells of type 3, 4 or 21)")] } else { Vec::new() },
        ))
    }
}

/// Elements and triangles by the number of their group.
type Grouped = (BTreeMap<String, Vec<u32>>, BTreeMap<String, Vec<Tri6>>);

impl Raw {
    /// Tetrahedra and triangles of each group; `groups` has one number per cell, or none.
    fn grouped(&self, groups: &[f64]) -> Grouped {
        let (mut volumes, mut surfaces) = Grouped::default();
        let (mut start, mut tets) = (0, 0);
        for ((kind, end), group) in self.types.iter().zip(&self.offsets).zip(groups) {
            let members = &self.connectivity[start..*end as usize];
            start = *end as usize;
            let name = || format!("{group}");
            match *kind as usize {
                24 => {
                    volumes.entry(name()).or_default().push(tets);
                    tets += 1;
                }
                22 => {
                    let triangle = std::array::from_fn(|k| members.get(k).map_or(0, |n| *n as u32));
                    surfaces.entry(name()).or_default().push(triangle);
                }
                _ => {}
            }
        }
        (volumes, surfaces)
    }
}

/// Place of an array's data.
enum Place<'a> {
    Ascii(&'a [u8]),
    Inline(&'a [u8]),
    Appended(usize),
}

struct Array<'a> {
    element: Element,
    place: Place<'a>,
}

/// Appended section, from the byte after its underscore.
struct Appended<'a> {
    data: &'a [u8],
    base64: bool,
}

/// Content of the XML, before any array is decoded.
struct File<'a> {
    coding: Coding,
    points: usize,
    cells: usize,
    arrays: HashMap<String, Array<'a>>,
    /// Name, values per node and place of the quantities at the nodes.
    point_data: Vec<(String, usize, Array<'a>)>,
    /// Integer arrays of the cells.
    cell_data: Vec<(String, Array<'a>)>,
    appended: Option<Appended<'a>>,
}

impl<'a> File<'a> {
    /// Reads the XML in one pass, which ends at raw appended data.
    fn scan(bytes: &'a [u8]) -> Result<Self, Diagnostic> {
        let mut file = Self {
            coding: Coding { big_endian: false, long_header: false, zlib: false },
            points: 0,
            cells: 0,
            arrays: HashMap::new(),
            point_data: Vec::new(),
            cell_data: Vec::new(),
            appended: None,
        };
        let mut reader = Reader::from_reader(bytes);
        let (mut pieces, mut is_vtk, mut section) = (0, false, String::new());
        loop {
            let place = |reader: &Reader<&[u8]>| format!("byte {}", reader.buffer_position());
            let event =
                reader.read_event().map_err(|e| Diagnostic::new(place(&reader), "well-formed XML", e))?;
            let (tag, empty) = match &event {
                Event::Start(tag) => (tag, false),
                Event::Empty(tag) => (tag, true),
                Event::Eof => break,
                _ => continue,
            };
            match tag.name().as_ref() {
                b"VTKFile" => {
                    is_vtk = true;
                    file.coding = coding(tag)?;
                }
                b"Piece" => {
                    pieces += 1;
                    file.points = count(tag, "NumberOfPoints")?;
                    file.cells = count(tag, "NumberOfCells")?;
                }
                b"Points" | b"Cells" | b"PointData" | b"CellData" | b"FieldData" => {
                    section = String::from_utf8_lossy(tag.name().as_ref()).into_owned();
                }
                b"DataArray" if section == "Points" || section == "Cells" => {
                    let from = reader.buffer_position() as usize;
                    let (name, array) =
                        file.data_array(tag, &section, if empty { &[] } else { &bytes[from..] })?;
                    file.arrays.insert(name, array);
                }
                b"DataArray" if section == "PointData" || section == "FieldData" => {
                    let from = reader.buffer_position() as usize;
                    // Text and other arrays without numbers are not asked for.
                    let array = file.data_array(tag, &section, if empty { &[] } else { &bytes[from..] });
                    let components = attribute(tag, "NumberOfComponents").and_then(|n| n.parse().ok());
                    match array {
                        Ok((name, array)) if section == "PointData" => {
                            file.point_data.push((name, components.unwrap_or(1), array));
                        }
                        Ok((name, array)) if name == "TimeValue" => drop(file.arrays.insert(name, array)),
                        _ => {}
                    }
                }
                b"DataArray" if section == "CellData" => {
                    let from = reader.buffer_position() as usize;
                    let rest = if empty { &[] } else { &bytes[from..] };
                    let is_integer = attribute(tag, "type").is_some_and(|kind| kind.contains("Int"));
                    let single = attribute(tag, "NumberOfComponents").is_none_or(|n| n == "1");
                    if let (true, Ok(array)) = (is_integer && single, file.data_array(tag, &section, rest)) {
                        file.cell_data.push(array);
                    }
                }
                b"AppendedData" => {
                    let from = reader.buffer_position() as usize;
                    file.appended = Some(appended(tag, &bytes[from..])?);
                    break;
                }
                _ => {}
            }
        }
        match (is_vtk, pieces) {
            (false, _) => Err(Diagnostic::new("root element", "VTKFile", "another document")),
            (_, 1) => Ok(file),
            _ => Err(Diagnostic::new("Piece", "one piece (merge the pieces and save again)", pieces)),
        }
    }

    fn data_array(
        &self,
        tag: &BytesStart,
        section: &str,
        rest: &'a [u8],
    ) -> Result<(String, Array<'a>), Diagnostic> {
        // Within Points the single array may have any name.
        let name =
            if section == "Points" { section.into() } else { attribute(tag, "Name").unwrap_or_default() };
        let kind = attribute(tag, "type").unwrap_or_default();
        let element = Element::named(&kind).ok_or_else(|| {
            Diagnostic::new(format!("DataArray {name}"), "a VTK number type", format!("`{kind}`"))
        })?;
        let text = &rest[..rest.iter().position(|b| *b == b'<').unwrap_or(rest.len())];
        let format = attribute(tag, "format").unwrap_or_else(|| "ascii".into());
        let place = match format.as_str() {
            "ascii" => Place::Ascii(text),
            "binary" => Place::Inline(text),
            "appended" => Place::Appended(count(tag, "offset")?),
            _ => {
                let found = format!("`{format}`");
                return Err(Diagnostic::new(format!("DataArray {name}"), "ascii, binary or appended", found));
            }
        };
        Ok((name, Array { element, place }))
    }

    /// Group of each cell; empty without an array of groups.
    fn groups(&self) -> Result<Vec<f64>, Diagnostic> {
        let named = |name: &str| self.cell_data.iter().find(|(found, _)| found == name);
        let only = || self.cell_data.first().filter(|_| self.cell_data.len() == 1);
        match named("group").or_else(|| named("gmsh:physical")).or_else(only) {
            Some((name, array)) => self.decode(name, array, self.cells),
            None => Ok(Vec::new()),
        }
    }

    /// Decodes the array `name`, which must have `expected` entries.
    fn array(&self, name: &str, expected: usize) -> Result<Vec<f64>, Diagnostic> {
        let diagnostic = |found: String| {
            Diagnostic::new(format!("DataArray {name}"), format!("{expected} numbers"), found)
        };
        let array = self.arrays.get(name).ok_or_else(|| diagnostic("no such array".into()))?;
        self.decode(name, array, expected)
    }

    fn decode(&self, name: &str, array: &Array<'a>, expected: usize) -> Result<Vec<f64>, Diagnostic> {
        let diagnostic = |found: String| {
            Diagnostic::new(format!("DataArray {name}"), format!("{expected} numbers"), found)
        };
        let decode = |block: &[u8]| codec::elements(block, array.element, self.coding, expected);
        let values = match &array.place {
            Place::Ascii(text) => numbers(text, expected),
            Place::Inline(text) => decode(&codec::base64(text)),
            Place::Appended(offset) => match &self.appended {
                None => Err("no AppendedData".into()),
                Some(section) => match section.data.get(*offset..) {
                    None => Err(format!("offset {offset} beyond the {} appended bytes", section.data.len())),
                    Some(data) if section.base64 => decode(&codec::base64(data)),
                    Some(data) => decode(data),
                },
            },
        };
        values.map_err(diagnostic)
    }
}

fn numbers(text: &[u8], expected: usize) -> Result<Vec<f64>, String> {
    let text = std::str::from_utf8(text).map_err(|_| "bytes that are no text")?;
    let values: Vec<f64> = text
        .split_ascii_whitespace()
        .map(|word| word.parse().map_err(|_| format!("`{}`", word.chars().take(20).collect::<String>())))
        .collect::<Result<_, _>>()?;
    if values.len() == expected { Ok(values) } else { Err(format!("{} numbers", values.len())) }
}

fn coding(tag: &BytesStart) -> Result<Coding, Diagnostic> {
    let kind = attribute(tag, "type").unwrap_or_default();
    if kind != "UnstructuredGrid" {
        return Err(Diagnostic::new("VTKFile type", "UnstructuredGrid", format!("`{kind}`")));
    }
    let compressor = attribute(tag, "compressor");
    let zlib = match compressor.as_deref() {
        None | Some("") => false,
        Some("vtkZLibDataCompressor") => true,
        Some(other) => {
            return Err(Diagnostic::new(
                "compressor",
                "vtkZLibDataCompressor or none (save again)",
                format!("`{other}`"),
            ));
        }
    };
    Ok(Coding {
        big_endian: attribute(tag, "byte_order").as_deref() == Some("BigEndian"),
        long_header: attribute(tag, "header_type").as_deref() == Some("UInt64"),
        zlib,
    })
}

fn appended<'a>(tag: &BytesStart, rest: &'a [u8]) -> Result<Appended<'a>, Diagnostic> {
    let start = rest.iter().take_while(|b| b.is_ascii_whitespace()).count();
    if rest.get(start) != Some(&b'_') {
        return Err(Diagnostic::new("AppendedData", "an underscore before the data", "none"));
    }
    let base64 = attribute(tag, "encoding").as_deref() != Some("raw");
    Ok(Appended { data: &rest[start + 1..], base64 })
}

fn attribute(tag: &BytesStart, name: &str) -> Option<String> {
    let attribute = tag.try_get_attribute(name).ok()??;
    attribute.normalized_value(quick_xml::XmlVersion::default()).ok().map(|value| value.trim().to_owned())
}

fn count(tag: &BytesStart, name: &str) -> Result<usize, Diagnostic> {
    let text = attribute(tag, name).unwrap_or_default();
    text.parse().ok().filter(|n| *n <= u32::MAX as usize).ok_or_else(|| {
        let shown: String = text.chars().take(20).collect();
        Diagnostic::new(name, "a count below 2^32", format!("`{shown}`"))
    })
}
