//! `cases.csv`: one row a case.

use super::Manifest;
use crate::error::{Diagnostic, FormatError};
use rom::snapshots::{Case, RegimeKind, Split};
use std::collections::HashMap;
use std::path::Path;

/// Columns every table has, in the order [`write`] gives them.
const COLUMNS: [&str; 6] = ["case", "regime", "split", "pressure_mpa", "gap_mm", "contact_force_n"];

/// Which experiment a case belongs to: they differ in what can be touched and in gravity, so one model holds one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ObstacleKind {
    /// The actuator over a plate: regimes `free` and `contact`.
    #[default]
    Plate,
    /// The finger of a gripper before a block: regime `gripper`.
    Gripper,
}

impl ObstacleKind {
    /// All scenes.
    pub const ALL: [Self; 2] = [Self::Plate, Self::Gripper];

    /// Name on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Plate => "plate",
            Self::Gripper => "gripper",
        }
    }
}

/// One checked row.
pub struct Row {
    scene: ObstacleKind,
    case: Case,
}

impl Row {
    pub fn scene(&self) -> ObstacleKind {
        self.scene
    }

    pub fn in_scene(self, scene: ObstacleKind) -> Option<Case> {
        (self.scene == scene).then_some(self.case)
    }
}

/// The checked table.
pub struct Table {
    pub rows: Vec<Row>,
}

impl Table {
    /// Reads and checks the table; all problems at once.
    pub fn read(path: &Path, manifest: &Manifest) -> Result<Self, FormatError> {
        let bytes = std::fs::read(path).map_err(|e| FormatError::read(path, e))?;
        let mut reader =
            csv::ReaderBuilder::new().trim(csv::Trim::All).flexible(true).from_reader(bytes.as_slice());
        let header = reader.headers().map_err(|e| malformed(path, &e))?.clone();
        let columns = Columns::of(&header, manifest).map_err(|problems| content(path, problems))?;
        let (mut rows, mut problems, mut seen) = (Vec::new(), Vec::new(), HashMap::new());
        for (i, record) in reader.records().enumerate() {
            let record = record.map_err(|e| malformed(path, &e))?;
            let line = i + 2; // as an editor counts, the header being line 1
            let mut cells = Cells { record: &record, columns: &columns, line, problems: &mut problems };
            if let Some(row) = cells.row(header.len()) {
                if let Some(first) = seen.insert(row.case.name.clone(), line) {
                    let place = format!("line {line}, column case");
                    problems.push(Diagnostic::new(
                        place,
                        "a name used once",
                        format!("`{}` of line {first}", row.case.name),
                    ));
                }
                rows.push(row);
            }
        }
        if rows.is_empty() && problems.is_empty() {
            problems.push(Diagnostic::new("rows", "at least one case", "none"));
        }
        FormatError::unless(Self { rows }, path, problems)
    }
}

fn content(path: &Path, problems: Vec<Diagnostic>) -> FormatError {
    FormatError::Content { path: path.into(), problems }
}

fn malformed(path: &Path, error: &csv::Error) -> FormatError {
    FormatError::one(path, Diagnostic::new("content", "comma-separated text", error))
}

/// Where each standard column is.
struct Columns([usize; 6]);

impl Columns {
    fn of(header: &csv::StringRecord, manifest: &Manifest) -> Result<Self, Vec<Diagnostic>> {
        let mut problems = Vec::new();
        let mut at = [0; 6];
        for (at, name) in at.iter_mut().zip(COLUMNS) {
            match header.iter().position(|h| h == name) {
                Some(i) => *at = i,
                None => problems.push(Diagnostic::new(
                    "header",
                    format!("a column `{name}`"),
                    "none of that name",
                )),
            }
        }
        for name in header {
            if !COLUMNS.contains(&name) && !manifest.extra.iter().any(|extra| extra.name == name) {
                let expected = "standard columns and those declared as [[extra]] in database.toml";
                problems.push(Diagnostic::new("header", expected, format!("`{name}`")));
            }
        }
        if problems.is_empty() { Ok(Self(at)) } else { Err(problems) }
    }
}

/// Reads the cells of one line and notes what is wrong with them.
struct Cells<'a> {
    record: &'a csv::StringRecord,
    columns: &'a Columns,
    line: usize,
    problems: &'a mut Vec<Diagnostic>,
}

impl Cells<'_> {
    fn row(&mut self, width: usize) -> Option<Row> {
        if self.record.len() != width {
            let place = format!("line {}", self.line);
            self.problems.push(Diagnostic::new(place, format!("{width} cells"), self.record.len()));
            return None;
        }
        let name = self.text(0).to_owned();
        let kind = self.choice(
            1,
            &[
                ("free", (ObstacleKind::Plate, RegimeKind::Free)),
                ("contact", (ObstacleKind::Plate, RegimeKind::Contact)),
                ("gripper", (ObstacleKind::Gripper, RegimeKind::Contact)),
            ],
        );
        let split =
            self.choice(2, &[("train", Split::Train), ("test", Split::Test), ("check", Split::Check)]);
        let pressure_mpa = self.number(3);
        let gap_mm = match self.text(4) {
            "" => None,
            _ => Some(self.number(4)?),
        };
        let contact_force_n = self.number(5);
        let (scene, regime) = kind?;
        if regime == RegimeKind::Contact && gap_mm.is_none() {
            self.problem(4, "a gap in mm for a case with an obstacle");
            return None;
        }
        let case = Case {
            name,
            regime,
            split: split?,
            pressure_mpa: pressure_mpa?,
            gap_mm,
            contact_force_n: contact_force_n?,
        };
        Some(Row { scene, case })
    }

    fn text(&self, column: usize) -> &str {
        self.record.get(self.columns.0[column]).unwrap_or("")
    }

    fn problem(&mut self, column: usize, expected: &str) {
        let place = format!("line {}, column {}", self.line, COLUMNS[column]);
        let found = format!("`{}`", self.text(column));
        self.problems.push(Diagnostic::new(place, expected, found));
    }

    fn number(&mut self, column: usize) -> Option<f64> {
        let number = self.text(column).parse::<f64>().ok().filter(|v| v.is_finite());
        if number.is_none() {
            self.problem(column, "a finite number");
        }
        number
    }

    fn choice<T: Copy>(&mut self, column: usize, choices: &[(&str, T)]) -> Option<T> {
        let found = choices.iter().find(|(name, _)| *name == self.text(column));
        if found.is_none() {
            let names: Vec<&str> = choices.iter().map(|(name, _)| *name).collect();
            self.problem(column, &format!("one of {}", names.join(", ")));
        }
        found.map(|(_, value)| *value)
    }
}

/// Writes a table of plate cases.
pub fn write(path: &Path, cases: &[Case]) -> Result<(), FormatError> {
    let mut text = COLUMNS.join(",") + "\n";
    for case in cases {
        let split = match case.split {
            Split::Train => "train",
            Split::Test => "test",
            Split::Check => "check",
        };
        let gap = case.gap_mm.map_or(String::new(), |gap| gap.to_string());
        let (name, regime) = (&case.name, case.regime.name());
        text += &format!("{name},{regime},{split},{},{gap},{}\n", case.pressure_mpa, case.contact_force_n);
    }
    std::fs::write(path, text).map_err(|e| FormatError::write(path, e))
}
