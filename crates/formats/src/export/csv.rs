//! All states as one table: a row for each node of each state.

use super::{Moment, Series, Sink};
use crate::error::FormatError;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

pub struct Csv<'a> {
    path: PathBuf,
    out: BufWriter<File>,
    series: Series<'a>,
}

impl<'a> Csv<'a> {
    pub fn new(path: &Path, series: Series<'a>) -> Result<Self, FormatError> {
        let io = |error| FormatError::write(path, error);
        let mut out = BufWriter::new(File::create(path).map_err(io)?);
        let columns = series.fields.iter().map(|f| format!(",{}_{}", f.name, f.unit.to_lowercase()));
        writeln!(out, "time,node{}", columns.collect::<String>()).map_err(io)?;
        Ok(Self { path: path.into(), out, series })
    }
}

impl Sink for Csv<'_> {
    fn add(&mut self, _: usize, moment: &Moment) -> Result<(), FormatError> {
        let fields: Vec<&[f32]> =
            (0..self.series.fields.len()).map(|k| self.series.field(moment, k)).collect();
        let out = &mut self.out;
        (0..self.series.nodes)
            .try_for_each(|node| {
                write!(out, "{},{node}", moment.time)?;
                fields.iter().try_for_each(|field| write!(out, ",{}", field[node]))?;
                out.write_all(b"\n")
            })
            .map_err(|error| FormatError::write(&self.path, error))
    }

    fn finish(mut self: Box<Self>) -> Result<Vec<PathBuf>, FormatError> {
        self.out.flush().map_err(|error| FormatError::write(&self.path, error))?;
        Ok(vec![self.path])
    }
}
