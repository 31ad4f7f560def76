//! Our database folder: `database.toml`, `cases.csv`, `snapshots.npy` (f32, cases x nodes x fields) and `mesh.vtu`.
//!
//! [`read`] checks every file against the others and reports all that is wrong at once; [`write`] makes a folder that
//! [`read`] accepts. The physics of the numbers (NaN, duplicates, constants) is judged by training, not here.

mod cases;
mod manifest;
mod mesh;

pub use cases::ObstacleKind;
pub use manifest::{Extra, Kind, Manifest};
pub use mesh::{bottom_nodes, surface_of_tets};

use crate::error::{Diagnostic, FormatError};
use crate::import::ansys;
use crate::packed::{self, Snapshots};
use crate::{authors, npy, vtu};
use cases::Table;
use rom::snapshots::{Case, Database, FieldSpec, Footprint};
use std::path::Path;

/// Ending of packed snapshots, see [`packed`].
pub const PACKED: &str = "pack";

/// Reads the cases of one scene from a database folder: ours, or (with an `authors.toml`) the authors', or the exchange
/// of Ansys' static reduced-order models. `O(bytes)`.
///
/// # Errors
/// A file that cannot be read, or everything that is wrong with the folder's files and with how they fit together.
pub fn read(dir: &Path, scene: ObstacleKind) -> Result<Database, FormatError> {
    if !dir.join(manifest::FILE).exists() {
        if dir.join(authors::FILE).exists() {
            return authors::read(dir, scene);
        }
        if ansys::is_exchange(dir) {
            return ansys::read(dir, scene);
        }
    }
    let manifest = Manifest::read(&dir.join(manifest::FILE))?;
    let table = Table::read(&dir.join(&manifest.cases), &manifest)?;
    let fields = manifest.field_specs();
    let snapshots_path = dir.join(&manifest.snapshots);
    let mesh = manifest.mesh.as_ref().map(|file| dir.join(file));
    let array = read_snapshots(&snapshots_path, mesh.as_deref())?;
    let expected = [table.rows.len(), manifest.nodes, fields.len()];
    if array.shape != expected {
        let problem = Diagnostic::new(
            "shape",
            format!("{expected:?} (cases in {}, nodes and fields in {})", manifest.cases, manifest::FILE),
            format!("{:?}", array.shape),
        );
        return Err(FormatError::one(&snapshots_path, problem));
    }
    let (cases, snapshots) = select(table, scene, array.values, manifest.nodes * fields.len());
    if cases.is_empty() {
        let problem = Diagnostic::new("column regime", format!("cases of scene {}", scene.name()), "none");
        return Err(FormatError::one(&dir.join(&manifest.cases), problem));
    }
    let mut database =
        assemble(manifest.actuator, fields, manifest.nodes, cases, snapshots, mesh.as_deref(), scene)?;
    database.obstacle = manifest.obstacle.unwrap_or(database.obstacle);
    Ok(database)
}

/// Puts the parts of a database together and takes its hash.
pub(crate) fn assemble(
    actuator: String,
    fields: Vec<FieldSpec>,
    node_count: usize,
    cases: Vec<Case>,
    snapshots: Vec<f32>,
    mesh: Option<&Path>,
    scene: ObstacleKind,
) -> Result<Database, FormatError> {
    let body = mesh.map(|path| mesh::read(path, node_count)).transpose()?;
    let has_mesh = body.is_some();
    let body = body.unwrap_or_default();
    let mut database = Database {
        actuator,
        fields,
        node_count,
        cases,
        snapshots,
        undeformed_mm: has_mesh.then_some(body.points_mm),
        surface_triangles: body.triangles,
        node_sets: body.node_sets,
        obstacle: scene.obstacle(),
        hash: [0; 32],
    };
    database.hash = database.content_hash();
    Ok(database)
}

/// Snapshots as an array or, by the ending [`PACKED`], packed; then the mesh gives what follows from it.
///
/// # Errors
/// Not readable, or not of three dimensions.
pub fn read_snapshots(path: &Path, mesh: Option<&Path>) -> Result<Snapshots, FormatError> {
    if path.extension().is_some_and(|e| e == PACKED) {
        let mesh = mesh.map(vtu::read).transpose()?;
        return packed::read(path, mesh.as_ref().map(|m| m.points_mm.as_slice()));
    }
    let array = npy::read_f32(path)?;
    let shape = <[usize; 3]>::try_from(array.shape).map_err(|found| {
        FormatError::one(path, Diagnostic::new("shape", "cases x nodes x fields", format!("{found:?}")))
    })?;
    Ok(Snapshots { shape, values: array.data })
}

/// Keeps the scene's cases and their snapshots, in file order.
fn select(table: Table, scene: ObstacleKind, all: Vec<f32>, entries: usize) -> (Vec<Case>, Vec<f32>) {
    let mut snapshots = Vec::with_capacity(all.len());
    let mut cases = Vec::with_capacity(table.rows.len());
    for (row, snapshot) in table.rows.into_iter().zip(all.chunks_exact(entries.max(1))) {
        if let Some(case) = row.in_scene(scene) {
            cases.push(case);
            snapshots.extend_from_slice(snapshot);
        }
    }
    (cases, snapshots)
}

/// Scenes for which a folder has cases: what `--scene` can choose.
///
/// # Errors
/// As [`read`], for the manifest and the table of cases.
pub fn scenes(dir: &Path) -> Result<Vec<ObstacleKind>, FormatError> {
    let manifest = Manifest::read(&dir.join(manifest::FILE))?;
    let table = Table::read(&dir.join(&manifest.cases), &manifest)?;
    Ok(ObstacleKind::ALL
        .into_iter()
        .filter(|scene| table.rows.iter().any(|row| row.scene() == *scene))
        .collect())
}

/// Writes a database folder; `tets` (10 nodes each, VTK order) makes the mesh file. Existing files are replaced.
///
/// # Errors
/// The operating system's.
pub fn write(dir: &Path, database: &Database, tets: &[[u32; 10]]) -> Result<(), FormatError> {
    std::fs::create_dir_all(dir).map_err(|e| FormatError::write(dir, e))?;
    let mut manifest = Manifest::of(database);
    if let (Some(points), false) = (&database.undeformed_mm, tets.is_empty()) {
        manifest.mesh = Some("mesh.vtu".into());
        let grid = vtu::Grid { points_mm: points, cells: vtu::Cells::QuadraticTets(tets), point_data: &[] };
        vtu::write(&dir.join("mesh.vtu"), &grid)?;
    }
    cases::write(&dir.join(&manifest.cases), &database.cases)?;
    let shape = [database.cases.len(), database.node_count, database.fields.len()];
    npy::write_f32(&dir.join(&manifest.snapshots), &shape, &database.snapshots)?;
    manifest.write(&dir.join(manifest::FILE))
}

impl ObstacleKind {
    /// What the actuator can touch in this scene, unless the database says otherwise.
    fn obstacle(self) -> Footprint {
        match self {
            Self::Plate => Footprint::PLATE,
            Self::Gripper => Footprint::BLOCK,
        }
    }
}
