//! The exchange's numbers: `u64` count, then so many `f64`, little-endian.

use crate::error::{Diagnostic, FormatError};
use crate::file;
use std::path::Path;

/// All numbers of a file.
pub(crate) fn read(path: &Path) -> Result<Vec<f64>, FormatError> {
    let bytes = file::read_bytes(path, file::MAX_DATA_BYTES)?;
    parse(&bytes).map_err(|diagnostic| FormatError::one(path, diagnostic))
}

/// [`read`], with the count that must be there.
pub(crate) fn read_of(path: &Path, expected: usize) -> Result<Vec<f64>, FormatError> {
    let values = read(path)?;
    if values.len() == expected {
        return Ok(values);
    }
    let wanted = format!("{expected} (nodes of points.bin x components of settings.json)");
    Err(FormatError::one(path, Diagnostic::new("count", wanted, values.len())))
}

/// The file's length must be what the count says; it is checked before anything is allocated.
fn parse(bytes: &[u8]) -> Result<Vec<f64>, Diagnostic> {
    let Some((head, body)) = bytes.split_first_chunk::<8>() else {
        return Err(Diagnostic::new("count", "8 bytes", bytes.len()));
    };
    let count = u64::from_le_bytes(*head);
    if (count as u128) * 8 != body.len() as u128 {
        return Err(Diagnostic::new("length", format!("8 bytes for each of {count} numbers"), body.len()));
    }
    let values: Vec<f64> = body.as_chunks().0.iter().map(|b| f64::from_le_bytes(*b)).collect();
    match values.iter().position(|value| !value.is_finite()) {
        Some(at) => Err(Diagnostic::new(format!("number {at}"), "finite numbers", values[at])),
        None => Ok(values),
    }
}

#[cfg(test)]
#[path = "../../../tests/unit/database_ansys_array.rs"]
mod tests;
