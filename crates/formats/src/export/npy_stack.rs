//! All states as one NumPy array: f32, states x nodes x fields, as `snapshots.npy` of a database.

use super::Series;
use crate::error::FormatError;
use crate::npy;
use std::path::{Path, PathBuf};

/// Writes the array.
pub fn write(path: &Path, series: &Series<'_>) -> Result<Vec<PathBuf>, FormatError> {
    let fields = series.fields.len();
    let mut values = Vec::with_capacity(series.moments.len() * series.nodes * fields);
    for moment in series.moments {
        for node in 0..series.nodes {
            values.extend((0..fields).map(|field| moment.values[field * series.nodes + node]));
        }
    }
    npy::write_f32(path, &[series.moments.len(), series.nodes, fields], &values)?;
    Ok(vec![path.into()])
}
