//! Reads a mesh in any of the formats known here.

use crate::error::{Diagnostic, FormatError};
use crate::mesh_file::MeshFile;
use crate::{abaqus, msh, vtu};
use std::path::Path;

/// Reads a mesh of 10-node tetrahedra: `.vtu`, gmsh's `.msh` or Abaqus' `.inp`, by the ending of its name.
///
/// # Errors
/// Another ending, or what the reader of the format refuses.
pub fn read_mesh(path: &Path) -> Result<MeshFile, FormatError> {
    match path.extension().and_then(|ending| ending.to_str()) {
        Some("vtu") => vtu::read(path),
        Some("msh") => msh::read(path),
        Some("inp") => {
            abaqus::read(path)?.tetrahedra().map_err(|diagnostic| FormatError::one(path, diagnostic))
        }
        other => {
            let (expected, found) = ("an ending of .vtu, .msh or .inp", other.unwrap_or("no ending"));
            Err(FormatError::one(path, Diagnostic::new("file name", expected, found)))
        }
    }
}
