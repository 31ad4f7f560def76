//! Writes a series in the format given by the ending of the file name.

use super::series::{Layout, Moment, Series};
use super::{csv, npy, pvd, tecplot, xdmf};
use crate::error::{Diagnostic, FormatError};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SeriesFormat {
    /// One `.vtu` per state and a `.pvd` that lists them.
    Pvd,
    /// Tecplot ASCII, one zone per state.
    Tecplot,
    /// XDMF 3, a temporal collection with inline numbers.
    Xdmf,
    /// One row per node and state.
    Csv,
    /// NumPy: f32, states x nodes x fields.
    Npy,
}

impl SeriesFormat {
    /// Format by the ending of a file name.
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
                let found = other.unwrap_or("no ending");
                Err(FormatError::one(path, Diagnostic::new("file name", expected, found)))
            }
        }
    }

    fn layout<'a>(self, path: &Path, series: Series<'a>) -> Box<dyn Layout + 'a> {
        match self {
            Self::Pvd => Box::new(pvd::Pvd::new(path, series)),
            Self::Tecplot => Box::new(tecplot::Tecplot::new(series)),
            Self::Xdmf => Box::new(xdmf::Xdmf(series)),
            Self::Csv => Box::new(csv::Csv(series)),
            Self::Npy => Box::new(npy::Npy(series)),
        }
    }
}

impl Series<'_> {
    /// Writes the series in the format of the name's ending; returns the files written, `path` first. Cost and output are linear in
    /// states x nodes x fields.
    ///
    /// # Errors
    /// An unknown ending, an inconsistent series, an error among the states, or an I/O error.
    pub fn write<E: From<FormatError>>(
        &self,
        path: &Path,
        moments: impl Iterator<Item = Result<Moment, E>>,
    ) -> Result<Vec<PathBuf>, E> {
        FormatError::check((), path, self.diagnostics())?;
        let format = SeriesFormat::of(path)?;
        let mut layout = format.layout(path, *self);
        let refused = |error| FormatError::write(path, error);
        let mut out = BufWriter::new(File::create(path).map_err(refused)?);
        layout.begin(&mut out).map_err(refused)?;
        let mut written = 0;
        for moment in moments {
            let moment = moment?;
            self.check_length(&format!("state {written}"), &moment.values)
                .map_err(|diagnostic| FormatError::one(path, diagnostic))?;
            layout.state(&mut out, written, &moment).map_err(refused)?;
            written += 1;
        }
        if written != self.count {
            let diagnostic = Diagnostic::new("series", format!("{} states", self.count), written);
            return Err(FormatError::one(path, diagnostic).into());
        }
        layout.end(&mut out).and_then(|()| out.flush()).map_err(refused)?;
        let states = if format == SeriesFormat::Pvd { written } else { 0 };
        Ok(std::iter::once(path.into()).chain((0..states).map(|k| pvd::state_file(path, k))).collect())
    }
}
