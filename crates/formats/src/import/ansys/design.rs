//! `doe.csv`: the design of experiments, a row a state.

use super::settings::{length_factor, pressure_factor};
use crate::error::{Diagnostic, FormatError};
use rom::snapshots::{Case, RegimeKind, Split};
use std::path::{Path, PathBuf};

/// The checked table.
#[derive(Clone, Debug)]
pub struct Design {
    path: PathBuf,
    /// Snapshot files, in order.
    pub files: Vec<String>,
    rows: Vec<Row>,
}

#[derive(Clone, Debug, PartialEq)]
struct Row {
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
    /// Reads and checks the table; all problems at once.
    pub fn read(path: &Path) -> Result<Self, FormatError> {
        let bytes = std::fs::read(path).map_err(|error| FormatError::read(path, error))?;
        let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(bytes.as_slice());
        let malformed =
            |error| FormatError::one(path, Diagnostic::new("content", "comma-separated text", error));
        let header = reader.headers().map_err(malformed)?.clone();
        let mut problems = Vec::new();
        let mut columns = Vec::new();
        for name in header.iter().skip(1) {
            match Column::of(name) {
                Some(column) => columns.push(column),
                None => {
                    let expected = "pressure[MPa], gap[mm], contact_force[N] or split (other units: kPa, Pa, bar, psi; m, cm, in)";
                    problems.push(Diagnostic::new("header", expected, format!("`{name}`")));
                }
            }
        }
        if problems.is_empty() && !columns.iter().any(|column| matches!(column, Column::Pressure(_))) {
            problems.push(Diagnostic::new("header", "a column pressure[MPa]", "none"));
        }
        if !problems.is_empty() {
            return Err(FormatError::Content { path: path.into(), problems });
        }
        let (mut files, mut rows) = (Vec::new(), Vec::new());
        for (k, record) in reader.records().enumerate() {
            let record = record.map_err(malformed)?;
            let file = record.get(0).unwrap_or_default();
            if !is_plain(file) {
                let place = format!("line {}", k + 2);
                problems.push(Diagnostic::new(place, "a file name without folders", format!("`{file}`")));
            }
            files.push(file.to_owned());
            rows.push(row(&record, &columns, k + 2, &mut problems));
        }
        if rows.is_empty() {
            problems.push(Diagnostic::new("rows", "at least one state", "none"));
        }
        FormatError::unless(Self { path: path.into(), files, rows }, path, problems)
    }

    /// The states as cases: with a gap contact, without free.
    pub fn cases(&self) -> Result<Vec<Case>, FormatError> {
        let mut problems = Vec::new();
        let case = |(k, (file, row)): (usize, (&String, &Row))| {
            if row.gap_mm.is_some() && row.contact_force_n.is_none() {
                let expected = "a column contact_force[N] for states with a gap";
                problems.push(Diagnostic::new(format!("line {}", k + 2), expected, "none"));
            }
            Case {
                name: file.trim_end_matches(".bin").to_owned(),
                regime: if row.gap_mm.is_some() { RegimeKind::Contact } else { RegimeKind::Free },
                split: row.split,
                pressure_mpa: row.pressure_mpa,
                gap_mm: row.gap_mm,
                contact_force_n: row.contact_force_n.unwrap_or(0.0),
            }
        };
        let cases = self.files.iter().zip(&self.rows).enumerate().map(case).collect();
        FormatError::unless(cases, &self.path, problems)
    }
}

fn is_plain(file: &str) -> bool {
    let mut parts = Path::new(file).components();
    matches!((parts.next(), parts.next()), (Some(std::path::Component::Normal(_)), None))
}

fn row(record: &csv::StringRecord, columns: &[Column], line: usize, problems: &mut Vec<Diagnostic>) -> Row {
    let mut row = Row { pressure_mpa: 0.0, gap_mm: None, contact_force_n: None, split: Split::Train };
    for (text, column) in record.iter().skip(1).zip(columns) {
        let number = text.parse::<f64>().ok().filter(|value| value.is_finite());
        match (column, number, text) {
            (Column::Pressure(factor), Some(value), _) => row.pressure_mpa = factor * value,
            (Column::Gap(factor), Some(value), _) => row.gap_mm = Some(factor * value),
            (Column::Force, Some(value), _) => row.contact_force_n = Some(value),
            (Column::Gap(_) | Column::Force, None, "") | (Column::Split, _, "" | "train") => {}
            (Column::Split, _, "test") => row.split = Split::Test,
            (Column::Split, _, "check") => row.split = Split::Check,
            (Column::Split, ..) => {
                problems.push(Diagnostic::new(
                    format!("line {line}"),
                    "train, test or check",
                    format!("`{text}`"),
                ));
            }
            _ => {
                problems.push(Diagnostic::new(format!("line {line}"), "a finite number", format!("`{text}`")))
            }
        }
    }
    row
}
