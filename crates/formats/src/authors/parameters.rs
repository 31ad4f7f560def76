//! The parameter list: one row a case, in the order of the snapshots' columns.

use crate::database::ObstacleKind;
use crate::error::{Diagnostic, FormatError};
use rom::snapshots::{Case, RegimeKind, Split};
use serde::Deserialize;
use std::path::Path;

/// Columns by name; a list without a header has the first three in this order.
const COLUMNS: [&str; 4] = ["pressure_mpa", "gap_mm", "contact_force_n", "split"];

/// Regime of a set.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Regime {
    /// Nothing is touched.
    Free,
    /// Before the plate.
    Contact,
    /// Before the gripper's block.
    Gripper,
}

impl Regime {
    pub const fn name(self) -> &'static str {
        match self {
            Self::Free => "free",
            Self::Contact => "contact",
            Self::Gripper => "gripper",
        }
    }

    pub const fn scene(self) -> ObstacleKind {
        match self {
            Self::Free | Self::Contact => ObstacleKind::Plate,
            Self::Gripper => ObstacleKind::Gripper,
        }
    }

    const fn kind(self) -> RegimeKind {
        match self {
            Self::Free => RegimeKind::Free,
            Self::Contact | Self::Gripper => RegimeKind::Contact,
        }
    }
}

/// Reads the list; cases are named by their number from `first` on.
pub fn read(path: &Path, regime: Regime, first: usize) -> Result<Vec<Case>, FormatError> {
    let text = std::fs::read_to_string(path).map_err(|e| FormatError::read(path, e))?;
    let mut lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty()).peekable();
    let mut problems = Vec::new();
    let mut columns: Vec<usize> = vec![0, 1, 2];
    let header = lines.peek().map(|(_, line)| cells(line)).filter(|cells| cells[0].parse::<f64>().is_err());
    if let Some(header) = header {
        lines.next();
        columns.clear();
        for name in header {
            match COLUMNS.iter().position(|known| *known == name) {
                Some(at) => columns.push(at),
                None => problems.push(Diagnostic::new(
                    "header",
                    format!("columns of {COLUMNS:?}"),
                    format!("`{name}`"),
                )),
            }
        }
    }
    let mut cases = Vec::new();
    for (line, text) in lines {
        if !problems.is_empty() && cases.is_empty() {
            break; // with a wrong header every row would be wrong
        }
        let row = Row { line: line + 1, cells: cells(text), columns: &columns };
        cases.extend(row.case(regime, first + cases.len(), &mut problems));
    }
    if cases.is_empty() && problems.is_empty() {
        problems.push(Diagnostic::new("rows", "at least one case", "none"));
    }
    FormatError::unless(cases, path, problems)
}

fn cells(line: &str) -> Vec<&str> {
    line.split(',').map(str::trim).collect()
}

struct Row<'a> {
    line: usize,
    cells: Vec<&'a str>,
    columns: &'a [usize],
}

impl Row<'_> {
    fn cell(&self, column: usize) -> &str {
        let at = self.columns.iter().position(|c| *c == column);
        at.and_then(|at| self.cells.get(at)).copied().unwrap_or("")
    }

    fn number(&self, column: usize, problems: &mut Vec<Diagnostic>) -> Option<f64> {
        let number = self.cell(column).parse::<f64>().ok().filter(|v| v.is_finite());
        if number.is_none() {
            let place = format!("line {}, column {}", self.line, COLUMNS[column]);
            problems.push(Diagnostic::new(place, "a finite number", format!("`{}`", self.cell(column))));
        }
        number
    }

    fn case(&self, regime: Regime, number: usize, problems: &mut Vec<Diagnostic>) -> Option<Case> {
        if self.cells.len() > self.columns.len() {
            let place = format!("line {}", self.line);
            problems.push(Diagnostic::new(
                place,
                format!("at most {} cells", self.columns.len()),
                self.cells.len(),
            ));
            return None;
        }
        let split = match self.cell(3) {
            "" | "train" => Split::Train,
            "test" => Split::Test,
            "check" => Split::Check,
            other => {
                let place = format!("line {}, column split", self.line);
                problems.push(Diagnostic::new(place, "train, test or check", format!("`{other}`")));
                return None;
            }
        };
        let touched = regime.kind() == RegimeKind::Contact;
        let pressure_mpa = self.number(0, problems);
        let gap_mm = if touched { self.number(1, problems) } else { None };
        let contact_force_n = if touched { self.number(2, problems) } else { Some(0.0) };
        Some(Case {
            name: number.to_string(),
            regime: regime.kind(),
            split,
            pressure_mpa: pressure_mpa?,
            gap_mm: if touched { Some(gap_mm?) } else { None },
            contact_force_n: contact_force_n?,
        })
    }
}
