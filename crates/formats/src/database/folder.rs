//! The project's layout: `database.toml`, `cases.csv`, `snapshots.npy` or packed, `mesh.vtu`.

use super::arrays;
use super::cases::{self, CaseRow, ObstacleKind};
use super::manifest::{FILE, Input, Manifest};
use crate::error::{Diagnostic, FormatError};
use crate::{file, npy, vtu};
use rom::snapshots::Database;
use std::path::Path;

const UNDEFORMED_BY: &str = "undeformed_by.npy";

/// Reads the cases of one kind of obstacle.
pub(super) fn read(dir: &Path, obstacle: ObstacleKind) -> Result<Database, FormatError> {
    let manifest = Manifest::read(&dir.join(FILE))?;
    let cases_path = dir.join(&manifest.cases);
    let cases = cases::read(&cases_path, &manifest)?;
    let fields = manifest.field_specs();
    let snapshots_path = dir.join(&manifest.snapshots);
    let mesh = manifest.mesh.as_ref().map(|file| dir.join(file));
    let array = arrays::read_snapshots(&snapshots_path, mesh.as_deref())?;
    let expected = [cases.len(), manifest.nodes, fields.len()];
    if array.shape != expected {
        let expected = format!("{expected:?} (cases in {}, nodes and fields in {FILE})", manifest.cases);
        let diagnostic = Diagnostic::new("shape", expected, format!("{:?}", array.shape));
        return Err(FormatError::one(&snapshots_path, diagnostic));
    }
    let derivatives = arrays::read_sensitivities(dir, &manifest, &cases)?;
    let kept: Vec<bool> = cases.iter().map(|row| row.obstacle == obstacle).collect();
    let (mut snapshots, entries) = (Vec::with_capacity(array.values.len()), manifest.nodes * fields.len());
    for (_, snapshot) in kept.iter().zip(array.values.chunks_exact(entries.max(1))).filter(|(kept, _)| **kept)
    {
        snapshots.extend_from_slice(snapshot);
    }
    let case_of_obstacle = |row: CaseRow| (row.obstacle == obstacle).then_some(row.case);
    let cases: Vec<_> = cases.into_iter().filter_map(case_of_obstacle).collect();
    if cases.is_empty() {
        let expected = format!("cases of scene {}", obstacle.name());
        return Err(FormatError::one(&cases_path, Diagnostic::new("column regime", expected, "none")));
    }
    let node_count = manifest.nodes;
    let parameters = manifest.parameters();
    let moved = manifest.undeformed_by.as_ref();
    let moved = moved.map(|name| undeformed_by(&dir.join(name), parameters.len(), node_count)).transpose()?;
    let database = Database {
        actuator: manifest.actuator,
        fields,
        node_count,
        cases,
        parameters,
        snapshots,
        undeformed_by: moved.unwrap_or_default(),
        sensitivities: derivatives.map(|found| arrays::of_cases(found, &kept, node_count)),
        obstacle: manifest.obstacle.unwrap_or(obstacle.footprint()),
        ..Database::default()
    };
    let mut database = arrays::complete(database, mesh.as_deref())?;
    database.node_sets.extend(manifest.node_set);
    Ok(database)
}

/// Reads the derivative of the undeformed mesh with respect to each parameter.
fn undeformed_by(path: &Path, parameters: usize, nodes: usize) -> Result<Vec<Vec<[f32; 3]>>, FormatError> {
    let array = npy::read_f32(path)?;
    let expected = [parameters, nodes, 3];
    if array.shape != expected || array.data.iter().any(|v| !v.is_finite()) {
        let expected = format!("{expected:?} finite values (parameters and nodes of {FILE})");
        return Err(FormatError::one(path, Diagnostic::new("shape", expected, format!("{:?}", array.shape))));
    }
    let (points, _) = array.data.as_chunks::<3>();
    Ok(points.chunks_exact(nodes).map(<[_]>::to_vec).collect())
}

/// Kinds of obstacle with cases in a folder.
///
/// # Errors
/// As [`super::read`], for the manifest and the table of cases.
pub fn obstacle_kinds(dir: &Path) -> Result<Vec<ObstacleKind>, FormatError> {
    let manifest = Manifest::read(&dir.join(FILE))?;
    let cases = cases::read(&dir.join(&manifest.cases), &manifest)?;
    let present = |kind: &ObstacleKind| cases.iter().any(|row| row.obstacle == *kind);
    Ok(ObstacleKind::ALL.into_iter().filter(present).collect())
}

/// Writes a database folder; `cells` of the undeformed mesh make the mesh file. Existing files are replaced.
pub fn write(dir: &Path, database: &Database, cells: vtu::Cells<'_>) -> Result<(), FormatError> {
    file::create_folder(dir)?;
    let mut manifest = Manifest::new(&database.actuator, database.node_count, &database.fields);
    manifest.obstacle = Some(database.obstacle);
    if let (Some(points), false) = (&database.undeformed_mm, cells.is_empty()) {
        manifest.mesh = Some("mesh.vtu".into());
        let grid = vtu::Grid { points_mm: points, cells, point_data: &[] };
        vtu::write(&dir.join("mesh.vtu"), &grid)?;
    }
    manifest.input.extend(database.parameters.iter().map(|p| Input {
        name: p.name.clone(),
        unit: p.unit.clone(),
        nominal: Some(p.nominal),
    }));
    if !database.undeformed_by.is_empty() {
        manifest.undeformed_by = Some(UNDEFORMED_BY.into());
        let values: Vec<f32> =
            database.undeformed_by.iter().flat_map(|by| by.as_flattened()).copied().collect();
        let shape = [database.parameters.len(), database.node_count, 3];
        npy::write_f32(&dir.join(UNDEFORMED_BY), &shape, &values)?;
    }
    if let Some(derivatives) = &database.sensitivities {
        arrays::write_sensitivities(dir, &mut manifest, database, derivatives)?;
    }
    cases::write(&dir.join(&manifest.cases), database)?;
    let shape = [database.cases.len(), database.node_count, database.fields.len()];
    npy::write_f32(&dir.join(&manifest.snapshots), &shape, &database.snapshots)?;
    manifest.write(&dir.join(FILE))
}
