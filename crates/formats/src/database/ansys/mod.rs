//! The snapshot exchange of Ansys' static reduced-order models, as a database: a folder for each quantity, with
//!
//! * `settings.json`: name, unit and components of the quantity, and whether it deforms the points;
//! * `points.bin`: the undeformed nodes; `snapshots/*.bin`: one state each (both `u64` count, then `f64`, little-endian);
//! * `doe.csv`: a row a state: the snapshot's file, then the parameters (`pressure[MPa]`, `gap[mm]`, ...).
//!
//! One folder must deform the points; a second one may hold stress: a scalar is taken as von Mises stress, a symmetric
//! tensor (XX, YY, ZZ, XY, YZ, XZ) gives it. A column `contact_force[N]` is needed where there is a gap, because the
//! exchange has no place for forces; a column `split` (train, test, check) may be added. A `mesh.vtu`, `mesh.inp` or
//! `mesh.cdb` of the same nodes beside the folders gives the surface.

mod array;
mod design;
mod settings;

use super::assemble::Parts;
use super::mesh::bottom_nodes;
use super::words::ObstacleKind;
use crate::error::{Diagnostic, FormatError};
use design::Design;
use rom::snapshots::{Database, FieldSpec, NodeSet};
use settings::{Quantity, Settings};
use std::path::{Path, PathBuf};

const SETTINGS: &str = "settings.json";
const MESHES: [&str; 3] = ["mesh.vtu", "mesh.inp", "mesh.cdb"];

/// Whether a folder looks like this exchange: a sub-folder has `settings.json`.
pub(crate) fn is_exchange(dir: &Path) -> bool {
    !folders(dir).is_empty()
}

fn folders(dir: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(dir).into_iter().flatten().flatten();
    let mut found: Vec<PathBuf> =
        entries.map(|entry| entry.path()).filter(|path| path.join(SETTINGS).is_file()).collect();
    found.sort();
    found
}

/// One quantity's folder.
struct Folder {
    path: PathBuf,
    settings: Settings,
    design: Design,
}

impl Folder {
    fn read(path: PathBuf) -> Result<Self, FormatError> {
        let settings = Settings::read(&path.join(SETTINGS))?;
        let design = Design::read(&path.join("doe.csv"))?;
        Ok(Self { path, settings, design })
    }

    /// One state: `nodes x components`.
    fn snapshot(&self, case: usize, nodes: usize) -> Result<Vec<f64>, FormatError> {
        let path = self.path.join("snapshots").join(&self.design.files[case]);
        array::read_of(&path, nodes * self.settings.quantity.components())
    }
}

/// Reads the folders as one database. `O(bytes)`.
///
/// # Errors
/// Files that cannot be read, quantities that are neither a deformation nor a stress, units that are not known, tables
/// without pressure, folders that do not fit together.
pub(crate) fn read(dir: &Path, obstacle: ObstacleKind) -> Result<Database, FormatError> {
    let refuse = |place: &str, expected: &str, found: String| {
        Err(FormatError::one(dir, Diagnostic::new(place, expected, found)))
    };
    let all: Vec<Folder> = folders(dir).into_iter().map(Folder::read).collect::<Result<_, _>>()?;
    let names = || all.iter().map(|f| f.settings.name.clone()).collect::<Vec<_>>().join(", ");
    let deforms = |folder: &&Folder| folder.settings.quantity == Quantity::Deformation;
    let (moved, rest): (Vec<&Folder>, Vec<&Folder>) = all.iter().partition(deforms);
    let ([moved], [] | [_]) = (moved.as_slice(), rest.as_slice()) else {
        return refuse("folders", "one that deforms the points and at most one of stress", names());
    };
    if obstacle != ObstacleKind::Plate {
        return refuse("scene", "plate (the exchange has no other)", obstacle.name().into());
    }
    let stress = rest.first().copied();
    if let Some(stress) = stress.filter(|stress| stress.design != moved.design) {
        return refuse("doe.csv", "the same states in all folders", stress.path.display().to_string());
    }
    let points_mm = points(moved)?;
    let nodes = points_mm.len();
    let cases = moved.design.cases()?;
    let width = if stress.is_some() { 5 } else { 4 };
    let mut snapshots = Vec::with_capacity(cases.len() * nodes * width);
    for case in 0..cases.len() {
        let offsets = moved.snapshot(case, nodes)?;
        let stresses = stress.map(|folder| folder.snapshot(case, nodes)).transpose()?;
        for (node, point) in points_mm.iter().enumerate() {
            let u = [0, 1, 2].map(|k| moved.settings.factor * offsets[3 * node + k]);
            let size = u.iter().map(|v| v * v).sum::<f64>().sqrt();
            snapshots.extend([0, 1, 2].map(|k| (point[k] + u[k]) as f32));
            snapshots.push(size as f32);
            if let (Some(folder), Some(values)) = (stress, &stresses) {
                snapshots
                    .push((folder.settings.factor * folder.settings.quantity.von_mises(values, node)) as f32);
            }
        }
    }
    let mesh = MESHES.map(|name| dir.join(name)).into_iter().find(|path| path.is_file());
    let actuator = dir.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let parts = Parts {
        actuator,
        fields: fields(width),
        node_count: nodes,
        cases,
        parameters: Vec::new(),
        snapshots,
        undeformed_by: Vec::new(),
        sensitivities: None,
    };
    let mut database = parts.assemble(mesh.as_deref(), obstacle)?;
    if mesh.is_none() {
        database.node_sets = vec![NodeSet { name: "bottom".into(), nodes: bottom_nodes(&points_mm) }];
    }
    database.undeformed_mm = Some(points_mm);
    Ok(database)
}

/// The undeformed nodes in mm: in the unit of the deformation.
fn points(folder: &Folder) -> Result<Vec<[f64; 3]>, FormatError> {
    let path = folder.path.join("points.bin");
    let values = array::read(&path)?;
    let (points, rest) = values.as_chunks::<3>();
    if points.is_empty() || !rest.is_empty() {
        return Err(FormatError::one(&path, Diagnostic::new("count", "three numbers a node", values.len())));
    }
    let factor = folder.settings.factor;
    Ok(points.iter().map(|p| p.map(|v| factor * v)).collect())
}

fn fields(width: usize) -> Vec<FieldSpec> {
    let mut all = FieldSpec::of_the_paper();
    all.truncate(width);
    all
}
