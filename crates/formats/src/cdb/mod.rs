//! Ansys' archive of a model (`.cdb`, `CDWRITE,DB`): nodes, solids and shells.
//!
//! Read are the blocks `NBLOCK`, `EBLOCK` (with and without the word SOLID), `ETBLOCK` and the command `ET`; materials, components,
//! loads and the like are passed over. What would make further nodes or elements (`N`, `EN`, `EGEN`, `/INPUT`, ...) is refused
//! by its name.

mod columns;
mod element;
mod mesh;
mod reader;
mod shape;

pub use mesh::CdbMesh;

use crate::error::{Diagnostic, FormatError};
use crate::file;
use std::path::Path;

/// Reads a file.
///
/// # Errors
/// The operating system's refusal, or everything that is wrong with the content.
pub fn read(path: &Path) -> Result<CdbMesh, FormatError> {
    let bytes = file::read_bytes(path, file::MAX_DATA_BYTES)?;
    parse(&String::from_utf8_lossy(&bytes))
        .map_err(|diagnostics| FormatError::Content { path: path.into(), diagnostics })
}

/// [`read`] from memory. Cost and memory are linear in the text.
///
/// # Errors
/// Everything that is wrong, with line numbers; never empty.
pub fn parse(text: &str) -> Result<CdbMesh, Vec<Diagnostic>> {
    reader::read(text)
}
