//! The database folder: what `softtwin train --database` reads, plus the cavity volumes.

use super::cases::VOLUME_COLUMNS;
use super::{Case, Solved};
use crate::mesh::Mesh;
use formats::{FormatError, npy, vtu};
use std::fs;
use std::path::Path;
use std::sync::Arc;

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
    let mut table = String::from("case,regime,split,pressure_mpa,gap_mm,contact_force_n\n");
    let mut volumes = VOLUME_COLUMNS.to_owned() + "\n";
    let mut snapshots = Vec::with_capacity(solved.len() * mesh.nodes_mm.len() * FIELDS.len());
    for (index, state) in solved {
        let c = &cases[*index];
        let gap = c.gap_mm.map_or(String::new(), |gap| gap.to_string());
        let (name, p, force) = (&c.name, c.pressure_mpa, state.contact_force_n);
        table += &format!("{name},{},{},{p},{gap},{force:.6}\n", c.regime, c.split);
        volumes += &format!("{name},{p},{gap},{:.3}\n", state.cavity_volume_mm3);
        snapshots.extend(snapshot(mesh, state));
    }
    let put = |name: &str, text: String| {
        let path = dir.join(name);
        fs::write(&path, text).map_err(|e| FormatError::write(&path, e))
    };
    put("cases.csv", table)?;
    put("volumes.csv", volumes)?;
    let shape = [solved.len(), mesh.nodes_mm.len(), FIELDS.len()];
    npy::write_f32(&dir.join("snapshots.npy"), &shape, &snapshots)?;
    let cells = vtu::Cells::QuadraticTets(&mesh.tets);
    let grid = vtu::Grid { points_mm: &mesh.nodes_mm, cells, point_data: &[] };
    vtu::write(&dir.join("mesh.vtu"), &grid)?;
    put("database.toml", manifest(actuator, mesh.nodes_mm.len()))
}

fn manifest(actuator: &str, nodes: usize) -> String {
    let mut text = format!(
        "# Finite-element database, layout 1: snapshots are f32, cases x nodes x fields
layout = 1
actuator = \"{actuator}\"
nodes = {nodes}
cases = \"cases.csv\"
snapshots = \"snapshots.npy\"
mesh = \"mesh.vtu\"
solver = \"softtwin simulate, version {}; von Mises stress is the mean over the elements at a node\"
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
