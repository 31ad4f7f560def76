//! Reads a mesh in any of the formats known here.

use crate::cells::Block;
use crate::error::FormatError;
use crate::foreign;
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
        _ => Err(foreign::error(path, "a mesh as .vtu, .msh or .inp", "vtu")),
    }
}

/// Node positions and cells of all kinds of a mesh, by the ending of its name as [`read_mesh`].
///
/// # Errors
/// As [`read_mesh`].
pub fn read_blocks(path: &Path) -> Result<(Vec<[f64; 3]>, Vec<Block>), FormatError> {
    match path.extension().and_then(|ending| ending.to_str()) {
        Some("vtu") => vtu::read_content(path).map(|content| (content.points, content.blocks)),
        Some("inp") => abaqus::read(path).map(|mesh| {
            let blocks = mesh.blocks();
            (mesh.points, blocks)
        }),
        _ => read_mesh(path).map(|mesh| {
            let nodes = mesh.tets.into_flattened();
            (mesh.points_mm, vec![Block { kind: 24, nodes_per_cell: 10, nodes }])
        }),
    }
}
