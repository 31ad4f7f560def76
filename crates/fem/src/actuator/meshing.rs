//! Mesh of an actuator, from its file or on a grid.
//!
//! Roles of surfaces by their names: `cavity` and `cavity.NAME` (pressures), `sheet`, `film.NAME`, `bottom` (touches the obstacle),
//! `slot_lower_NAME` and `slot_upper_NAME` (walls that touch each other), and the held surface that `support.fixed` names.

use super::file::Actuator;
use super::{grid, surfaces};
use crate::mesh::{self, Mesh, Slot};
use formats::file::named_in;
use formats::mesh_file::{MeshFile, Tri6};
use formats::{Diagnostic, FormatError, read_mesh, vtu};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Why a mesh on a grid could not be written.
#[derive(Debug, thiserror::Error)]
pub enum GridError {
    /// The size does not suit the actuator.
    #[error("--size-mm: {}", .0.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n  "))]
    Size(Vec<Diagnostic>),
    /// The file could not be written.
    #[error("the mesh was not written")]
    File(#[from] FormatError),
}

/// Name of the held surface in a mesh of boxes.
const FIXED: &str = "fixed";

impl Actuator {
    /// Path of the mesh file of an actuator file.
    pub fn mesh_path(&self, actuator_path: &Path) -> PathBuf {
        named_in(actuator_path, &self.mesh.file)
    }

    /// Reads the mesh that the file at `actuator_path` names, and checks it. Names of surfaces and volumes are those of the file; a
    /// `.vtu` without groups has none, and those of the boxes are found by their position.
    ///
    /// # Errors
    /// I/O error, not a mesh, or all errors in the mesh.
    pub fn read_mesh(&self, actuator_path: &Path) -> Result<Mesh, FormatError> {
        let path = self.mesh_path(actuator_path);
        self.mesh_of(&path, read_mesh(&path)?)
    }

    /// The mesh of an actuator from the content of the mesh file at `path`, checked as by [`Actuator::read_mesh`].
    pub(crate) fn mesh_of(&self, path: &Path, content: MeshFile) -> Result<Mesh, FormatError> {
        let (mesh, diagnostics) = self.checked(self.named_file(content));
        let mesh = FormatError::check(mesh, path, diagnostics)?;
        let (found, expected) = (mesh.nodes_mm.len(), self.mesh.nodes);
        if expected != 0 && found != expected {
            let expected = format!("{expected} (mesh.nodes in actuator.toml)");
            return Err(FormatError::one(path, Diagnostic::new("nodes", expected, found)));
        }
        Ok(mesh)
    }

    /// Content of a mesh file with the names of `actuator.toml`.
    fn named_file(&self, mut file: MeshFile) -> MeshFile {
        if let (true, Some(shape)) = (file.surfaces.is_empty() && file.volumes.is_empty(), self.shape()) {
            file.surfaces = surfaces::locate(&shape, &file.points_mm, &file.tets);
            file.volumes = surfaces::volumes(&shape, &file.points_mm, &file.tets);
        }
        for (name, written) in &self.mesh.names {
            // Names are exchanged, not moved: two may be swapped, and none is lost.
            if let Some(triangles) = file.surfaces.get(written).cloned() {
                file.surfaces.insert(name.clone(), triangles);
            }
            if let Some(elements) = file.volumes.get(written).cloned() {
                file.volumes.insert(name.clone(), elements);
            }
        }
        file
    }

    /// Mesh on a grid: planes through every face of the actuator, the boxes between them divided until none is
    /// longer than `size_mm`, then each into `times` parts along each axis. Cost: linear in the elements.
    ///
    /// # Errors
    /// No boxes, an invalid size, 0 times, more boxes than can be solved, or all errors in the mesh.
    pub fn grid_mesh(&self, size_mm: f64, times: usize) -> Result<Mesh, Vec<Diagnostic>> {
        let Some(shape) = self.shape() else {
            let expected =
                "base, body and chambers, from which a grid is made; the shape is that of mesh.file";
            return Err(vec![Diagnostic::new("boxes", expected, "none")]);
        };
        let file = grid::mesh(&shape, size_mm, times).map_err(|diagnostic| vec![diagnostic])?;
        let (mesh, diagnostics) = self.checked(file);
        if diagnostics.is_empty() { Ok(mesh) } else { Err(diagnostics) }
    }

    /// Writes the mesh on a grid as a `.vtu` and returns it.
    ///
    /// # Errors
    /// Those of [`Actuator::grid_mesh`]; I/O errors.
    pub fn write_grid(&self, size_mm: f64, out: &Path) -> Result<Mesh, GridError> {
        let mesh = self.grid_mesh(size_mm, 1).map_err(GridError::Size)?;
        let cells = vtu::Cells::QuadraticTets(&mesh.tets);
        vtu::write(out, &vtu::Grid { points_mm: &mesh.nodes_mm, cells, point_data: &[] })?;
        Ok(mesh)
    }

    fn checked(&self, file: MeshFile) -> (Mesh, Vec<Diagnostic>) {
        let (mesh, mut diagnostics) = self.named(file);
        diagnostics.extend(mesh::diagnostics(&mesh));
        (mesh, diagnostics)
    }

