//! The writer: one piece, inline binary arrays (base64, 64-bit lengths, uncompressed), which every reader understands.

use crate::error::{FormatError, Problem};
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
}

impl Cells<'_> {
    fn parts(&self) -> (usize, usize, u8, Vec<u32>) {
        match self {
            Self::QuadraticTets(cells) => (cells.len(), 10, QUADRATIC_TETRA, cells.as_flattened().to_vec()),
            Self::Triangles(cells) => (cells.len(), 3, TRIANGLE, cells.as_flattened().to_vec()),
        }
    }
}

/// A named quantity with `components` values a node.
#[derive(Clone, Copy, Debug)]
pub struct PointData<'a> {
    /// Name with unit, as shown in a viewer (`von_mises [MPa]`).
    pub name: &'a str,
    /// 1 for scalars, 3 for vectors.
    pub components: usize,
    /// `nodes x components`.
    pub values: &'a [f32],
}

/// What is written.
#[derive(Clone, Copy, Debug)]
pub struct Grid<'a> {
    /// Node positions in mm.
    pub points_mm: &'a [[f64; 3]],
    /// Cells.
    pub cells: Cells<'a>,
    /// Values at the nodes.
    pub point_data: &'a [PointData<'a>],
}

/// Writes a grid.
///
/// # Errors
/// A cell that names a node that does not exist, point data of the wrong length, or the operating system's refusal.
pub fn write(path: &Path, grid: &Grid<'_>) -> Result<(), FormatError> {
    FormatError::unless((), path, problems(grid))?;
    std::fs::write(path, compose(grid)).map_err(|e| FormatError::write(path, e))
}

fn problems(grid: &Grid<'_>) -> Vec<Problem> {
    let nodes = grid.points_mm.len();
    let mut problems = Vec::new();
    let (.., connectivity) = grid.cells.parts();
    if let Some(bad) = connectivity.iter().find(|i| **i as usize >= nodes) {
        problems.push(Problem::new("cells", format!("node indices below {nodes}"), bad));
    }
    for data in grid.point_data.iter().filter(|d| d.values.len() != nodes * d.components) {
        let expected = format!("{} values", nodes * data.components);
        problems.push(Problem::new(format!("point data `{}`", data.name), expected, data.values.len()));
    }
    problems
}

fn compose(grid: &Grid<'_>) -> String {
    let (count, nodes_per_cell, kind, connectivity) = grid.cells.parts();
    let mut xml = String::from("<?xml version=\"1.0\"?>\n");
    xml += "<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\">\n";
    let _ = writeln!(
        xml,
        "<UnstructuredGrid>\n<Piece NumberOfPoints=\"{}\" NumberOfCells=\"{count}\">",
        grid.points_mm.len()
    );
    xml += "<Points>\n";
    let points = grid.points_mm.as_flattened().iter().flat_map(|v| v.to_le_bytes());
    array(&mut xml, "Float64", "Points", 3, points);
    xml += "</Points>\n<Cells>\n";
    array(&mut xml, "Int32", "connectivity", 1, connectivity.iter().flat_map(|v| v.to_le_bytes()));
    let offsets = (1..=count).map(|i| (i * nodes_per_cell) as u32);
    array(&mut xml, "Int32", "offsets", 1, offsets.flat_map(u32::to_le_bytes));
    array(&mut xml, "UInt8", "types", 1, std::iter::repeat_n(kind, count));
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
    base64(xml, &block);
    xml.push_str("\n</DataArray>\n");
}

/// Base64 with padding (RFC 4648).
fn base64(text: &mut String, bytes: &[u8]) {
    const ALPHABET: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    text.reserve(bytes.len().div_ceil(3) * 4);
    for chunk in bytes.chunks(3) {
        let word = (0..3).fold(0_u32, |word, i| word << 8 | u32::from(*chunk.get(i).unwrap_or(&0)));
        for i in 0..4 {
            let digit = ALPHABET[(word >> (18 - 6 * i) & 63) as usize];
            text.push(if i <= chunk.len() { char::from(digit) } else { '=' });
        }
    }
}
