//! All states as one NumPy array: f32, states x nodes x fields, as `snapshots.npy` of a database.

use super::{Moment, Series, Sink};
use crate::error::FormatError;
use crate::npy;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

pub struct NpyStack<'a> {
    path: PathBuf,
    out: BufWriter<File>,
    series: Series<'a>,
}

impl<'a> NpyStack<'a> {
    pub fn new(path: &Path, series: Series<'a>) -> Result<Self, FormatError> {
        let io = |error| FormatError::write(path, error);
        let mut out = BufWriter::new(File::create(path).map_err(io)?);
        npy::write_f32_to(&mut out, &[series.count, series.nodes, series.fields.len()], &[]).map_err(io)?;
        Ok(Self { path: path.into(), out, series })
    }
}

impl Sink for NpyStack<'_> {
    fn add(&mut self, _: usize, moment: &Moment) -> Result<(), FormatError> {
        let (nodes, fields) = (self.series.nodes, self.series.fields.len());
        let at = |node| (0..fields).map(move |field| moment.values[field * nodes + node]);
        let bytes: Vec<u8> = (0..nodes).flat_map(at).flat_map(f32::to_le_bytes).collect();
        self.out.write_all(&bytes).map_err(|error| FormatError::write(&self.path, error))
    }

    fn finish(mut self: Box<Self>) -> Result<Vec<PathBuf>, FormatError> {
        self.out.flush().map_err(|error| FormatError::write(&self.path, error))?;
        Ok(vec![self.path])
    }
}
