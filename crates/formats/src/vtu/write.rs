//! Writer: one piece, inline binary arrays (base64, 64-bit lengths, uncompressed), which every reader understands.

use crate::cells::Block;
use crate::error::{Diagnostic, FormatError};
use crate::file;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use std::fmt::Write as _;
use std::path::Path;

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
