//! ParaView's collection: a `.pvd` that lists one `.vtu` per state, with its time.

use super::series::{Layout, Moment, Series};
use crate::error::{Diagnostic, FormatError};
use crate::vtu;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Writer of `NAME_0000.vtu`, `NAME_0001.vtu`, ... in the folder of `NAME.pvd`.
pub(crate) struct Pvd<'a> {
    path: PathBuf,
    series: Series<'a>,
}

impl<'a> Pvd<'a> {
    pub(crate) fn new(path: &Path, series: Series<'a>) -> Self {
        Self { path: path.into(), series }
    }
}

pub(crate) fn state_file(path: &Path, index: usize) -> PathBuf {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!("{stem}_{index:04}.vtu"))
}

impl Layout for Pvd<'_> {
    fn begin(&mut self, out: &mut dyn Write) -> io::Result<()> {
        writeln!(out, "<?xml version=\"1.0\"?>")?;
        writeln!(
            out,
            "<VTKFile type=\"Collection\" version=\"0.1\" byte_order=\"LittleEndian\">\n<Collection>"
        )
    }

    fn state(&mut self, out: &mut dyn Write, index: usize, moment: &Moment) -> io::Result<()> {
        let file = state_file(&self.path, index);
        write_vtu(&file, &self.series, moment).map_err(io::Error::other)?;
        let name = file.file_name().unwrap_or_default().to_string_lossy();
        let name = quick_xml::escape::escape(name.as_ref());
        writeln!(out, "<DataSet timestep=\"{}\" part=\"0\" file=\"{name}\"/>", moment.time)
    }

    fn end(&mut self, out: &mut dyn Write) -> io::Result<()> {
        writeln!(out, "</Collection>\n</VTKFile>")
    }
}

/// Writes a state as a VTK unstructured grid of the deformed body.
///
/// # Errors
/// A state without coordinates, or as [`vtu::write`].
pub(crate) fn write_vtu(path: &Path, series: &Series<'_>, moment: &Moment) -> Result<(), FormatError> {
    let Moment { label, values, moved, .. } = moment;
    let deformed = series.coordinates(values);
    if deformed.iter().any(|axis| axis.len() != series.nodes) {
        let diagnostic = Diagnostic::new("fields", "the coordinates x, y and z", "a state without them");
        return Err(FormatError::one(path, diagnostic));
    }
    let points: Vec<[f64; 3]> = (0..series.nodes).map(|i| deformed.map(|c| f64::from(c[i]))).collect();
    let vector: Option<Vec<f32>> = series.undeformed.map(|undeformed| {
        let moved = |k: usize, i: usize| moved.as_ref().map_or(0.0, |moved| moved[k][i]);
        let offset = |i: usize| (0..3).map(move |k| deformed[k][i] - (undeformed[k][i] + moved(k, i)));
        (0..series.nodes).flat_map(offset).collect()
    });
    let named: Vec<(usize, String)> = series.quantities().collect();
    let scalars = named.iter().map(|(k, name)| (name, series.field(values, *k)));
    let mut data: Vec<vtu::PointData<'_>> =
        scalars.map(|(name, values)| vtu::PointData { name, components: 1, values }).collect();
    if let Some(values) = &vector {
        data.push(vtu::PointData { name: "displacement vector [mm]", components: 3, values });
    }
    let grid = vtu::Grid { points_mm: &points, cells: series.cells, point_data: &data };
    let numbers: Vec<(&str, f64)> = label.present().collect();
    vtu::write_labelled(path, &grid, &label.name, &numbers)
}
