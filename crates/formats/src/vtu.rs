//! VTK's XML unstructured grids, as ParaView, meshio and PyVista read and write them.

use crate::cells::{Block, CellKind};
use crate::error::{Diagnostic, FormatError};
use crate::file;
use crate::mesh_file::{MeshFile, Tri6};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use flate2::bufread::ZlibDecoder;
use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};
use std::collections::{BTreeMap, HashMap};
use std::fmt::Write as _;
use std::io::Read;
use std::path::Path;

// ---- reader ----

// Reader: one piece of 10-node tetrahedra, or of any cells with quantities at their nodes; arrays in ASCII, base64 or raw appended,
// plain or zlib, either byte order.

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
    pub point_data: Vec<VtuArray>,
    /// Cells that were left out.
    pub left_out: Vec<String>,
    /// Time in the file (`TimeValue`).
    pub time: Option<f64>,
}

/// Quantity at the nodes.
#[derive(Clone, Debug, PartialEq)]
pub struct VtuArray {
    /// Name in the file.
    pub name: String,
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
            Ok(values) => point_data.push(VtuArray { name: name.clone(), components: *components, values }),
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
            let kind = CellKind::of(*number as usize).filter(|kind| kind.nodes == members.len()).ok_or_else(
                || {
                    let found = format!("type {number} with {} nodes", members.len());
                    let expected =
                        "linear or quadratic tetrahedra, hexahedra, wedges, triangles or quadrilaterals";
                    vec![Diagnostic::new(place(), expected, found)]
                },
            )?;
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

/// Where an array's data are.
enum ArrayPlace<'a> {
    Ascii(&'a [u8]),
    Inline(&'a [u8]),
    Appended(usize),
}

struct Array<'a> {
    element: Element,
    place: ArrayPlace<'a>,
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
            "ascii" => ArrayPlace::Ascii(text),
            "binary" => ArrayPlace::Inline(text),
            "appended" => ArrayPlace::Appended(count(tag, "offset")?),
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
        let decode = |block: &[u8]| elements(block, array.element, self.coding, expected);
        let values = match &array.place {
            ArrayPlace::Ascii(text) => numbers(text, expected),
            ArrayPlace::Inline(text) => decode(&base64(text)),
            ArrayPlace::Appended(offset) => match &self.appended {
                None => Err("no AppendedData".into()),
                Some(section) => match section.data.get(*offset..) {
                    None => Err(format!("offset {offset} beyond the {} appended bytes", section.data.len())),
                    Some(data) if section.base64 => decode(&base64(data)),
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

// ---- writer: one piece, inline binary arrays (base64, 64-bit lengths, uncompressed), which every reader understands ----

const QUADRATIC_TETRA: u8 = 24;
const TRIANGLE: u8 = 5;

/// Cells of a grid, by node index.
#[derive(Clone, Copy, Debug)]
pub enum Cells<'a> {
    /// 10-node tetrahedra in VTK order.
    QuadraticTets(&'a [[u32; 10]]),
    /// Flat triangles.
    Triangles(&'a [[u32; 3]]),
    /// Cells of several kinds.
    Mixed(&'a [Block]),
}

impl Cells<'_> {
    /// True without cells.
    pub fn is_empty(&self) -> bool {
        self.parts().iter().all(|part| part.2.is_empty())
    }

    /// Per kind of cell: VTK's number of the kind, nodes per cell, and all their nodes.
    fn parts(&self) -> Vec<(u8, usize, &[u32])> {
        match self {
            Self::QuadraticTets(cells) => vec![(QUADRATIC_TETRA, 10, cells.as_flattened())],
            Self::Triangles(cells) => vec![(TRIANGLE, 3, cells.as_flattened())],
            Self::Mixed(blocks) => {
                blocks.iter().map(|b| (b.kind, b.nodes_per_cell, b.nodes.as_slice())).collect()
            }
        }
    }
}

/// Named quantity with `components` values per node.
#[derive(Clone, Copy, Debug)]
pub struct PointData<'a> {
    /// Name with unit, as shown in a viewer (`von_mises [MPa]`).
    pub name: &'a str,
    /// 1 for scalars, 3 for vectors.
    pub components: usize,
    /// `nodes x components`.
    pub values: &'a [f32],
}

/// Content of a file.
#[derive(Clone, Copy, Debug)]
pub struct Grid<'a> {
    /// Node positions in mm.
    pub points_mm: &'a [[f64; 3]],
    pub cells: Cells<'a>,
    /// Values at the nodes.
    pub point_data: &'a [PointData<'a>],
}

/// Writes a grid.
///
/// # Errors
/// A cell with a node that does not exist, point data of the wrong length, or an I/O error.
pub fn write(path: &Path, grid: &Grid<'_>) -> Result<(), FormatError> {
    write_labelled(path, grid, "", &[])
}

/// Writes a grid with field data: a name (`case`, omitted if empty) and named numbers.
///
/// # Errors
/// As [`write()`].
pub fn write_labelled(
    path: &Path,
    grid: &Grid<'_>,
    name: &str,
    numbers: &[(&str, f64)],
) -> Result<(), FormatError> {
    FormatError::check((), path, diagnostics(grid))?;
    file::replace(path, compose(grid, &field_data(name, numbers)).as_bytes())
}

/// The name is written as its bytes: other readers (meshio) refuse VTK's arrays of strings.
fn field_data(name: &str, numbers: &[(&str, f64)]) -> String {
    let mut xml = String::new();
    if name.is_empty() && numbers.is_empty() {
        return xml;
    }
    xml += "<FieldData>\n";
    for (name, value) in numbers {
        let name = quick_xml::escape::escape(*name);
        let _ = writeln!(
            xml,
            "<DataArray type=\"Float64\" Name=\"{name}\" NumberOfTuples=\"1\" format=\"ascii\">{value:e}</DataArray>"
        );
    }
    if !name.is_empty() {
        let codes: Vec<String> = name.bytes().map(|byte| byte.to_string()).collect();
        let (count, codes) = (codes.len(), codes.join(" "));
        let _ = writeln!(
            xml,
            "<DataArray type=\"UInt8\" Name=\"case\" NumberOfTuples=\"{count}\" format=\"ascii\">{codes}</DataArray>"
        );
    }
    xml + "</FieldData>\n"
}

fn diagnostics(grid: &Grid<'_>) -> Vec<Diagnostic> {
    let nodes = grid.points_mm.len();
    let mut diagnostics = Vec::new();
    let parts = grid.cells.parts();
    if let Some(bad) = parts.iter().flat_map(|part| part.2).find(|i| **i as usize >= nodes) {
        diagnostics.push(Diagnostic::new("cells", format!("node indices below {nodes}"), bad));
    }
    for data in grid.point_data.iter().filter(|d| d.values.len() != nodes * d.components) {
        let expected = format!("{} values", nodes * data.components);
        diagnostics.push(Diagnostic::new(format!("point data `{}`", data.name), expected, data.values.len()));
    }
    diagnostics
}

fn compose(grid: &Grid<'_>, field_data: &str) -> String {
    let parts = grid.cells.parts();
    // One entry a cell: how many nodes it has and what it is.
    let cells: Vec<(u32, u8)> = parts
        .iter()
        .flat_map(|(kind, width, nodes)| std::iter::repeat_n((*width as u32, *kind), nodes.len() / width))
        .collect();
    let count = cells.len();
    let mut xml = String::from("<?xml version=\"1.0\"?>\n");
    xml += "<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\">\n";
    let _ = writeln!(
        xml,
        "<UnstructuredGrid>\n{field_data}<Piece NumberOfPoints=\"{}\" NumberOfCells=\"{count}\">",
        grid.points_mm.len()
    );
    xml += "<Points>\n";
    let points = grid.points_mm.as_flattened().iter().flat_map(|v| v.to_le_bytes());
    array(&mut xml, "Float64", "Points", 3, points);
    xml += "</Points>\n<Cells>\n";
    let connectivity = parts.iter().flat_map(|part| part.2).flat_map(|node| node.to_le_bytes());
    array(&mut xml, "Int32", "connectivity", 1, connectivity);
    let offsets = cells.iter().scan(0_u32, |end, (width, _)| {
        *end += width;
        Some(*end)
    });
    array(&mut xml, "Int32", "offsets", 1, offsets.flat_map(u32::to_le_bytes));
    array(&mut xml, "UInt8", "types", 1, cells.iter().map(|(_, kind)| *kind));
    xml += "</Cells>\n<PointData>\n";
    for data in grid.point_data {
        array(
            &mut xml,
            "Float32",
            data.name,
            data.components,
            data.values.iter().flat_map(|v| v.to_le_bytes()),
        );
    }
    xml += "</PointData>\n</Piece>\n</UnstructuredGrid>\n</VTKFile>\n";
    xml
}

fn array(xml: &mut String, kind: &str, name: &str, components: usize, bytes: impl Iterator<Item = u8>) {
    let bytes: Vec<u8> = bytes.collect();
    let mut block = (bytes.len() as u64).to_le_bytes().to_vec();
    block.extend(bytes);
    let name = quick_xml::escape::escape(name);
    let _ = writeln!(
        xml,
        "<DataArray type=\"{kind}\" Name=\"{name}\" NumberOfComponents=\"{components}\" format=\"binary\">"
    );
    STANDARD.encode_string(&block, xml);
    xml.push_str("\n</DataArray>\n");
}

// ---- bytes of a `DataArray`: base64, length headers and zlib blocks, each bounded by what the file can hold ----

/// Base64 without padding, for the end of truncated data.
const PADDED_OR_NOT: GeneralPurpose = GeneralPurpose::new(
    &base64::alphabet::STANDARD,
    GeneralPurposeConfig::new()
        .with_decode_allow_trailing_bits(true)
        .with_decode_padding_mode(DecodePaddingMode::Indifferent),
);

/// Encoding of a file's arrays (attributes of `VTKFile`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Coding {
    /// Most significant byte first.
    pub(crate) big_endian: bool,
    /// Lengths take 8 bytes instead of 4.
    pub(crate) long_header: bool,
    /// Arrays in zlib blocks.
    pub(crate) zlib: bool,
}

/// Element type of VTK's arrays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Element {
    Float(usize),
    Int(usize),
    UInt(usize),
}

impl Element {
    pub(crate) fn named(name: &str) -> Option<Self> {
        let (kind, bits): (fn(usize) -> Self, &str) = if let Some(bits) = name.strip_prefix("Float") {
            (Self::Float, bits)
        } else if let Some(bits) = name.strip_prefix("UInt") {
            (Self::UInt, bits)
        } else {
            (Self::Int, name.strip_prefix("Int")?)
        };
        let bytes = match bits {
            "8" => 1,
            "16" => 2,
            "32" => 4,
            "64" => 8,
            _ => return None,
        };
        let element = kind(bytes);
        (!matches!(element, Self::Float(1 | 2))).then_some(element)
    }

