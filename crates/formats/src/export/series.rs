//! A series of states: what they share, and one of them.

use super::label::Label;
use crate::error::Diagnostic;
use crate::vtu::Cells;
use rom::snapshots::{FieldKind, FieldSpec};
use std::io::{self, Write};

/// One state of a series.
#[derive(Clone, Debug)]
pub struct Moment {
    /// Its place in the series as viewers show it: seconds of a recording, the number of a case.
    pub time: f64,
    /// Its name and the numbers that belong to the whole state.
    pub label: Label,
    /// Field-major: all nodes of the first field, then of the next.
    pub values: Vec<f32>,
    /// How far parameters have moved the undeformed nodes from [`Series::undeformed`], by axis in mm; none: not at all.
    pub moved: Option<[Vec<f32>; 3]>,
}

/// What all states share.
#[derive(Clone, Copy, Debug)]
pub struct Series<'a> {
    /// Fields in order; x, y and z must be among them.
    pub fields: &'a [FieldSpec],
    /// Nodes a field.
    pub nodes: usize,
    /// Cells of the body, or facets of its surface.
    pub cells: Cells<'a>,
    /// Undeformed coordinates by axis in mm, where known.
    pub undeformed: Option<[&'a [f32]; 3]>,
    /// How many states will come.
    pub count: usize,
}

impl<'a> Series<'a> {
    /// Everything that does not fit together.
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

    /// Whether a state has a value for each node and field.
    ///
    /// # Errors
    /// Both numbers.
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

    /// Position of the field deformed along an axis.
    pub(super) fn axis(&self, axis: u8) -> Option<usize> {
        self.fields.iter().position(|field| field.kind == FieldKind::Coordinate(axis))
    }

    /// One field of a state, node by node.
    pub(super) fn field<'m>(&self, values: &'m [f32], field: usize) -> &'m [f32] {
        &values[field * self.nodes..(field + 1) * self.nodes]
    }

    /// All fields at a node.
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

/// One format; the file is opened and closed by the writer.
pub(crate) trait Layout {
    /// What stands before the first state.
    fn begin(&mut self, out: &mut dyn Write) -> io::Result<()>;

    /// One state; `index` counts from 0.
    fn state(&mut self, out: &mut dyn Write, index: usize, moment: &Moment) -> io::Result<()>;

    /// What stands behind the last state.
    fn end(&mut self, _out: &mut dyn Write) -> io::Result<()> {
        Ok(())
    }
}

/// Numbers in lines of so many, each with a space behind it.
pub(crate) fn lines(out: &mut dyn Write, values: &[impl std::fmt::Display], a_line: usize) -> io::Result<()> {
    for line in values.chunks(a_line) {
        line.iter().try_for_each(|value| write!(out, "{value} "))?;
        writeln!(out)?;
    }
    Ok(())
}
