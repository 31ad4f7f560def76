//! Layouts of the paper's authors, described by an `authors.toml` in the folder:
//!
//! ```toml
//! actuator = "pneunet"
//! mesh = "mesh.vtu"                   # optional: the undeformed mesh in the same node order
//! [[set]]                             # one for each regime
//! regime = "free"                     # free, contact or gripper
//! parameters = "samples_free.csv"     # one row per case: pressure_mpa, gap_mm, contact_force_n, split; or numbers alone
//! stacked = "free.csv"                # rows: X, Y, Z, U, S of node 0, then of node 1, ...; one column per case; no header
//! [[set]]
//! regime = "contact"
//! parameters = "samples_contact.csv"
//! fields = { x = "X.csv", y = "Y.csv", z = "Z.csv", displacement = "U.csv", von_mises = "S.csv" }  # or a file per field
//! ```

mod matrix;
mod parameters;

use super::arrays;
use super::cases::{ObstacleKind, REGIMES};
use crate::error::{Diagnostic, FormatError};
use crate::file;
use matrix::Matrix;
use rom::snapshots::{Case, Database, FieldSpec, RegimeKind};
use serde::Deserialize;
use std::path::Path;

/// Name of the description in its folder.
pub(crate) const FILE: &str = "authors.toml";

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Description {
    actuator: String,
    mesh: Option<String>,
    set: Vec<Set>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Set {
    regime: String,
    parameters: String,
    stacked: Option<String>,
    fields: Option<Fields>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Fields {
    x: String,
    y: String,
    z: String,
    displacement: String,
    von_mises: String,
}

impl Set {
    /// Kind of obstacle and regime of the set.
    fn kind(&self) -> Result<(ObstacleKind, RegimeKind), Diagnostic> {
        let found = REGIMES.iter().find(|(name, _)| *name == self.regime).map(|(_, kind)| *kind);
        found.ok_or_else(|| {
            Diagnostic::new("regime", "free, contact or gripper", format!("`{}`", self.regime))
        })
    }
}

impl Fields {
    fn files(&self) -> [&String; 5] {
        [&self.x, &self.y, &self.z, &self.displacement, &self.von_mises]
    }
}

/// Reads a folder in the authors' layouts. `O(bytes)`.
///
/// # Errors
/// Files that cannot be read, cells that are not finite numbers (with row and column), inconsistent sets.
pub(crate) fn read(dir: &Path, obstacle: ObstacleKind) -> Result<Database, FormatError> {
    let path = dir.join(FILE);
    let wrong = |diagnostic| FormatError::one(&path, diagnostic);
    let description: Description = file::read_toml(&path, "the keys of authors.toml")?;
    let mut all = Collected::default();
    for set in &description.set {
        let (kind, regime) = set.kind().map_err(wrong)?;
        if kind == obstacle {
            all.add(dir, &path, set, regime)?;
        }
    }
    if all.cases.is_empty() {
        let expected = format!("a set of scene {}", obstacle.name());
        return Err(wrong(Diagnostic::new("[[set]]", expected, "none")));
    }
    let mesh = description.mesh.map(|file| dir.join(file));
    let database = Database {
        actuator: description.actuator,
        fields: FieldSpec::of_the_paper(),
        node_count: all.nodes,
        cases: all.cases,
        snapshots: all.snapshots,
        obstacle: obstacle.footprint(),
        ..Database::default()
    };
    arrays::complete(database, mesh.as_deref())
}

/// Cases of all sets so far.
#[derive(Default)]
struct Collected {
    nodes: usize,
    cases: Vec<Case>,
    snapshots: Vec<f32>,
}

impl Collected {
    fn add(
        &mut self,
        dir: &Path,
        description: &Path,
        set: &Set,
        regime: RegimeKind,
    ) -> Result<(), FormatError> {
        let place = format!("[[set]] {}", set.regime);
        let first = self.cases.len();
        let cases = parameters::read(&dir.join(&set.parameters), regime, first)?;
        let (nodes, snapshots) = match (&set.stacked, &set.fields) {
            (Some(file), None) => stacked(&dir.join(file), cases.len())?,
            (None, Some(fields)) => per_field(dir, fields, cases.len())?,
            _ => {
                let found = if set.stacked.is_some() { "both" } else { "neither" };
                return Err(FormatError::one(
                    description,
                    Diagnostic::new(place, "either `stacked` or `fields`", found),
                ));
            }
        };
        if first > 0 && nodes != self.nodes {
            let expected = format!("{} nodes as in the sets before", self.nodes);
            return Err(FormatError::one(description, Diagnostic::new(place, expected, nodes)));
        }
        self.nodes = nodes;
        self.cases.extend(cases);
        self.snapshots.extend(snapshots);
        Ok(())
    }
}

/// Reads `(nodes, cases x nodes x 5)` from one file with all fields.
fn stacked(path: &Path, cases: usize) -> Result<(usize, Vec<f32>), FormatError> {
    let matrix = Matrix::read(path, cases)?;
    if matrix.rows % 5 != 0 {
        let diagnostic = Diagnostic::new("rows", "5 a node (X, Y, Z, U, S)", matrix.rows);
        return Err(FormatError::one(path, diagnostic));
    }
    let snapshots = (0..cases).flat_map(|case| matrix.column(case)).collect();
    Ok((matrix.rows / 5, snapshots))
}

/// Reads `(nodes, cases x nodes x 5)` from a file per field.
fn per_field(dir: &Path, fields: &Fields, cases: usize) -> Result<(usize, Vec<f32>), FormatError> {
    let mut matrices: Vec<Matrix> = Vec::new();
    for file in fields.files() {
        let path = dir.join(file);
        let matrix = Matrix::read(&path, cases)?;
        if let Some(first) = matrices.first().filter(|first| first.rows != matrix.rows) {
            let diagnostic =
                Diagnostic::new("rows", format!("{} nodes as in {}", first.rows, fields.x), matrix.rows);
            return Err(FormatError::one(&path, diagnostic));
        }
        matrices.push(matrix);
    }
    let nodes = matrices[0].rows;
    let mut snapshots = Vec::with_capacity(cases * nodes * 5);
    for case in 0..cases {
        for node in 0..nodes {
            snapshots.extend(matrices.iter().map(|m| m.at(node, case)));
        }
    }
    Ok((nodes, snapshots))
}
