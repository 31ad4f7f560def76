//! ParaView's collection: a `.pvd` that lists one `.vtu` a state, with its time.

use super::{Moment, Series, Sink};
use crate::error::FormatError;
use crate::fields::State;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Writes `NAME_0000.vtu`, `NAME_0001.vtu`, ... and at the end `NAME.pvd` beside them.
pub struct Pvd<'a> {
    path: PathBuf,
    series: Series<'a>,
    sets: String,
    written: Vec<PathBuf>,
}

impl<'a> Pvd<'a> {
    pub fn new(path: &Path, series: Series<'a>) -> Self {
        Self { path: path.into(), series, sets: String::new(), written: vec![path.into()] }
    }
}

impl Sink for Pvd<'_> {
    fn add(&mut self, index: usize, moment: &Moment) -> Result<(), FormatError> {
        let stem = self.path.file_stem().unwrap_or_default().to_string_lossy();
        let name = format!("{stem}_{index:04}.vtu");
        let file = self.path.with_file_name(&name);
        let Series { fields, nodes, cells, undeformed, .. } = self.series;
        State { fields, nodes, values: &moment.values, undeformed, cells }.write(&file)?;
        let name = quick_xml::escape::escape(name.as_str());
        let _ = writeln!(self.sets, "<DataSet timestep=\"{}\" part=\"0\" file=\"{name}\"/>", moment.time);
        self.written.push(file);
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<Vec<PathBuf>, FormatError> {
        let index = format!(
            "<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"0.1\" byte_order=\"LittleEndian\">\n\
             <Collection>\n{}</Collection>\n</VTKFile>\n",
            self.sets
        );
        std::fs::write(&self.path, index).map_err(|error| FormatError::write(&self.path, error))?;
        Ok(self.written)
    }
}
