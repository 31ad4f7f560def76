//! Reconstructed state as a file, by the ending of its name: `.npy` (f32, nodes x fields), `.csv`, `.vtu`, or
//! a series of one state as Tecplot ASCII (`.dat`) or XDMF.

use super::csv;
use super::label::Label;
use super::pvd::write_vtu;
use super::series::{Moment, Series};
use super::writer::SeriesFormat;
use crate::error::{Diagnostic, FormatError};
use crate::{file, npy, table};
use std::path::Path;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StateFormat {
    /// NumPy: f32, nodes x fields.
    Npy,
    /// One row per node, one column per field, with a heading.
    Csv,
    /// VTK unstructured grid of the deformed body.
    Vtu,
    /// Tecplot ASCII or XDMF.
    OneOfSeries,
}

impl StateFormat {
    /// Format by the ending of a file name.
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

impl Series<'_> {
    /// Writes one state in the format of the name's ending; ignores [`Series::count`] and the state's time.
    ///
    /// # Errors
    /// An unknown ending, a state of inconsistent sizes, or an I/O error.
    pub fn write_state(&self, path: &Path, state: &Moment) -> Result<(), FormatError> {
        let Moment { label, values, .. } = state;
        self.check_length("state", values).map_err(|diagnostic| FormatError::one(path, diagnostic))?;
        match StateFormat::of(path)? {
            StateFormat::Npy => {
                let by_node: Vec<f32> = (0..self.nodes).flat_map(|node| self.at_node(values, node)).collect();
                npy::write_f32(path, &[self.nodes, self.fields.len()], &by_node)
            }
            StateFormat::Csv => file::replace(path, table_of(self, values, label).as_bytes()),
            StateFormat::Vtu => write_vtu(path, self, state),
            StateFormat::OneOfSeries => {
                let one = Series { count: 1, ..*self };
                one.write(path, std::iter::once(Ok::<_, FormatError>(state.clone()))).map(drop)
            }
        }
    }
}

/// Table with one row per node.
fn table_of(series: &Series<'_>, values: &[f32], label: &Label) -> String {
    let first = std::iter::once("node".to_owned());
    let header: Vec<String> = first.chain(series.columns()).chain(csv::heading(label)).collect();
    let last = csv::cells(label);
    let header: Vec<&str> = header.iter().map(String::as_str).collect();
    let row = |node: usize| {
        let values = series.at_node(values, node).map(|value| value.to_string());
        std::iter::once(node.to_string()).chain(values).chain(last.iter().cloned())
    };
    table::to_text(&header, (0..series.nodes).map(row))
}
