//! The database folder: what `softtwin train --database` reads, plus the cavity volumes.

use super::cases::VOLUME_COLUMNS;
use super::{Case, Solved};
use crate::mesh::Mesh;
use crate::solver::FORMULATION;
use formats::database::{self, Manifest};
use formats::{Diagnostic, FormatError, npy, vtu};
use std::fs;
use std::path::Path;
use std::sync::Arc;

const CASE_COLUMNS: &str = "case,regime,split,pressure_mpa,gap_mm,contact_force_n";
const SNAPSHOTS: &str = "snapshots.npy";

/// Fields of a snapshot: name, unit, kind.
pub const FIELDS: [(&str, &str, &str); 5] = [
    ("x", "mm", "coordinate"),
    ("y", "mm", "coordinate"),
    ("z", "mm", "coordinate"),
    ("displacement", "mm", "magnitude"),
    ("von_mises", "MPa", "stress"),
];

/// `nodes x 5`: deformed coordinates, displacement magnitude (mm), von Mises stress (MPa).
#[must_use]
pub fn snapshot(mesh: &Mesh, solved: &Solved) -> Vec<f32> {
    let mut values = Vec::with_capacity(mesh.nodes_mm.len() * FIELDS.len());
    for ((x, u), s) in mesh.nodes_mm.iter().zip(&solved.state.displacement_mm).zip(&solved.von_mises_mpa) {
        values.extend((0..3).map(|k| (x[k] + u[k]) as f32));
        values.push(u.iter().map(|v| v * v).sum::<f64>().sqrt() as f32);
        values.push(*s);
    }
    values
}

/// Writes the folder: `cases.csv`, `volumes.csv`, `snapshots.npy`, `mesh.vtu` and, last, `database.toml`.
///
/// # Errors
/// The operating system's.
pub fn write(
    dir: &Path,
    actuator: &str,
    mesh: &Mesh,
    cases: &[Case],
    solved: &[(usize, Arc<Solved>)],
) -> Result<(), FormatError> {
    fs::create_dir_all(dir).map_err(|e| FormatError::write(dir, e))?;
    let mut rows = Rows::new(mesh, cases);
    solved.iter().for_each(|(index, state)| rows.add(*index, state));
    put(dir, "cases.csv", &(CASE_COLUMNS.to_owned() + "\n" + &rows.table))?;
    put(dir, "volumes.csv", &(VOLUME_COLUMNS.to_owned() + "\n" + &rows.volumes))?;
    let shape = [solved.len(), mesh.nodes_mm.len(), FIELDS.len()];
    npy::write_f32(&dir.join(SNAPSHOTS), &shape, &rows.snapshots)?;
    let cells = vtu::Cells::QuadraticTets(&mesh.tets);
    let grid = vtu::Grid { points_mm: &mesh.nodes_mm, cells, point_data: &[] };
    vtu::write(&dir.join("mesh.vtu"), &grid)?;
    put(dir, "database.toml", &manifest(actuator, mesh.nodes_mm.len()))
}

