//! Arrays of a database: as they are, or packed.

use crate::error::{Diagnostic, FormatError};
use crate::packed::{self, Snapshots};
use crate::{npy, vtu};
use std::path::Path;

/// Ending of packed snapshots, see [`packed`].
pub const PACKED: &str = "pack";

/// Snapshots as an array or, by the ending [`PACKED`], packed; then the mesh gives the fields that follow from it.
///
/// # Errors
/// Not readable, or not of three dimensions.
pub fn read_snapshots(path: &Path, mesh: Option<&Path>) -> Result<Snapshots, FormatError> {
    if path.extension().is_some_and(|e| e == PACKED) {
        let mesh = mesh.map(vtu::read).transpose()?;
        return packed::read(path, mesh.as_ref().map(|m| m.points_mm.as_slice()));
    }
    let array = npy::read_f32(path)?;
    let shape = <[usize; 3]>::try_from(array.shape).map_err(|found| {
        FormatError::one(path, Diagnostic::new("shape", "cases x nodes x fields", format!("{found:?}")))
    })?;
    Ok(Snapshots { shape, values: array.data })
}
