//! `cases.csv`: one row per case; the words in its cells.

use super::manifest::Manifest;
use crate::error::{Diagnostic, FormatError, collect};
use crate::file;
use crate::table::{self, Table};
use rom::snapshots::{Case, Database, Footprint, RegimeKind, Split};
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::path::Path;

/// Kind of obstacle. It determines gravity too, so a model has the cases of one kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ObstacleKind {
    /// A plate below the actuator: regimes `free` and `contact`.
    #[default]
    Plate,
    /// The block that a finger grips: regime `gripper`.
    Block,
}

impl ObstacleKind {
    pub const ALL: [Self; 2] = [Self::Plate, Self::Block];

    /// Name on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Plate => "plate",
            Self::Block => "gripper",
        }
    }

    /// Default place of the obstacle; a database may contain another.
    pub(super) const fn footprint(self) -> Footprint {
        match self {
            Self::Plate => Footprint::PLATE,
            Self::Block => Footprint::BLOCK,
        }
    }
}

/// Names of regimes in tables.
pub const REGIMES: [(&str, (ObstacleKind, RegimeKind)); 3] = [
    ("free", (ObstacleKind::Plate, RegimeKind::Free)),
    ("contact", (ObstacleKind::Plate, RegimeKind::Contact)),
    ("gripper", (ObstacleKind::Block, RegimeKind::Contact)),
];

/// Names of regimes for messages.
pub const ANY_REGIME: &str = "free, contact or gripper; a structure with several shapes (buckled, snapped) needs one database and \
                              one model per shape";

/// Names of splits in tables.
pub const SPLITS: [(&str, Split); 3] =
    [("train", Split::Train), ("test", Split::Test), ("check", Split::Check)];

fn split_name(split: Split) -> &'static str {
    SPLITS.iter().find(|(_, value)| *value == split).map_or("", |(name, _)| name)
}

/// Columns of every table, in the order of [`write()`].
const COLUMNS: [&str; 6] = ["case", "regime", "split", "pressure_mpa", "gap_mm", "contact_force_n"];

/// A row of the table of cases.
pub(crate) struct CaseRow {
    pub(crate) case: Case,
    pub(crate) obstacle: ObstacleKind,
}

/// Reads and checks the table: all rows, or all errors.
pub(crate) fn read(path: &Path, manifest: &Manifest) -> Result<Vec<CaseRow>, FormatError> {
    let table = Table::read(path, false)?;
    let columns = columns(&table, manifest)
        .map_err(|diagnostics| FormatError::Content { path: path.into(), diagnostics })?;
    let (mut cases, mut diagnostics, mut seen) = (Vec::new(), Vec::new(), HashMap::new());
    for row in table.rows() {
        let Some(case) = case(&row, &columns, &mut diagnostics) else { continue };
        if let Some(first) = seen.insert(row.text(columns.name).to_owned(), row.place()) {
            let place = format!("{}, column case", row.place());
            let found = format!("`{}` of {first}", case.case.name);
            diagnostics.push(Diagnostic::new(place, "a name used once", found));
        }
        cases.push(case);
    }
    if cases.is_empty() && diagnostics.is_empty() {
        diagnostics.push(Diagnostic::new("rows", "at least one case", "none"));
    }
    FormatError::check(cases, path, diagnostics)
}

/// Positions of the columns.
struct Columns {
    name: usize,
    regime: usize,
    split: usize,
    /// Pressure, gap and force: `None` in a table of states without them.
    pressure: Option<usize>,
    gap: Option<usize>,
    force: Option<usize>,
    parameters: Vec<usize>,
}

