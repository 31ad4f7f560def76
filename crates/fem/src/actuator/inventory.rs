//! Named parts of a mesh file, with their sizes and what each is to the actuator.

use super::file::Actuator;
use crate::algebra::{Vec3, add, axpy, cross, dot, norm, scale, sub};
use crate::mesh::{Boundary, closed, enclosed};
use formats::mesh_file::{MeshFile, TRI_FACETS, Tri6};
use formats::{FormatError, read_mesh};
use serde::Serialize;
use std::path::Path;

/// Named volume or surface of a mesh file.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct NamedPart {
    /// Name in the file.
    pub name: String,
    /// True for a volume.
    #[serde(rename = "volume")]
    pub is_volume: bool,
    /// Number of tetrahedra or triangles.
    pub elements: usize,
    /// Volume (mm3) or area (mm2).
    pub size: f64,
    /// Of a surface the centroid of its area, or of the volume that it encloses (mm).
    pub centre_mm: Option<Vec3>,
    /// Volume that a surface encloses (mm3); `None` where it is open.
    pub encloses_mm3: Option<f64>,
    /// Use in `actuator.toml`, `None` if it has none.
    pub role: Option<String>,
}

impl Actuator {
    /// All named parts of the mesh file, volumes first.
    ///
    /// # Errors
    /// I/O error, not a mesh.
    pub fn inventory(&self, actuator_path: &Path) -> Result<Vec<NamedPart>, FormatError> {
        let file = read_mesh(&self.mesh_path(actuator_path))?;
        let boundary = Boundary::new(&file.tets);
        let volumes = file.volumes.iter().map(|(name, elements)| NamedPart {
            name: name.clone(),
            is_volume: true,
            elements: elements.len(),
            size: elements.iter().map(|e| volume_mm3(&file, *e as usize)).sum(),
            centre_mm: None,
            encloses_mm3: None,
            role: Some(self.material_of(name)),
        });
        let surfaces = file.surfaces.iter().map(|(name, triangles)| {
            let facets = || triangles.iter().flat_map(|t| TRI_FACETS.map(|facet| facet.map(|k| t[k])));
            let (size, centre_mm) = area(&file, facets());
            let held = hollow(&file, &boundary, triangles);
            NamedPart {
                name: name.clone(),
                is_volume: false,
                elements: triangles.len(),
                size,
                centre_mm: Some(held.map_or(centre_mm, |(_, centre_mm)| centre_mm)),
                encloses_mm3: held.map(|(volume_mm3, _)| volume_mm3),
                role: self.role_of(name),
            }
        });
        Ok(volumes.chain(surfaces).collect())
    }

    /// Names in `actuator.toml` of a part of the file.
    fn names_of<'a>(&'a self, name: &'a str) -> impl Iterator<Item = &'a str> {
        let renamed = self.mesh.names.iter().filter(move |(_, written)| *written == name);
        renamed.map(|(own, _)| own.as_str()).chain([name])
    }

    fn material_of(&self, name: &str) -> String {
        let material = self.names_of(name).find(|name| self.materials.contains_key(*name));
        material.map_or("elastomer".into(), |name| format!("materials.{name}"))
    }

    fn role_of(&self, name: &str) -> Option<String> {
        let roles: Vec<String> = self.names_of(name).filter_map(|name| self.role(name)).collect();
        (!roles.is_empty()).then(|| roles.join(", "))
    }

    fn role(&self, name: &str) -> Option<String> {
        let slot = ["slot_lower_", "slot_upper_"].iter().any(|start| name.starts_with(start));
        match name {
            name if name == self.support.fixed => Some("held (support.fixed)".into()),
            "cavity" => Some("walls of the cavity, pressure_mpa".into()),
            "sheet" => self.sheet.map(|_| "sheet".into()),
            "bottom" => self.obstacle.as_ref().map(|_| "touches the obstacle".into()),
            _ if slot => Some("touches its counterpart".into()),
            _ => {
                let cavity =
                    name.strip_prefix("cavity.").filter(|name| self.pressure_mpa.contains_key(*name));
                let film = name.strip_prefix("film.").filter(|name| self.films.contains_key(*name));
                let cavity = cavity.map(|name| format!("walls of a cavity, pressure_mpa.{name}"));
                cavity.or_else(|| film.map(|name| format!("films.{name}")))
            }
        }
    }
}

fn volume_mm3(file: &MeshFile, element: usize) -> f64 {
    let [a, b, c, d] = [0, 1, 2, 3].map(|k| file.points_mm[file.tets[element][k] as usize]);
    dot(cross(sub(b, a), sub(c, a)), sub(d, a)) / 6.0
}

/// Area of facets (mm2) and its centroid (mm).
fn area(file: &MeshFile, facets: impl Iterator<Item = [u32; 3]>) -> (f64, Vec3) {
    let (mut area, mut moment) = (0.0, [0.0; 3]);
    for facet in facets {
        let [a, b, c] = facet.map(|n| file.points_mm[n as usize]);
        let area_mm2 = 0.5 * norm(cross(sub(b, a), sub(c, a)));
        axpy(area_mm2 / 3.0, add(add(a, b), c), &mut moment);
        area += area_mm2;
    }
    (area, scale(1.0 / area, moment))
}

/// Volume that walls of the body enclose (mm3) and its centroid; `None` where they are open.
fn hollow(file: &MeshFile, boundary: &Boundary, walls: &[Tri6]) -> Option<(f64, Vec3)> {
    let walls: Vec<Tri6> = walls.iter().map(|t| boundary.outward(t)).collect::<Option<_>>()?;
    closed(walls.iter().map(|t| [t[0], t[1], t[2]])).ok()?;
    let facets: Vec<[u32; 3]> =
        walls.iter().flat_map(|t| TRI_FACETS.map(|facet| facet.map(|k| t[k]))).collect();
    let (volume, centre_mm) = enclosed(&file.points_mm, &facets);
    Some((volume.abs(), centre_mm))
}