/// Writes to `dir` the database at `from`, made by [`write`] (packed or not), with more states behind it.
///
/// # Errors
/// The operating system's, or a database of another layout or mesh.
pub fn extend(
    from: &Path,
    dir: &Path,
    mesh: &Mesh,
    cases: &[Case],
    solved: &[(usize, Arc<Solved>)],
) -> Result<(), FormatError> {
    fs::create_dir_all(dir).map_err(|e| FormatError::write(dir, e))?;
    let manifest = Manifest::read(&from.join("database.toml"))?;
    let mesh_file = manifest.mesh.clone().unwrap_or_default();
    let before = database::read_snapshots(&from.join(&manifest.snapshots), Some(&from.join(&mesh_file)))?;
    let expected = [before.shape[0], mesh.nodes_mm.len(), FIELDS.len()];
    if before.shape != expected {
        let problem =
            Diagnostic::new("shape", format!("{expected:?} of this mesh"), format!("{:?}", before.shape));
        return Err(FormatError::one(&from.join(&manifest.snapshots), problem));
    }
    let mut rows = Rows::new(mesh, cases);
    rows.snapshots = before.values;
    solved.iter().for_each(|(index, state)| rows.add(*index, state));
    put(dir, "cases.csv", &(table(&from.join(&manifest.cases), CASE_COLUMNS)? + &rows.table))?;
    put(dir, "volumes.csv", &(table(&from.join("volumes.csv"), VOLUME_COLUMNS)? + &rows.volumes))?;
    let shape = [before.shape[0] + solved.len(), expected[1], expected[2]];
    npy::write_f32(&dir.join(SNAPSHOTS), &shape, &rows.snapshots)?;
    fs::copy(from.join(&mesh_file), dir.join(&mesh_file)).map_err(|e| FormatError::write(dir, e))?;
    let path = from.join("database.toml");
    let text = fs::read_to_string(&path).map_err(|e| FormatError::read(&path, e))?;
    let name = format!("\"{}\"", manifest.snapshots);
    put(dir, "database.toml", &text.replace(&name, &format!("\"{SNAPSHOTS}\"")))
}

/// A table with that heading, ending with a line's end.
fn table(path: &Path, heading: &str) -> Result<String, FormatError> {
    let text = fs::read_to_string(path).map_err(|e| FormatError::read(path, e))?;
    let found = text.lines().next().unwrap_or("");
    if found != heading {
        return Err(FormatError::one(path, Diagnostic::new("heading", heading, format!("`{found}`"))));
    }
    Ok(text.trim_end().to_owned() + "\n")
}

fn put(dir: &Path, name: &str, text: &str) -> Result<(), FormatError> {
    let path = dir.join(name);
    fs::write(&path, text).map_err(|e| FormatError::write(&path, e))
}

/// Rows of the tables and of the snapshot array.
struct Rows<'a> {
    mesh: &'a Mesh,
    cases: &'a [Case],
    table: String,
    volumes: String,
    snapshots: Vec<f32>,
}

impl<'a> Rows<'a> {
    fn new(mesh: &'a Mesh, cases: &'a [Case]) -> Self {
        Self { mesh, cases, table: String::new(), volumes: String::new(), snapshots: Vec::new() }
    }

    fn add(&mut self, index: usize, state: &Solved) {
        let c = &self.cases[index];
        let gap = c.gap_mm.map_or(String::new(), |gap| gap.to_string());
        let (name, p, force) = (&c.name, c.pressure_mpa, state.contact_force_n);
        self.table += &format!("{name},{},{},{p},{gap},{force:.6}\n", c.regime, c.split);
        self.volumes += &format!("{name},{p},{gap},{:.3}\n", state.cavity_volume_mm3);
        self.snapshots.extend(snapshot(self.mesh, state));
    }
}

fn manifest(actuator: &str, nodes: usize) -> String {
    let mut text = format!(
        "# Finite-element database, layout 1: snapshots are f32, cases x nodes x fields
layout = 1
actuator = \"{actuator}\"
nodes = {nodes}
cases = \"cases.csv\"
snapshots = \"{SNAPSHOTS}\"
mesh = \"mesh.vtu\"
solver = \"softtwin simulate, version {}, formulation {FORMULATION}; von Mises stress is the mean over the elements at a node\"
",
        env!("CARGO_PKG_VERSION")
    );
    for (name, unit, kind) in FIELDS {
        text += &format!("\n[[field]]\nname = \"{name}\"\nunit = \"{unit}\"\nkind = \"{kind}\"\n");
    }
    for (name, unit) in [("pressure_mpa", "MPa"), ("gap_mm", "mm")] {
        text += &format!("\n[[input]]\nname = \"{name}\"\nunit = \"{unit}\"\n");
    }
    text
}
