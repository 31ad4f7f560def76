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

use super::arrays;
use super::cases::{ObstacleKind, REGIMES, SPLITS};
use crate::error::{Diagnostic, FormatError, collect};
use crate::file;
use crate::table::{Table, TableRow};
use rom::snapshots::{Case, Database, FieldSpec, RegimeKind, Split};
use serde::Deserialize;
use std::path::Path;

/// Name of the description in its folder.
pub(crate) const FILE: &str = "authors.toml";

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct AuthorsFile {
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
    let description: AuthorsFile = file::read_toml(&path, "the keys of authors.toml")?;
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
        let cases = read_parameters(&dir.join(&set.parameters), regime, first)?;
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

/// Number of errors after which reading stops.
const MAX_DIAGNOSTICS: usize = 50;

/// Rows and columns of finite numbers, without a header.
struct Matrix {
    rows: usize,
    columns: usize,
    values: Vec<f32>,
}

impl Matrix {
    /// Reads a table with `columns` columns.
    fn read(path: &Path, columns: usize) -> Result<Self, FormatError> {
        let numbers: Vec<String> = (1..=columns).map(|column| column.to_string()).collect();
        let numbers: Vec<&str> = numbers.iter().map(String::as_str).collect();
        let table = Table::read_without_header(path, &numbers, file::MAX_DATA_BYTES)?;
        let (mut values, mut diagnostics, mut rows) = (Vec::new(), Vec::new(), 0);
        for row in table.rows() {
            if collect(row.check_width(false), &mut diagnostics).is_some() {
                let cells = (0..columns).map(|column| collect(row.number(column), &mut diagnostics));
                values.extend(cells.map(|value| value.unwrap_or_default() as f32));
            }
            if diagnostics.len() >= MAX_DIAGNOSTICS {
                break;
            }
            rows += 1;
        }
        if rows == 0 && diagnostics.is_empty() {
            diagnostics.push(Diagnostic::new("rows", "at least one", "none"));
        }
        FormatError::check(Self { rows, columns, values }, path, diagnostics)
    }

    fn at(&self, row: usize, column: usize) -> f32 {
        self.values[row * self.columns + column]
    }

    fn column(&self, column: usize) -> impl Iterator<Item = f32> + '_ {
        self.values.iter().skip(column).step_by(self.columns).copied()
    }
}

/// Columns by name; a list without a header has the first three in this order.
const COLUMNS: [&str; 4] = ["pressure_mpa", "gap_mm", "contact_force_n", "split"];

/// Reads the list; cases are named by their number from `first` on.
fn read_parameters(path: &Path, regime: RegimeKind, first: usize) -> Result<Vec<Case>, FormatError> {
    let mut table = Table::read(path, false)?;
    if table.header().first().is_some_and(|cell| cell.parse::<f64>().is_ok()) {
        table = Table::read_without_header(path, &COLUMNS[..3], file::MAX_TEXT_BYTES)?;
    }
    let mut diagnostics = Vec::new();
    for name in table.header().iter().filter(|name| !COLUMNS.contains(&name.as_str())) {
        diagnostics.push(Diagnostic::new("header", format!("columns of {COLUMNS:?}"), format!("`{name}`")));
    }
    let needed = if regime == RegimeKind::Contact { 3 } else { 1 };
    for name in &COLUMNS[..needed] {
        collect(table.column(name), &mut diagnostics);
    }
    let mut cases = Vec::new();
    // A wrong header makes every row an error.
    if diagnostics.is_empty() {
        let columns = COLUMNS.map(|name| table.column(name).ok());
        for row in table.rows() {
            cases.extend(parameter_case(&row, &columns, regime, first + cases.len(), &mut diagnostics));
        }
    }
    if cases.is_empty() && diagnostics.is_empty() {
        diagnostics.push(Diagnostic::new("rows", "at least one case", "none"));
    }
    FormatError::check(cases, path, diagnostics)
}

fn parameter_case(
    row: &TableRow<'_>,
    [pressure, gap, force, split]: &[Option<usize>; 4],
    regime: RegimeKind,
    number: usize,
    diagnostics: &mut Vec<Diagnostic>,
) -> Option<Case> {
    collect(row.check_width(true), diagnostics)?;
    let split = split.filter(|column| !row.text(*column).is_empty());
    let split = split.map_or(Ok(Split::Train), |column| row.choice(column, &SPLITS));
    let contact = regime == RegimeKind::Contact;
    let mut value = |column: &Option<usize>| collect(row.number((*column)?), diagnostics);
    let pressure_mpa = value(pressure);
    let gap_mm = if contact { value(gap).map(Some) } else { Some(None) };
    let contact_force_n = if contact { value(force) } else { Some(0.0) };
    Some(Case {
        name: number.to_string(),
        regime,
        split: collect(split, diagnostics)?,
        pressure_mpa: pressure_mpa?,
        gap_mm: gap_mm?,
        contact_force_n: contact_force_n?,
        parameters: Vec::new(),
    })
}
