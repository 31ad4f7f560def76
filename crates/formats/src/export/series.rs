//! Series of states: common properties, one state, and the trait of its formats.

use super::label::Label;
use crate::error::Diagnostic;
use crate::vtu::Cells;
use rom::snapshots::{FieldKind, FieldSpec};
use std::io::{self, Write};

/// State of a series.
#[derive(Clone, Debug)]
pub struct Moment {
    /// Time shown by viewers: seconds of a recording, or the number of a case.
    pub time: f64,
    /// Name and scalars of the state.
    pub label: Label,
    /// Field-major: all nodes of the first field, then of the next.
    pub values: Vec<f32>,
    /// Displacement of the undeformed nodes from [`Series::undeformed`] by parameters, by axis in mm; `None`: zero.
    pub moved: Option<[Vec<f32>; 3]>,
}

/// Properties common to all states.
#[derive(Clone, Copy, Debug)]
pub struct Series<'a> {
    /// Fields in order; x, y and z must be among them.
    pub fields: &'a [FieldSpec],
    /// Nodes per field.
    pub nodes: usize,
    /// Cells of the body, or facets of its surface.
    pub cells: Cells<'a>,
    /// Undeformed coordinates by axis in mm, if known.
    pub undeformed: Option<[&'a [f32]; 3]>,
    /// Number of states.
    pub count: usize,
}

impl<'a> Series<'a> {
    /// Inconsistencies of the series.
    pub(super) fn diagnostics(&self) -> Vec<Diagnostic> {
        let mut diagnostics = Vec::new();
        if self.count == 0 {
            diagnostics.push(Diagnostic::new("series", "at least one state", "none"));
        }
        if (0..3).any(|axis| self.axis(axis).is_none()) {
            diagnostics.push(Diagnostic::new(
                "fields",
                "the coordinates x, y and z",
                "a series without them",
            ));
        }
        let corners = match self.cells {
            Cells::QuadraticTets(cells) => cells.as_flattened(),
            Cells::Triangles(cells) => cells.as_flattened(),
            Cells::Mixed(_) => {
                diagnostics.push(Diagnostic::new("cells", "10-node tetrahedra or triangles", "mixed cells"));
                &[]
            }
        };
        if let Some(bad) = corners.iter().find(|node| **node as usize >= self.nodes) {
            diagnostics.push(Diagnostic::new("cells", format!("node indices below {}", self.nodes), bad));
        }
        diagnostics
    }

    /// Checks that a state has a value for each node and field.
    ///
    /// # Errors
    /// Expected and found numbers of values.
    pub(super) fn check_length(&self, place: &str, values: &[f32]) -> Result<(), Diagnostic> {
        let expected = self.nodes * self.fields.len();
        if values.len() == expected {
            return Ok(());
        }
        Err(Diagnostic::new(place, format!("{expected} values"), values.len()))
    }

    /// Names of the columns of a table: `x_mm`.
    pub(super) fn columns(&self) -> impl Iterator<Item = String> + 'a {
        self.fields.iter().map(|field| format!("{}_{}", field.name, field.unit.to_lowercase()))
    }

    /// Position of the deformed coordinate along an axis.
    pub(super) fn axis(&self, axis: u8) -> Option<usize> {
        self.fields.iter().position(|field| field.kind == FieldKind::Coordinate(axis))
    }

    /// Field of a state, by node.
    pub(super) fn field<'m>(&self, values: &'m [f32], field: usize) -> &'m [f32] {
        &values[field * self.nodes..(field + 1) * self.nodes]
    }

    /// Values of all fields at a node.
    pub(super) fn at_node<'m>(&self, values: &'m [f32], node: usize) -> impl Iterator<Item = f32> + 'm {
        values.iter().skip(node).step_by(self.nodes.max(1)).copied()
    }

    /// Positions of the fields that are not coordinates, with name and unit as viewers show them.
    pub(super) fn quantities(&self) -> impl Iterator<Item = (usize, String)> + 'a {
        let all = self.fields.iter().enumerate();
        all.filter(|(_, field)| !matches!(field.kind, FieldKind::Coordinate(_)))
            .map(|(k, field)| (k, format!("{} [{}]", field.name, field.unit)))
    }

    /// Coordinates of a state by axis; an axis without a field is empty.
    pub(super) fn coordinates<'m>(&self, values: &'m [f32]) -> [&'m [f32]; 3] {
        [0, 1, 2].map(|axis| self.axis(axis).map_or(&[][..], |field| self.field(values, field)))
    }
}

/// Format of a series; the writer opens and closes the file.
pub(crate) trait Layout {
    /// Writes the part before the first state.
    fn begin(&mut self, out: &mut dyn Write) -> io::Result<()>;

    /// Writes one state; `index` counts from 0.
    fn state(&mut self, out: &mut dyn Write, index: usize, moment: &Moment) -> io::Result<()>;

    /// Writes the part after the last state.
    fn end(&mut self, _out: &mut dyn Write) -> io::Result<()> {
        Ok(())
    }
}

/// Writes numbers, `per_line` on each line, each followed by a space.
pub(crate) fn lines(
    out: &mut dyn Write,
    values: &[impl std::fmt::Display],
    per_line: usize,
) -> io::Result<()> {
    for line in values.chunks(per_line) {
        line.iter().try_for_each(|value| write!(out, "{value} "))?;
        writeln!(out)?;
    }
    Ok(())
}