    /// Sorts named surfaces and volumes into their roles; a diagnostic for each that is missing or has no counterpart.
    pub(crate) fn named(&self, mut file: MeshFile) -> (Mesh, Vec<Diagnostic>) {
        let listed = |names: Vec<&String>| match names.as_slice() {
            [] => "no names".to_owned(),
            names => names.iter().map(|name| name.as_str()).collect::<Vec<_>>().join(", "),
        };
        let present = listed(file.surfaces.keys().collect());
        let volumes = listed(file.volumes.keys().collect());
        let mut diagnostics = Vec::new();
        let slots = self.slot_names(&file);
        let (tet_material, wrong) = self.materials_of(&file, &volumes);
        diagnostics.extend(wrong);
        diagnostics.extend(self.unnamed(&file));
        let mut take = |name: &str| -> Vec<Tri6> {
            let triangles = file.surfaces.remove(name).unwrap_or_default();
            if triangles.is_empty() {
                let expected = "6-node triangles in a surface of that name (mesh.names gives the file's name of one), or on that \
                                face of the boxes";
                diagnostics.push(Diagnostic::new(format!("surface {name}"), expected, &present));
            }
            triangles
        };
        let fixed = if self.shape().is_some() { FIXED } else { self.support.fixed.as_str() };
        let mut fixed_nodes: Vec<u32> = take(fixed).into_flattened();
        fixed_nodes.sort_unstable();
        fixed_nodes.dedup();
        let mesh = Mesh {
            sheet: if self.sheet.is_some() { take("sheet") } else { Vec::new() },
            films: self.films.keys().map(|name| take(&format!("film.{name}"))).collect(),
            cavity: take("cavity"),
            cavities: self.pressure_mpa.keys().map(|name| take(&format!("cavity.{name}"))).collect(),
            fixed_nodes,
            bottom: if self.obstacle.is_some() { take("bottom") } else { Vec::new() },
            slots: slots
                .iter()
                .map(|name| Slot {
                    lower: take(&format!("slot_lower_{name}")),
                    upper: take(&format!("slot_upper_{name}")),
                })
                .collect(),
            nodes_mm: file.points_mm,
            tets: file.tets,
            tet_material,
            mises_owner: None,
        };
        (mesh, diagnostics)
    }

    /// Names of the pairs of walls: those of the boxes, or those in the file.
    fn slot_names(&self, file: &MeshFile) -> Vec<String> {
        if let Some(shape) = self.shape() {
            let rows = 1 + usize::from(shape.chambers.opposite.is_some());
            let count = shape.slots.map_or(0, |_| rows * (shape.chambers.count - 1));
            return (0..count).map(|i| i.to_string()).collect();
        }
        let slot_number = |name: &String| {
            let rest = name.strip_prefix("slot_lower_").or_else(|| name.strip_prefix("slot_upper_"));
            rest.map(str::to_owned)
        };
        file.surfaces.keys().filter_map(slot_number).collect::<BTreeSet<_>>().into_iter().collect()
    }

    /// Material of each tetrahedron: 0 is `elastomer`, then those of the named volumes.
    fn materials_of(&self, file: &MeshFile, present: &str) -> (Vec<u16>, Vec<Diagnostic>) {
        if self.materials.is_empty() {
            return (Vec::new(), Vec::new());
        }
        let (mut material_of_tet, mut diagnostics) = (vec![0_u16; file.tets.len()], Vec::new());
        for (place, name) in self.materials.keys().enumerate() {
            let elements = file.volumes.get(name).filter(|elements| !elements.is_empty());
            let Some(elements) = elements else {
                diagnostics.push(Diagnostic::new(
                    format!("materials.{name}"),
                    "the name of a volume of the mesh",
                    present,
                ));
                continue;
            };
            for e in elements {
                let material = &mut material_of_tet[*e as usize];
                if *material != 0 {
                    let other = self.materials.keys().nth(usize::from(*material) - 1);
                    let found = format!("element {e} in {} as well", other.map_or("", String::as_str));
                    diagnostics.push(Diagnostic::new(
                        format!("volume {name}"),
                        "every element in one volume",
                        found,
                    ));
                    break;
                }
                *material = place as u16 + 1;
            }
        }
        (material_of_tet, diagnostics)
    }

    /// Cavities and films of the file without a pressure or material.
    fn unnamed(&self, file: &MeshFile) -> Vec<Diagnostic> {
        let mut diagnostics = Vec::new();
        for name in file.surfaces.keys() {
            let mut without = |known: bool, expected: String| {
                if !known {
                    diagnostics.push(Diagnostic::new(format!("surface {name}"), expected, "none"));
                }
            };
            if let Some(cavity) = name.strip_prefix("cavity.") {
                without(
                    self.pressure_mpa.contains_key(cavity),
                    format!("[pressure_mpa] {cavity} = 0.0 (MPa)"),
                );
            }
            if let Some(film) = name.strip_prefix("film.") {
                without(self.films.contains_key(film), format!("[films.{film}] with its material"));
            }
        }
        diagnostics
    }
}
