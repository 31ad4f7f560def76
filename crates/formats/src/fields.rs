//! One reconstructed state as a file people open, by the name's end: `.npy` (f32, nodes x fields), `.csv`, `.vtu`, or
//! a series of one state as Tecplot ASCII (`.dat`) or XDMF.

use crate::error::{Diagnostic, FormatError};
use crate::export::{Moment, Series, SeriesFormat};
use crate::{npy, vtu};
use rom::snapshots::{FieldKind, FieldSpec};
use std::fmt::Write as _;
use std::path::Path;

/// Formats a state can be written in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// NumPy: f32, nodes x fields.
    Npy,
    /// One row a node, one column a field, with a heading.
    Csv,
    /// VTK unstructured grid of the deformed body.
    Vtu,
    /// Tecplot ASCII or XDMF.
    OneOfSeries,
}

impl Format {
    /// The format a file name asks for.
    ///
    /// # Errors
    /// Any other ending.
    pub fn of(path: &Path) -> Result<Self, FormatError> {
        match path.extension().and_then(|e| e.to_str()) {
            Some("npy") => Ok(Self::Npy),
            Some("csv") => Ok(Self::Csv),
            Some("vtu") => Ok(Self::Vtu),
            other => match SeriesFormat::of(path) {
                Ok(SeriesFormat::Tecplot | SeriesFormat::Xdmf) => Ok(Self::OneOfSeries),
                _ => {
                    let expected = "an ending of .npy, .csv, .vtu, .dat or .xdmf";
                    let found = other.unwrap_or("no ending");
                    Err(FormatError::one(path, Diagnostic::new("file name", expected, found)))
                }
            },
        }
    }
}

/// A state: fields by node, and what is known of the body.
#[derive(Clone, Copy, Debug)]
pub struct State<'a> {
    /// Fields in order.
    pub fields: &'a [FieldSpec],
    /// Nodes a field.
    pub nodes: usize,
    /// Field-major: all nodes of the first field, then of the next.
    pub values: &'a [f32],
    /// Undeformed coordinates by axis, where known: adds the displacement vector to `.vtu`.
    pub undeformed: Option<[&'a [f32]; 3]>,
    /// Cells for `.vtu`.
    pub cells: vtu::Cells<'a>,
}

impl State<'_> {
    /// Writes the state in the format its name asks for.
    ///
    /// # Errors
    /// An unknown ending, a state that does not fit together, or the operating system's refusal.
    pub fn write(&self, path: &Path) -> Result<(), FormatError> {
        let expected = self.nodes * self.fields.len();
        if self.values.len() != expected {
            return Err(FormatError::one(
                path,
                Diagnostic::new("state", format!("{expected} values"), self.values.len()),
            ));
        }
        match Format::of(path)? {
            Format::Npy => npy::write_f32(path, &[self.nodes, self.fields.len()], &self.interleaved()),
            Format::Csv => std::fs::write(path, self.csv()).map_err(|e| FormatError::write(path, e)),
            Format::Vtu => self.write_vtu(path),
            Format::OneOfSeries => self.write_series(path),
        }
    }

    /// One field, node by node.
    fn field(&self, index: usize) -> &[f32] {
        &self.values[index * self.nodes..(index + 1) * self.nodes]
    }

    fn coordinate(&self, axis: u8) -> Option<&[f32]> {
        let at = self.fields.iter().position(|f| f.kind == FieldKind::Coordinate(axis))?;
        Some(self.field(at))
    }

    /// `nodes x fields`.
    fn interleaved(&self) -> Vec<f32> {
        (0..self.nodes).flat_map(|node| (0..self.fields.len()).map(move |f| self.field(f)[node])).collect()
    }

    fn csv(&self) -> String {
        let mut text = String::from("node");
        for field in self.fields {
            let _ = write!(text, ",{}_{}", field.name, field.unit.to_lowercase());
        }
        text.push('\n');
        for node in 0..self.nodes {
            let _ = write!(text, "{node}");
            for field in 0..self.fields.len() {
                let _ = write!(text, ",{}", self.field(field)[node]);
            }
            text.push('\n');
        }
        text
    }

    fn write_series(&self, path: &Path) -> Result<(), FormatError> {
        let Self { fields, nodes, values, undeformed, cells } = *self;
        let title = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let moment = Moment { time: 0.0, title, values: values.to_vec() };
        Series { fields, nodes, cells, undeformed, count: 1 }
            .write(path, std::iter::once(Ok::<_, FormatError>(moment)))?;
        Ok(())
    }

    fn write_vtu(&self, path: &Path) -> Result<(), FormatError> {
        let (Some(x), Some(y), Some(z)) = (self.coordinate(0), self.coordinate(1), self.coordinate(2)) else {
            let problem = Diagnostic::new("fields", "the coordinates x, y and z", "a state without them");
            return Err(FormatError::one(path, problem));
        };
        let deformed = [x, y, z];
        let points: Vec<[f64; 3]> = (0..self.nodes).map(|i| deformed.map(|c| f64::from(c[i]))).collect();
        let vector: Option<Vec<f32>> = self.undeformed.map(|rest| {
            (0..self.nodes).flat_map(|i| (0..3).map(move |k| deformed[k][i] - rest[k][i])).collect()
        });
        let scalars =
            self.fields.iter().enumerate().filter(|(_, f)| !matches!(f.kind, FieldKind::Coordinate(_)));
        let named: Vec<(String, usize)> =
            scalars.map(|(i, f)| (format!("{} [{}]", f.name, f.unit), i)).collect();
        let mut data: Vec<vtu::PointData<'_>> = named
            .iter()
            .map(|(name, i)| vtu::PointData { name, components: 1, values: self.field(*i) })
            .collect();
        if let Some(values) = &vector {
            data.push(vtu::PointData { name: "displacement vector [mm]", components: 3, values });
        }
        vtu::write(path, &vtu::Grid { points_mm: &points, cells: self.cells, point_data: &data })
    }
}
