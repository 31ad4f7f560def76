//! Tecplot ASCII: one finite-element zone per state, nodes and connectivity as the authors' post-processing reads them.
//!
//! Tecplot has no quadratic tetrahedra, so each is split into eight linear ones over its ten nodes; nodes keep their numbers and
//! values. Every zone has a connectivity, because other readers do not support shared ones.

use super::series::{Layout, Moment, Series, lines};
use crate::vtu::Cells;
use std::io::{self, Write};

/// Eight linear tetrahedra of a quadratic one: four at its corners, four around the diagonal from the mid-side of 02 to that of 13.
const EIGHT: [[usize; 4]; 8] = [
    [0, 4, 6, 7],
    [4, 1, 5, 8],
    [6, 5, 2, 9],
    [7, 8, 9, 3],
    [6, 4, 5, 8],
    [6, 5, 9, 8],
    [6, 9, 7, 8],
    [6, 7, 4, 8],
];

/// Numbers per line; Tecplot reads up to 32,000 characters.
const A_LINE: usize = 10;

pub(crate) struct Tecplot<'a> {
    series: Series<'a>,
    kind: &'static str,
    corners: usize,
    cells: Vec<u32>,
}

impl<'a> Tecplot<'a> {
    pub(crate) fn new(series: Series<'a>) -> Self {
        let (kind, corners, cells) = linear(series.cells);
        Self { series, kind, corners, cells }
    }
}

impl Layout for Tecplot<'_> {
    /// Writes upper-case names for the coordinates, and name with unit for the rest.
    fn begin(&mut self, out: &mut dyn Write) -> io::Result<()> {
        let quantities = self.series.quantities().map(|(_, name)| name);
        let names: Vec<String> = ["X", "Y", "Z"].map(String::from).into_iter().chain(quantities).collect();
        writeln!(out, "TITLE = \"softtwin\"\nVARIABLES = \"{}\"", names.join("\", \""))
    }

    fn state(&mut self, out: &mut dyn Write, _: usize, moment: &Moment) -> io::Result<()> {
        let title = moment.label.to_string().replace(['"', '\n'], "'");
        let (nodes, elements) = (self.series.nodes, self.cells.len() / self.corners);
        let (kind, time) = (self.kind, moment.time);
        writeln!(
            out,
            "ZONE T=\"{title}\", STRANDID=1, SOLUTIONTIME={time}, NODES={nodes}, ELEMENTS={elements}, DATAPACKING=BLOCK, ZONETYPE={kind}"
        )?;
        let quantities = self.series.quantities().map(|(k, _)| self.series.field(&moment.values, k));
        for values in self.series.coordinates(&moment.values).into_iter().chain(quantities) {
            lines(out, values, A_LINE)?;
        }
        let numbers: Vec<u32> = self.cells.iter().map(|node| node + 1).collect();
        lines(out, &numbers, self.corners)
    }
}

fn linear(cells: Cells<'_>) -> (&'static str, usize, Vec<u32>) {
    match cells {
        Cells::QuadraticTets(tets) => {
            let parts = tets.iter().flat_map(|tet| EIGHT.map(|part| part.map(|k| tet[k])));
            ("FETETRAHEDRON", 4, parts.flatten().collect())
        }
        Cells::Triangles(facets) => ("FETRIANGLE", 3, facets.as_flattened().to_vec()),
        Cells::Mixed(_) => ("FETRIANGLE", 3, Vec::new()), // refused by the series before
    }
}

#[cfg(test)]
#[path = "../../tests/unit/export_tecplot.rs"]
mod tests;
