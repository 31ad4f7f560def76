//! One reconstructed state as a file people open, by the name's end: `.npy` (f32, nodes x fields), `.csv`, `.vtu`, or
//! a series of one state as Tecplot ASCII (`.dat`) or XDMF.

use crate::error::{Diagnostic, FormatError};
use crate::export::{self, Moment, Series, SeriesFormat};
use crate::{file, npy, table, vtu};
use rom::snapshots::FieldSpec;
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
        let Self { fields, nodes, values, undeformed, cells } = *self;
        let series = Series { fields, nodes, cells, undeformed, count: 1 };
        series.check_length("state", values).map_err(|diagnostic| FormatError::one(path, diagnostic))?;
        match Format::of(path)? {
            Format::Npy => {
                let by_node: Vec<f32> = (0..nodes).flat_map(|node| series.at_node(values, node)).collect();
                npy::write_f32(path, &[nodes, fields.len()], &by_node)
            }
            Format::Csv => file::replace(path, csv(&series, values).as_bytes()),
            Format::Vtu => export::write_vtu(path, &series, values),
            Format::OneOfSeries => {
                let title = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
                let moment = Moment { time: 0.0, title, values: values.to_vec() };
                series.write(path, std::iter::once(Ok::<_, FormatError>(moment))).map(drop)
            }
        }
    }
}

/// A row a node.
fn csv(series: &Series<'_>, values: &[f32]) -> String {
    let header: Vec<String> = std::iter::once("node".to_owned()).chain(series.columns()).collect();
    let header: Vec<&str> = header.iter().map(String::as_str).collect();
    let row = |node: usize| {
        std::iter::once(node.to_string()).chain(series.at_node(values, node).map(|value| value.to_string()))
    };
    table::to_text(&header, (0..series.nodes).map(row))
}