    pub(crate) fn size(self) -> usize {
        match self {
            Self::Float(n) | Self::Int(n) | Self::UInt(n) => n,
        }
    }

    /// Values of an array.
    pub(crate) fn values(self, bytes: &[u8], big_endian: bool) -> Vec<f64> {
        bytes.chunks_exact(self.size()).map(|element| self.value(element, big_endian)).collect()
    }

    /// Value of one element; integers above 2^53 lose digits.
    fn value(self, bytes: &[u8], big_endian: bool) -> f64 {
        let word = word(bytes, big_endian);
        match self {
            Self::Float(4) => f64::from(f32::from_bits(word as u32)),
            Self::Float(_) => f64::from_bits(word),
            Self::UInt(_) => word as f64,
            Self::Int(n) => {
                let unused = 64 - 8 * n as u32;
                ((word << unused) as i64 >> unused) as f64
            }
        }
    }
}

/// Decodes at most `expected` elements of an encoded block; an error describes the content found.
pub(super) fn elements(
    block: &[u8],
    element: Element,
    coding: Coding,
    expected: usize,
) -> Result<Vec<f64>, String> {
    let wanted = expected.checked_mul(element.size()).ok_or("a size beyond any memory")?;
    let raw = if coding.zlib { inflate(block, coding, wanted)? } else { plain(block, coding, wanted)? };
    Ok(element.values(&raw, coding.big_endian))
}

fn plain(block: &[u8], coding: Coding, wanted: usize) -> Result<Vec<u8>, String> {
    let (length, rest) = length(block, coding)?;
    if length != wanted {
        return Err(format!("{length} bytes"));
    }
    rest.get(..wanted).map(<[u8]>::to_vec).ok_or_else(|| format!("only {} of {wanted} bytes", rest.len()))
}

/// Blocks of zlib: their number, the size of each when inflated, that of the last, then every compressed size.
fn inflate(block: &[u8], coding: Coding, wanted: usize) -> Result<Vec<u8>, String> {
    let (count, rest) = length(block, coding)?;
    let (size, rest) = length(rest, coding)?;
    let (last, mut sizes) = length(rest, coding)?;
    let header = if coding.long_header { 8 } else { 4 };
    let mut data = count
        .checked_mul(header)
        .and_then(|bytes| sizes.get(bytes..))
        .ok_or_else(|| format!("{count} blocks announced in {} bytes", sizes.len()))?;
    let total = match (count, last) {
        (0, _) => Some(0),
        (_, 0) => count.checked_mul(size),
        _ => (count - 1).checked_mul(size).and_then(|bytes| bytes.checked_add(last)),
    };
    if total != Some(wanted) {
        return Err(total.map_or_else(|| "a size beyond any memory".into(), |bytes| format!("{bytes} bytes")));
    }
    let mut out = Vec::new(); // grows with the data, not with the header
    for index in 0..count {
        let (compressed, next) = length(sizes, coding)?;
        sizes = next;
        let part = data.get(..compressed).ok_or_else(|| format!("block {index} cut short"))?;
        data = &data[compressed..];
        let bound = (wanted - out.len()) as u64;
        ZlibDecoder::new(part)
            .take(bound)
            .read_to_end(&mut out)
            .map_err(|e| format!("block {index} that is no zlib stream ({e})"))?;
    }
    if out.len() == wanted { Ok(out) } else { Err(format!("only {} of {wanted} bytes", out.len())) }
}

fn length(bytes: &[u8], coding: Coding) -> Result<(usize, &[u8]), String> {
    let width = if coding.long_header { 8 } else { 4 };
    let (head, rest) = bytes.split_at_checked(width).ok_or("too few bytes for a length header")?;
    let value = usize::try_from(word(head, coding.big_endian)).map_err(|_| "a size beyond any memory")?;
    Ok((value, rest))
}

/// Integer of at most 8 bytes.
fn word(bytes: &[u8], big_endian: bool) -> u64 {
    let mut wide = [0_u8; 8];
    for (i, byte) in bytes.iter().enumerate() {
        wide[if big_endian { bytes.len() - 1 - i } else { i }] = *byte;
    }
    u64::from_le_bytes(wide)
}

/// Base64 without its white space. VTK encodes the length header of compressed data apart from the data, so padding may
/// occur in the middle: each padded part is decoded by itself. Ends at the first byte that is not base64; the caller
/// checks lengths.
pub(super) fn base64(text: &[u8]) -> Vec<u8> {
    let digits = |byte: &u8| byte.is_ascii_alphanumeric() || b"+/=".contains(byte);
    let text: Vec<u8> =
        text.iter().filter(|byte| !byte.is_ascii_whitespace()).copied().take_while(digits).collect();
    let mut out = Vec::with_capacity(text.len() / 4 * 3);
    for part in text.chunk_by(|before, after| *before != b'=' || *after == b'=') {
        if PADDED_OR_NOT.decode_vec(part, &mut out).is_err() {
            break;
        }
    }
    out
}