/// Finds the standard columns and the parameters; all others must be declared.
fn columns(table: &Table, manifest: &Manifest) -> Result<Columns, Vec<Diagnostic>> {
    let [first @ .., pressure, gap, force] = COLUMNS;
    let found = table.columns(first);
    let standard = |name: &str| table.column(name).ok().filter(|_| !manifest.is_extra(name));
    let [pressure, gap, force] = [pressure, gap, force].map(standard);
    let parameters = manifest.parameters();
    let declared = |name: &str| manifest.is_extra(name) || parameters.iter().any(|p| p.name == name);
    let mut missing = Vec::new();
    let parameters: Vec<usize> =
        parameters.iter().filter_map(|p| collect(table.column(&p.name), &mut missing)).collect();
    let absent = manifest.input.iter().filter(|input| !table.header().contains(&input.name));
    let absent = absent.filter(|input| COLUMNS.contains(&input.name.as_str()));
    missing.extend(
        absent.map(|i| Diagnostic::new("header", format!("a column `{}`", i.name), "none of that name")),
    );
    let strangers = table.header().iter().filter(|name| !COLUMNS.contains(&name.as_str()) && !declared(name));
    let expected = "standard columns, those of [[input]] and those declared as [[extra]] in database.toml";
    let strangers: Vec<Diagnostic> =
        strangers.map(|name| Diagnostic::new("header", expected, format!("`{name}`"))).collect();
    match found {
        Ok([name, regime, split]) if strangers.is_empty() && missing.is_empty() => {
            Ok(Columns { name, regime, split, pressure, gap, force, parameters })
        }
        found => Err(found.err().into_iter().flatten().chain(missing).chain(strangers).collect()),
    }
}

fn case(row: &table::TableRow<'_>, at: &Columns, diagnostics: &mut Vec<Diagnostic>) -> Option<CaseRow> {
    collect(row.check_width(false), diagnostics)?;
    let parameters: Vec<f64> =
        at.parameters.iter().filter_map(|column| collect(row.number(*column), diagnostics)).collect();
    let all_given = parameters.len() == at.parameters.len();
    let Columns { pressure, gap, force, .. } = at;
    let regime = row.choice(at.regime, &REGIMES).map_err(|_| row.diagnostic(at.regime, ANY_REGIME));
    let regime = collect(regime, diagnostics);
    let split = collect(row.choice(at.split, &SPLITS), diagnostics);
    let pressure_mpa = pressure.map_or(Some(0.0), |pressure| collect(row.number(pressure), diagnostics));
    let gap_mm = gap.map_or(Some(None), |gap| collect(row.optional_number(gap), diagnostics));
    let contact_force_n = force.map_or(Some(0.0), |force| collect(row.number(force), diagnostics));
    let (obstacle, regime) = regime.filter(|_| all_given)?;
    if regime == RegimeKind::Contact && gap_mm == Some(None) {
        let place = format!("{}, column gap_mm", row.place());
        diagnostics.push(Diagnostic::new(place, "a gap in mm for a case with an obstacle", "none"));
        return None;
    }
    if regime == RegimeKind::Contact && force.is_none() {
        let expected = "a column contact_force_n for a case with an obstacle (0 where nothing touches)";
        diagnostics.push(Diagnostic::new(row.place(), expected, "none"));
        return None;
    }
    let case = Case {
        name: row.text(at.name).to_owned(),
        regime,
        split: split?,
        pressure_mpa: pressure_mpa?,
        gap_mm: gap_mm?,
        contact_force_n: contact_force_n?,
        parameters,
    };
    Some(CaseRow { case, obstacle })
}

/// Writes the table of the cases at the plate; the database's parameters are further columns.
pub(crate) fn write(path: &Path, database: &Database) -> Result<(), FormatError> {
    let (before, force) = COLUMNS.split_at(5);
    let names = database.parameters.iter().map(|p| p.name.as_str());
    let header: Vec<&str> = before.iter().copied().chain(names).chain(force.iter().copied()).collect();
    let row = |case: &Case| {
        let mut cells = vec![
            case.name.clone(),
            case.regime.name().to_owned(),
            split_name(case.split).to_owned(),
            case.pressure_mpa.to_string(),
            case.gap_mm.map_or(String::new(), |gap| gap.to_string()),
        ];
        cells.extend(case.parameters.iter().chain([&case.contact_force_n]).map(f64::to_string));
        cells
    };
    file::replace(path, table::to_text(&header, database.cases.iter().map(row)).as_bytes())
}
