//! Databases of snapshots: the project's folder and the authors' tables.
//!
//! [`read`] checks every file against the others and reports all errors; [`write()`] makes a folder that [`read`] accepts. Training
//! checks the values (NaN, duplicates, constants).

mod arrays;
mod authors;
mod cases;
mod folder;
mod manifest;

pub use arrays::{PACKED, bottom_nodes, pack_sensitivities, read_snapshots};
pub use cases::{ANY_REGIME, ObstacleKind, REGIMES, SPLITS};
pub use folder::{obstacle_kinds, write};
pub use manifest::{Extra, Field, Input, Manifest, StoredKind};

use crate::error::FormatError;
use rom::snapshots::Database;
use std::path::Path;

/// Reads the cases of one kind of obstacle from a database folder: the project's, or (with an `authors.toml`) the
/// authors'. `O(bytes)`.
///
/// # Errors
/// A file that cannot be read, or all errors in the folder's files and between them.
pub fn read(dir: &Path, obstacle: ObstacleKind) -> Result<Database, FormatError> {
    if !dir.join(manifest::FILE).exists() && dir.join(authors::FILE).exists() {
        return authors::read(dir, obstacle);
    }
    folder::read(dir, obstacle)
}
