//! Reads a mesh in any of the formats known here.

use crate::cells::{Block, CellKind};
use crate::error::FormatError;
use crate::file::unreadable;
use crate::mesh_file::MeshFile;
use crate::{abaqus, msh, vtu};
use std::path::Path;

/// Reads a mesh of 10-node tetrahedra: `.vtu`, gmsh's `.msh` or Abaqus' `.inp`, by the ending of its name.
///
/// # Errors
/// Another ending, or an error of the format's reader.
pub fn read_mesh(path: &Path) -> Result<MeshFile, FormatError> {
    match path.extension().and_then(|ending| ending.to_str()) {
        Some("vtu") => vtu::read(path),
        Some("msh") => msh::read(path),
        Some("inp") => {
            let mesh = abaqus::read(path)?;
            let solids = MeshFile::of_solids(mesh.points, &mesh.blocks);
            let solids = solids.map_err(|error| FormatError::one(path, error))?;
            Ok(MeshFile { surfaces: mesh.surfaces, volumes: mesh.volumes, ..solids })
        }
        _ => Err(unreadable(path, "a mesh as .vtu, .msh or .inp", "vtu")),
    }
}

/// Node positions, cells, and what was left out.
pub type Blocks = (Vec<[f64; 3]>, Vec<Block>, Vec<String>);

/// Node positions, cells of all kinds of a mesh and what was left out, by the ending of its name as [`read_mesh`].
///
/// # Errors
/// As [`read_mesh`].
pub fn read_blocks(path: &Path) -> Result<Blocks, FormatError> {
    match path.extension().and_then(|ending| ending.to_str()) {
        Some("vtu") => {
            vtu::read_content(path).map(|content| (content.points, content.blocks, content.left_out))
        }
        Some("inp") => abaqus::read(path).map(|mesh| (mesh.points, mesh.blocks, mesh.left_out)),
        _ => {
            let mesh = read_mesh(path)?;
            let mut blocks = Vec::new();
            if let Some(kind) = CellKind::of(24) {
                Block::add(&mut blocks, kind, mesh.tets.into_flattened());
            }
            Ok((mesh.points_mm, blocks, Vec::new()))
        }
    }
}
