//! Mesh of an actuator, from its file or on a grid.

use super::file::Actuator;
use super::{grid, surfaces};
use crate::mesh::{self, Mesh, Slot};
use formats::file::named_in;
use formats::mesh_file::{MeshFile, Tri6};
use formats::{Diagnostic, FormatError, msh, vtu};
use std::path::Path;

impl Actuator {
    /// Reads the mesh that the file at `actuator_path` names, and checks it. A `.msh` names its surfaces as the mesh
    /// script does; a `.vtu` has no names, and its surfaces are found by their position.
    ///
    /// # Errors
    /// I/O error, not a mesh, or all errors in the mesh.
    pub fn read_mesh(&self, actuator_path: &Path) -> Result<Mesh, FormatError> {
        let path = named_in(actuator_path, &self.mesh.file);
        let file = match path.extension().and_then(|ending| ending.to_str()) {
            Some("msh") => msh::read(&path)?,
            Some("vtu") => {
                let mut file = vtu::read(&path)?;
                file.surfaces = surfaces::locate(self, &file.points_mm, &file.tets);
                file
            }
            _ => {
                let expected = "a .msh or a .vtu (scripts/mesh.py and `softtwin mesh` make them)";
                let diagnostic = Diagnostic::new("file name", expected, path.display());
                return Err(FormatError::one(&path, diagnostic));
            }
        };
        let (mesh, diagnostics) = self.checked(file);
        let mesh = FormatError::check(mesh, &path, diagnostics)?;
        let (found, expected) = (mesh.nodes_mm.len(), self.mesh.nodes);
        if expected != 0 && found != expected {
            let expected = format!("{expected} (mesh.nodes in actuator.toml)");
            return Err(FormatError::one(&path, Diagnostic::new("nodes", expected, found)));
        }
        Ok(mesh)
    }

    /// Mesh on a grid: planes through every face of the actuator, the boxes between them divided until none is
    /// longer than `size_mm`, then each into `times` parts along each axis. Cost: linear in the elements.
    ///
    /// # Errors
    /// An invalid size, 0 times, more boxes than can be solved, or all errors in the mesh.
    pub fn grid_mesh(&self, size_mm: f64, times: usize) -> Result<Mesh, Vec<Diagnostic>> {
        let file = grid::mesh(self, size_mm, times).map_err(|diagnostic| vec![diagnostic])?;
        let (mesh, diagnostics) = self.checked(file);
        if diagnostics.is_empty() { Ok(mesh) } else { Err(diagnostics) }
    }

    fn checked(&self, file: MeshFile) -> (Mesh, Vec<Diagnostic>) {
        let (mesh, mut diagnostics) = named(file, self.chambers.count - 1);
        diagnostics.extend(mesh::diagnostics(&mesh));
        (mesh, diagnostics)
    }
}

/// Sorts named surfaces into their roles; a diagnostic for each that is missing.
pub(crate) fn named(mut file: MeshFile, slots: usize) -> (Mesh, Vec<Diagnostic>) {
    let present: Vec<String> = file.surfaces.keys().cloned().collect();
    let mut diagnostics = Vec::new();
    let mut take = |name: &str| -> Vec<Tri6> {
        let triangles = file.surfaces.remove(name).unwrap_or_default();
        if triangles.is_empty() {
            let found = if present.is_empty() { "no names".into() } else { present.join(", ") };
            let expected = "6-node triangles in a physical surface of that name (.msh) or on that face of the geometry in actuator.toml (.vtu)";
            diagnostics.push(Diagnostic::new(format!("surface {name}"), expected, found));
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
    (mesh, diagnostics)
}
