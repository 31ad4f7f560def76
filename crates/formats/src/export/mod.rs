//! Many states as files of the trade: VTU with a PVD index (ParaView), Tecplot ASCII, XDMF, CSV, NPY.
//!
//! One file a format. States are taken one after the other and written as they come, so a long recording needs the
//! memory of one state.

mod csv;
mod npy_stack;
mod pvd;
mod tecplot;
mod xdmf;

use crate::error::{Diagnostic, FormatError};
use crate::vtu::Cells;
use rom::snapshots::{FieldKind, FieldSpec};
use std::path::{Path, PathBuf};

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

/// What all states of a series share.
#[derive(Clone, Copy, Debug)]
pub struct Series<'a> {
    /// Fields in order; x, y and z must be among them.
    pub fields: &'a [FieldSpec],
    /// Nodes a field.
    pub nodes: usize,
    /// Cells of the body, or facets of its surface.
    pub cells: Cells<'a>,
    /// Undeformed coordinates by axis, where known.
    pub undeformed: Option<[&'a [f32]; 3]>,
    /// How many states will come.
    pub count: usize,
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
    /// One row a node and state.
    Csv,
    /// NumPy: f32, states x nodes x fields.
    Npy,
}

/// A file that states are added to.
trait Sink {
    fn add(&mut self, index: usize, moment: &Moment) -> Result<(), FormatError>;
    /// Closes it; returns the files written, the one that was asked for first.
    fn finish(self: Box<Self>) -> Result<Vec<PathBuf>, FormatError>;
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
            Some("csv") => Ok(Self::Csv),
            Some("npy") => Ok(Self::Npy),
            other => {
                let expected = "an ending of .pvd, .dat, .xdmf, .csv or .npy";
                Err(FormatError::one(
                    path,
                    Diagnostic::new("file name", expected, other.unwrap_or("no ending")),
                ))
            }
        }
    }
}

impl<'a> Series<'a> {
    /// Writes the series in the format its name asks for; returns the files it wrote. Cost and output are linear in
    /// states x nodes x fields; one state is in memory at a time.
    ///
    /// # Errors
    /// An unknown ending, a series that does not fit together, a state that could not be had, or the operating
    /// system's refusal.
    pub fn write<E: From<FormatError>>(
        &self,
        path: &Path,
        moments: impl Iterator<Item = Result<Moment, E>>,
    ) -> Result<Vec<PathBuf>, E> {
        FormatError::unless((), path, self.problems())?;
        let mut sink = self.sink(path)?;
        let mut written = 0;
        for moment in moments {
            let moment = moment?;
            self.check(path, written, &moment)?;
            sink.add(written, &moment)?;
            written += 1;
        }
        if written != self.count {
            let problem = Diagnostic::new("series", format!("{} states", self.count), written);
            return Err(FormatError::one(path, problem).into());
        }
        Ok(sink.finish()?)
    }

    fn sink(&self, path: &Path) -> Result<Box<dyn Sink + 'a>, FormatError> {
        Ok(match SeriesFormat::of(path)? {
            SeriesFormat::Pvd => Box::new(pvd::Pvd::new(path, *self)),
            SeriesFormat::Tecplot => Box::new(tecplot::Tecplot::new(path, *self)?),
            SeriesFormat::Xdmf => Box::new(xdmf::Xdmf::new(path, *self)?),
            SeriesFormat::Csv => Box::new(csv::Csv::new(path, *self)?),
            SeriesFormat::Npy => Box::new(npy_stack::NpyStack::new(path, *self)?),
        })
    }

    fn problems(&self) -> Vec<Diagnostic> {
        let mut problems = Vec::new();
        if self.count == 0 {
            problems.push(Diagnostic::new("series", "at least one state", "none"));
        }
        if (0..3).any(|axis| self.axis(axis).is_none()) {
            problems.push(Diagnostic::new("fields", "the coordinates x, y and z", "a series without them"));
        }
        let corners = match self.cells {
            Cells::QuadraticTets(cells) => cells.as_flattened(),
            Cells::Triangles(cells) => cells.as_flattened(),
            Cells::Mixed(_) => {
                problems.push(Diagnostic::new("cells", "10-node tetrahedra or triangles", "mixed cells"));
                &[]
            }
        };
        if let Some(bad) = corners.iter().find(|node| **node as usize >= self.nodes) {
            problems.push(Diagnostic::new("cells", format!("node indices below {}", self.nodes), bad));
        }
        problems
    }

    fn check(&self, path: &Path, index: usize, moment: &Moment) -> Result<(), FormatError> {
        let expected = self.nodes * self.fields.len();
        if moment.values.len() == expected {
            return Ok(());
        }
        let (place, found) = (format!("state {index}"), moment.values.len());
        Err(FormatError::one(path, Diagnostic::new(place, format!("{expected} values"), found)))
    }

    /// Position of the field deformed along an axis.
    fn axis(&self, axis: u8) -> Option<usize> {
        self.fields.iter().position(|field| field.kind == FieldKind::Coordinate(axis))
    }

    /// One field of a state, node by node.
    fn field<'m>(&self, moment: &'m Moment, field: usize) -> &'m [f32] {
        &moment.values[field * self.nodes..(field + 1) * self.nodes]
    }

    /// Positions of the fields that are not coordinates, with name and unit as viewers show them.
    fn quantities(&self) -> impl Iterator<Item = (usize, String)> + 'a {
        let named = |field: &FieldSpec| format!("{} [{}]", field.name, field.unit);
        let all = self.fields.iter().enumerate();
        all.filter(|(_, field)| !matches!(field.kind, FieldKind::Coordinate(_)))
            .map(move |(k, field)| (k, named(field)))
    }

    /// Coordinates of a state by axis; that x, y and z are there was checked before.
    fn coordinates<'m>(&self, moment: &'m Moment) -> [&'m [f32]; 3] {
        [0, 1, 2].map(|axis| self.axis(axis).map_or(&[][..], |field| self.field(moment, field)))
    }
}
