//! `doe.csv`: the design of experiments, a row a state.

use super::settings::{length_factor, pressure_factor};
use crate::database::words::SPLITS;
use crate::error::{Diagnostic, FormatError, collect};
use crate::file;
use crate::table::{Row, Table};
use rom::snapshots::{Case, RegimeKind, Split};
use std::path::{Path, PathBuf};

/// The checked table.
#[derive(Clone, Debug)]
pub(crate) struct Design {
    path: PathBuf,
    /// Snapshot files, in order.
    pub(crate) files: Vec<String>,
    rows: Vec<State>,
}

#[derive(Clone, Debug, PartialEq)]
struct State {
    pressure_mpa: f64,
    gap_mm: Option<f64>,
    contact_force_n: Option<f64>,
    split: Split,
}

/// Two tables are of the same states; where they lie does not matter.
impl PartialEq for Design {
    fn eq(&self, other: &Self) -> bool {
        self.files == other.files && self.rows == other.rows
    }
}

/// What a column is.
#[derive(Clone, Copy, PartialEq)]
enum Column {
    Pressure(f64),
    Gap(f64),
    Force,
    Split,
}

impl Column {
    /// From `name[unit]`; the name may have a suffix of ours (`pressure_mpa`), whose unit it then is.
    fn of(header: &str) -> Option<Self> {
        let lower = header.to_ascii_lowercase();
        let (name, unit) = match header.split_once('[') {
            Some((name, unit)) => (name.trim().to_ascii_lowercase(), unit.trim_end_matches(']').trim()),
            None => (lower.trim().to_owned(), ""),
        };
        match (name.as_str(), unit) {
            ("pressure_mpa", "") => Some(Self::Pressure(1.0)),
            ("pressure" | "p", unit) => pressure_factor(unit).map(Self::Pressure),
            ("gap_mm", "") => Some(Self::Gap(1.0)),
            ("gap", unit) => length_factor(unit).map(Self::Gap),
            ("contact_force_n", "") | ("contact_force" | "contact force" | "force", "N") => Some(Self::Force),
            ("split", "") => Some(Self::Split),
            _ => None,
        }
    }
}

impl Design {
    /// Reads and checks the table; everything that is wrong at once.
    pub(crate) fn read(path: &Path) -> Result<Self, FormatError> {
        let table = Table::read(path, false)?;
        let mut diagnostics = Vec::new();
        let columns: Vec<Option<Column>> =
            table.header().iter().skip(1).map(|name| Column::of(name)).collect();
        for (name, _) in table.header().iter().skip(1).zip(&columns).filter(|(_, column)| column.is_none()) {
            let expected = "pressure[MPa], gap[mm], contact_force[N] or split (other units: kPa, Pa, bar, psi; m, cm, in)";
            diagnostics.push(Diagnostic::new("header", expected, format!("`{name}`")));
        }
        let columns: Vec<Column> = columns.into_iter().flatten().collect();
        if diagnostics.is_empty() && !columns.iter().any(|column| matches!(column, Column::Pressure(_))) {
            diagnostics.push(Diagnostic::new("header", "a column pressure[MPa]", "none"));
        }
        // With a wrong header every row would be wrong.
        FormatError::check((), path, std::mem::take(&mut diagnostics))?;
        let (mut files, mut rows) = (Vec::new(), Vec::new());
        for row in table.rows() {
            if !file::is_plain_name(row.text(0)) {
                let found = format!("`{}`", row.text(0));
                diagnostics.push(Diagnostic::new(row.place(), "a file name without folders", found));
            }
            files.push(row.text(0).to_owned());
            rows.extend(state(&row, &columns, &mut diagnostics));
        }
        if files.is_empty() {
            diagnostics.push(Diagnostic::new("rows", "at least one state", "none"));
        }
        FormatError::check(Self { path: path.into(), files, rows }, path, diagnostics)
    }

    /// The states as cases: with a gap contact, without free.
    pub(crate) fn cases(&self) -> Result<Vec<Case>, FormatError> {
        let mut diagnostics = Vec::new();
        let case = |(k, (file, row)): (usize, (&String, &State))| {
            if row.gap_mm.is_some() && row.contact_force_n.is_none() {
                let expected = "a column contact_force[N] for states with a gap";
                diagnostics.push(Diagnostic::new(format!("line {}", k + 2), expected, "none"));
            }
            Case {
                name: file.trim_end_matches(".bin").to_owned(),
                regime: if row.gap_mm.is_some() { RegimeKind::Contact } else { RegimeKind::Free },
                split: row.split,
                pressure_mpa: row.pressure_mpa,
                gap_mm: row.gap_mm,
                contact_force_n: row.contact_force_n.unwrap_or(0.0),
                parameters: Vec::new(),
            }
        };
        let cases = self.files.iter().zip(&self.rows).enumerate().map(case).collect();
        FormatError::check(cases, &self.path, diagnostics)
    }
}

fn state(row: &Row<'_>, columns: &[Column], diagnostics: &mut Vec<Diagnostic>) -> Option<State> {
    collect(row.check_width(false), diagnostics)?;
    let mut state = State { pressure_mpa: 0.0, gap_mm: None, contact_force_n: None, split: Split::Train };
    for (at, column) in (1..).zip(columns) {
        match column {
            Column::Pressure(factor) => state.pressure_mpa = factor * collect(row.number(at), diagnostics)?,
            Column::Gap(factor) => {
                state.gap_mm = collect(row.optional_number(at), diagnostics)?.map(|value| factor * value);
            }
            Column::Force => state.contact_force_n = collect(row.optional_number(at), diagnostics)?,
            Column::Split if row.text(at).is_empty() => {}
            Column::Split => state.split = collect(row.choice(at, &SPLITS), diagnostics)?,
        }
    }
    Some(state)
}
