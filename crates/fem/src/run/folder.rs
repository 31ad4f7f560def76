//! The database folder: what `softtwin train --database` reads, plus the cavity volumes.

use super::store::Solved;
use crate::algebra::norm;
use crate::cases::{COLUMNS, Case, VOLUME_COLUMNS};
use crate::mesh::Mesh;
use crate::solver::FORMULATION;
use formats::database::{self, Manifest};
use formats::table::to_text;
use formats::{Diagnostic, FormatError, file, npy, vtu};
use rom::snapshots::FieldSpec;
use std::path::Path;
use std::sync::Arc;

const DESCRIPTION: &str = "database.toml";
const SNAPSHOTS: &str = "snapshots.npy";
const VOLUMES: &str = "volumes.csv";
/// Fields of a snapshot: deformed coordinates, displacement magnitude, von Mises stress.
const FIELDS: usize = 5;

/// States with their index in the list of cases.
type Indexed = [(usize, Arc<Solved>)];

/// Writes the folder: `cases.csv`, `volumes.csv`, `snapshots.npy`, `mesh.vtu` and, last, `database.toml`. `solved` holds
/// the index of each state in `cases`.
///
/// # Errors
/// The operating system's.
pub fn write(
    dir: &Path,
    actuator: &str,
    mesh: &Mesh,
    cases: &[Case],
    solved: &Indexed,
) -> Result<(), FormatError> {
    file::create_folder(dir)?;
    let text = |name: &str, text: String| file::replace(&dir.join(name), text.as_bytes());
    text("cases.csv", to_text(&case_columns(), case_rows(cases, solved)))?;
    text(VOLUMES, to_text(&VOLUME_COLUMNS, volume_rows(cases, solved)))?;
    write_snapshots(dir, mesh, Vec::new(), solved)?;
    let cells = vtu::Cells::QuadraticTets(&mesh.tets);
    let grid = vtu::Grid { points_mm: &mesh.nodes_mm, cells, point_data: &[] };
    vtu::write(&dir.join("mesh.vtu"), &grid)?;
    let version = env!("CARGO_PKG_VERSION");
    let solver = format!(
        "softtwin simulate, version {version}, formulation {FORMULATION}; von Mises stress is the mean over the elements at a node"
    );
    let manifest = Manifest::new(actuator, mesh.nodes_mm.len(), &FieldSpec::of_the_paper());
    Manifest { mesh: Some("mesh.vtu".into()), solver: Some(solver), ..manifest }.write(&dir.join(DESCRIPTION))
}

/// Writes to `dir` the database at `from`, made by [`write()`] (packed or not), with more states behind it.
///
/// # Errors
/// The operating system's, or a database of another layout or mesh.
pub fn extend(
    from: &Path,
    dir: &Path,
    mesh: &Mesh,
    cases: &[Case],
    solved: &Indexed,
) -> Result<(), FormatError> {
    file::create_folder(dir)?;
    let manifest = Manifest::read(&from.join(DESCRIPTION))?;
    let mesh_file = manifest.mesh.clone().unwrap_or_default();
    let path = from.join(&manifest.snapshots);
    let before = database::read_snapshots(&path, Some(&from.join(&mesh_file)))?;
    let expected = [before.shape[0], mesh.nodes_mm.len(), FIELDS];
    if before.shape != expected {
        let (expected, found) = (format!("{expected:?} of this mesh"), format!("{:?}", before.shape));
        return Err(FormatError::one(&path, Diagnostic::new("shape", expected, found)));
    }
    let append = |name: &str, source: &str, heading: &[&str], rows: String| {
        let text = existing(&from.join(source), &heading.join(","))? + &rows;
        file::replace(&dir.join(name), text.as_bytes())
    };
    append("cases.csv", &manifest.cases, &case_columns(), to_text(&[], case_rows(cases, solved)))?;
    append(VOLUMES, VOLUMES, &VOLUME_COLUMNS, to_text(&[], volume_rows(cases, solved)))?;
    write_snapshots(dir, mesh, before.values, solved)?;
    file::copy(&from.join(&mesh_file), &dir.join(&mesh_file))?;
    manifest.copy_with_snapshots(&from.join(DESCRIPTION), &dir.join(DESCRIPTION), SNAPSHOTS)
}

/// A table with that heading, ending with a line's end.
fn existing(path: &Path, heading: &str) -> Result<String, FormatError> {
    let text = file::read_text(path, file::MAX_TEXT_BYTES)?;
    let found = text.lines().next().unwrap_or("");
    if found != heading {
        return Err(FormatError::one(path, Diagnostic::new("heading", heading, format!("`{found}`"))));
    }
    Ok(text.trim_end().to_owned() + "\n")
}

fn case_columns() -> Vec<&'static str> {
    COLUMNS.into_iter().chain(["contact_force_n"]).collect()
}

fn case_rows(cases: &[Case], solved: &Indexed) -> impl Iterator<Item = Vec<String>> {
    let force = |state: &Solved| format!("{:.6}", state.contact_force_n);
    solved.iter().map(move |(index, state)| cases[*index].cells().into_iter().chain([force(state)]).collect())
}

fn volume_rows(cases: &[Case], solved: &Indexed) -> impl Iterator<Item = [String; 4]> {
    solved.iter().map(|(index, state)| {
        let [name, _, _, pressure, gap] = cases[*index].cells();
        [name, pressure, gap, format!("{:.3}", state.cavity_volume_mm3)]
    })
}

/// Writes the states behind the values that are there.
fn write_snapshots(
    dir: &Path,
    mesh: &Mesh,
    mut values: Vec<f32>,
    solved: &Indexed,
) -> Result<(), FormatError> {
    let nodes = mesh.nodes_mm.len();
    for (_, state) in solved {
        for (n, x) in mesh.nodes_mm.iter().enumerate() {
            let u = state.state.displacement_mm[n];
            values.extend((0..3).map(|k| (x[k] + u[k]) as f32));
            values.extend([norm(u) as f32, state.von_mises_mpa[n]]);
        }
    }
    npy::write_f32(&dir.join(SNAPSHOTS), &[values.len() / (nodes * FIELDS), nodes, FIELDS], &values)
}
