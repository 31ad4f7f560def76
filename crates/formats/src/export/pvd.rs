//! ParaView's collection: a `.pvd` that lists one `.vtu` a state, with its time.

use super::Series;
use crate::error::FormatError;
use crate::fields::State;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Writes `NAME.pvd` and `NAME_0000.vtu`, `NAME_0001.vtu`, ... beside it.
pub fn write(path: &Path, series: &Series<'_>) -> Result<Vec<PathBuf>, FormatError> {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let mut index = String::from("<?xml version=\"1.0\"?>\n");
    index += "<VTKFile type=\"Collection\" version=\"0.1\" byte_order=\"LittleEndian\">\n<Collection>\n";
    let mut written = Vec::new();
    for (k, moment) in series.moments.iter().enumerate() {
        let name = format!("{stem}_{k:04}.vtu");
        let file = path.with_file_name(&name);
        let state = State {
            fields: series.fields,
            nodes: series.nodes,
            values: &moment.values,
            undeformed: series.undeformed,
            cells: series.cells,
        };
        state.write(&file)?;
        let name = quick_xml::escape::escape(name.as_str());
        let _ = writeln!(index, "<DataSet timestep=\"{}\" part=\"0\" file=\"{name}\"/>", moment.time);
        written.push(file);
    }
    index += "</Collection>\n</VTKFile>\n";
    std::fs::write(path, index).map_err(|error| FormatError::write(path, error))?;
    written.insert(0, path.into());
    Ok(written)
}
