//! From a mesh file to a [`Mesh`] with its named surfaces.

use super::{Mesh, Slot, Tri6, check, surfaces};
use crate::actuator::Actuator;
use formats::mesh_file::MeshFile;
use formats::{Diagnostic, FormatError, msh, vtu};
use std::path::Path;

/// Reads the mesh of an actuator and checks it. A `.msh` names its surfaces as the mesh script does; in a `.vtu`, which
/// carries no names, they are found by where they lie.
///
/// # Errors
/// Not readable, another kind of file, or everything that is wrong with the mesh.
pub fn read_mesh(path: &Path, actuator: &Actuator) -> Result<Mesh, FormatError> {
    let file = match path.extension().and_then(|e| e.to_str()) {
        Some("msh") => msh::read(path)?,
        Some("vtu") => {
            let mut file = vtu::read(path)?;
            file.surfaces = surfaces::locate(actuator, &file.points_mm, &file.tets);
            file
        }
        _ => {
            let expected = "a .msh or a .vtu (scripts/mesh.sh and `softtwin mesh` make them)";
            return Err(FormatError::one(path, Diagnostic::new("file name", expected, path.display())));
        }
    };
    let (mesh, mut problems) = named(file, actuator.chambers.count - 1);
    problems.extend(check::problems(&mesh));
    FormatError::unless(mesh, path, problems)
}

/// Sorts named surfaces into their roles; what is missing is a problem each.
pub fn named(mut file: MeshFile, slots: usize) -> (Mesh, Vec<Diagnostic>) {
    let present: Vec<String> = file.surfaces.keys().cloned().collect();
    let mut problems = Vec::new();
    let mut take = |name: &str| -> Vec<Tri6> {
        let triangles = file.surfaces.remove(name).unwrap_or_default();
        if triangles.is_empty() {
            let found = if present.is_empty() { "no names".into() } else { present.join(", ") };
            let expected = "6-node triangles in a physical surface of that name (.msh) or on that face of the geometry in actuator.toml (.vtu)";
            problems.push(Diagnostic::new(format!("surface {name}"), expected, found));
        }
        triangles
    };
    let mut fixed_nodes: Vec<u32> = take("fixed").into_flattened();
    fixed_nodes.sort_unstable();
    fixed_nodes.dedup();
    let mesh = Mesh {
        sheet: take("sheet"),
        cavity: take("cavity"),
        fixed_nodes,
        bottom: take("bottom"),
        slots: (0..slots)
            .map(|i| Slot {
                lower: take(&format!("slot_lower_{i}")),
                upper: take(&format!("slot_upper_{i}")),
            })
            .collect(),
        nodes_mm: file.points_mm,
        tets: file.tets,
        ..Mesh::default()
    };
    (mesh, problems)
}
