//! What a mesh file holds, whatever its format: nodes, 10-node tetrahedra, named surfaces.

use crate::error::{Diagnostic, FormatError};
use crate::import::abaqus;
use crate::{msh, vtu};
use std::collections::BTreeMap;
use std::path::Path;

/// A second-order tetrahedral mesh as read. Indices are 0-based and below the number of nodes; nothing else is checked.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MeshFile {
    /// Node positions, mm.
    pub points_mm: Vec<[f64; 3]>,
    /// Tetrahedra: four corners, then the mid-sides of 01, 12, 02, 03, 13, 23.
    pub tets: Vec<[u32; 10]>,
    /// Triangles of each named surface: three corners, then the mid-sides of 01, 12, 20.
    pub surfaces: BTreeMap<String, Vec<[u32; 6]>>,
}

/// Reads a mesh of 10-node tetrahedra: `.vtu`, gmsh's `.msh` or Abaqus' `.inp`, by the name's end.
///
/// # Errors
/// Another ending, or what the format's own reader refuses.
pub fn read(path: &Path) -> Result<MeshFile, FormatError> {
    match path.extension().and_then(|ending| ending.to_str()) {
        Some("vtu") => vtu::read(path),
        Some("msh") => msh::read(path),
        Some("inp") => abaqus::read(path)?.tetrahedra().map_err(|problem| FormatError::one(path, problem)),
        other => {
            let found = other.unwrap_or("no ending");
            Err(FormatError::one(
                path,
                Diagnostic::new("file name", "an ending of .vtu, .msh or .inp", found),
            ))
        }
    }
}
