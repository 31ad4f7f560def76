//! Tecplot ASCII: one finite-element zone a state, nodes and connectivity as the authors' post-processing reads them.
//!
//! Tecplot has no quadratic tetrahedra, so each is split into eight linear ones over all its ten nodes; every node keeps
//! its number and its value. Zones after the first share the first one's connectivity.

use super::{Moment, Series};
use crate::error::FormatError;
use crate::vtu::Cells;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// The eight linear tetrahedra of a quadratic one: four at its corners, four around the diagonal from the mid-side of
/// 02 to that of 13.
pub(super) const EIGHT: [[usize; 4]; 8] = [
    [0, 4, 6, 7],
    [4, 1, 5, 8],
    [6, 5, 2, 9],
    [7, 8, 9, 3],
    [6, 8, 4, 5],
    [6, 8, 5, 9],
    [6, 8, 9, 7],
    [6, 8, 7, 4],
];

/// Numbers on a line; Tecplot reads lines of up to 32,000 characters, people shorter ones.
const A_LINE: usize = 10;

/// Writes the file.
pub fn write(path: &Path, series: &Series<'_>) -> Result<Vec<PathBuf>, FormatError> {
    let (kind, cells) = linear(series.cells);
    let corners = if kind == "FETETRAHEDRON" { 4 } else { 3 };
    let mut text = String::from("TITLE = \"softtwin\"\nVARIABLES =");
    for name in names(series) {
        let _ = write!(text, " \"{name}\"");
    }
    text.push('\n');
    for (k, moment) in series.moments.iter().enumerate() {
        let title = moment.title.replace(['"', '\n'], "'");
        let _ = writeln!(text, "ZONE T=\"{title}\", N={}, E={}, DATAPACKING=BLOCK, ZONETYPE={kind}", series.nodes, cells.len() / corners);
        let _ = writeln!(text, "STRANDID=1, SOLUTIONTIME={}", moment.time);
        if k > 0 {
            text += "CONNECTIVITYSHAREZONE=1\n";
        }
        numbers(&mut text, series, moment);
        if k == 0 {
            for cell in cells.chunks_exact(corners) {
                let line: Vec<String> = cell.iter().map(|node| (node + 1).to_string()).collect();
                text += &line.join(" ");
                text.push('\n');
            }
        }
    }
    std::fs::write(path, text).map_err(|error| FormatError::write(path, error))?;
    Ok(vec![path.into()])
}

/// Upper-case names for the coordinates, and name with unit for the rest.
fn names<'a>(series: &'a Series<'_>) -> impl Iterator<Item = String> + 'a {
    let quantities = series.quantities().map(|k| format!("{} [{}]", series.fields[k].name, series.fields[k].unit));
    ["X", "Y", "Z"].map(String::from).into_iter().chain(quantities)
}

fn numbers(text: &mut String, series: &Series<'_>, moment: &Moment) {
    let quantities = series.quantities().map(|k| series.field(moment, k));
    for values in series.coordinates(moment).into_iter().chain(quantities) {
        for line in values.chunks(A_LINE) {
            for value in line {
                let _ = write!(text, "{value} ");
            }
            text.push('\n');
        }
    }
}

fn linear(cells: Cells<'_>) -> (&'static str, Vec<u32>) {
    match cells {
        Cells::QuadraticTets(tets) => {
            ("FETETRAHEDRON", tets.iter().flat_map(|tet| EIGHT.map(|part| part.map(|k| tet[k]))).flatten().collect())
        }
        Cells::Triangles(facets) => ("FETRIANGLE", facets.as_flattened().to_vec()),
    }
}
