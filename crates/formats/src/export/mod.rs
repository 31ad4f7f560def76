//! Many states as files of the trade: VTU with a PVD index (ParaView), Tecplot ASCII, XDMF, NPY.
//!
//! One file a format. All take the same [`Series`] and refuse one that does not fit together before anything is written.

mod npy_stack;
mod pvd;
mod tecplot;
mod xdmf;

use crate::error::{FormatError, Problem};
use crate::vtu::Cells;
use rom::snapshots::{FieldKind, FieldSpec};
use std::path::Path;

/// One state of a series.
#[derive(Clone, Debug)]
pub struct Moment {
    /// Its place in the series as viewers show it: seconds of a recording, the number of a case.
    pub time: f64,
    /// For people (`P = 0.05 MPa, gap 40 mm`); one line.
    pub title: String,
    /// Field-major: all nodes of the first field, then of the next.
    pub values: Vec<f32>,
}

/// States of one body.
#[derive(Clone, Debug)]
pub struct Series<'a> {
    /// Fields in order; x, y and z must be among them.
    pub fields: &'a [FieldSpec],
    /// Nodes a field.
    pub nodes: usize,
    /// Cells of the body, or facets of its surface.
    pub cells: Cells<'a>,
    /// Undeformed coordinates by axis, where known.
    pub undeformed: Option<[&'a [f32]; 3]>,
    /// The states, in ascending order of time.
    pub moments: &'a [Moment],
}

/// Formats a series can be written in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SeriesFormat {
    /// One `.vtu` a state and a `.pvd` that lists them.
    Pvd,
    /// Tecplot ASCII, one zone a state.
    Tecplot,
    /// XDMF 3, a temporal collection with inline numbers.
    Xdmf,
    /// NumPy: f32, states x nodes x fields.
    Npy,
}

impl SeriesFormat {
    /// The format a file name asks for.
    ///
    /// # Errors
    /// Any other ending.
    pub fn of(path: &Path) -> Result<Self, FormatError> {
        match path.extension().and_then(|ending| ending.to_str()) {
            Some("pvd") => Ok(Self::Pvd),
            Some("dat" | "tec") => Ok(Self::Tecplot),
            Some("xdmf" | "xmf") => Ok(Self::Xdmf),
            Some("npy") => Ok(Self::Npy),
            other => {
                let expected = "an ending of .pvd, .dat, .xdmf or .npy";
                Err(FormatError::one(path, Problem::new("file name", expected, other.unwrap_or("no ending"))))
            }
        }
    }
}

impl Series<'_> {
    /// Writes the series in the format its name asks for; returns the files it wrote.
    ///
    /// # Errors
    /// An unknown ending, a series that does not fit together, or the operating system's refusal.
    pub fn write(&self, path: &Path) -> Result<Vec<std::path::PathBuf>, FormatError> {
        FormatError::unless((), path, self.problems())?;
        match SeriesFormat::of(path)? {
            SeriesFormat::Pvd => pvd::write(path, self),
            SeriesFormat::Tecplot => tecplot::write(path, self),
            SeriesFormat::Xdmf => xdmf::write(path, self),
            SeriesFormat::Npy => npy_stack::write(path, self),
        }
    }

    fn problems(&self) -> Vec<Problem> {
        let mut problems = Vec::new();
        let expected = self.nodes * self.fields.len();
        for (k, moment) in self.moments.iter().enumerate().filter(|(_, m)| m.values.len() != expected) {
            problems.push(Problem::new(format!("state {k}"), format!("{expected} values"), moment.values.len()));
        }
        if self.moments.is_empty() {
            problems.push(Problem::new("series", "at least one state", "none"));
        }
        if (0..3).any(|axis| self.axis(axis).is_none()) {
            problems.push(Problem::new("fields", "the coordinates x, y and z", "a series without them"));
        }
        let corners: Vec<u32> = match self.cells {
            Cells::QuadraticTets(cells) => cells.as_flattened().to_vec(),
            Cells::Triangles(cells) => cells.as_flattened().to_vec(),
        };
        if let Some(bad) = corners.iter().find(|node| **node as usize >= self.nodes) {
            problems.push(Problem::new("cells", format!("node indices below {}", self.nodes), bad));
        }
        problems
    }

    /// Position of the field deformed along an axis.
    fn axis(&self, axis: u8) -> Option<usize> {
        self.fields.iter().position(|field| field.kind == FieldKind::Coordinate(axis))
    }

    /// One field of a state, node by node.
    fn field<'m>(&self, moment: &'m Moment, field: usize) -> &'m [f32] {
        &moment.values[field * self.nodes..(field + 1) * self.nodes]
    }

    /// Positions of the fields that are not coordinates.
    fn quantities(&self) -> impl Iterator<Item = usize> + '_ {
        let is = |field: &FieldSpec| matches!(field.kind, FieldKind::Coordinate(_));
        (0..self.fields.len()).filter(move |k| !is(&self.fields[*k]))
    }

    /// Coordinates of a state by axis; x, y and z have been checked.
    fn coordinates<'m>(&self, moment: &'m Moment) -> [&'m [f32]; 3] {
        [0, 1, 2].map(|axis| self.axis(axis).map_or(&[][..], |field| self.field(moment, field)))
    }
}
