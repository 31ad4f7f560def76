//! Lists of cases: `case,regime,split,pressure_mpa,gap_mm`, one row a state to compute.

use formats::{Diagnostic, FormatError};
use std::collections::HashMap;
use std::path::Path;

/// Columns of a list; a table of results has more, which are passed over.
const COLUMNS: [&str; 5] = ["case", "regime", "split", "pressure_mpa", "gap_mm"];
/// Regimes a row may have, and whether they take a gap.
const REGIMES: [(&str, bool); 3] = [("free", false), ("contact", true), ("gripper", true)];
const SPLITS: [&str; 3] = ["train", "test", "check"];
/// Above this no elastomer actuator of this kind survives; a larger figure is another unit.
const MAX_MPA: f64 = 10.0;
const MAX_MM: f64 = 10_000.0;

/// A state to compute.
#[derive(Clone, Debug, PartialEq)]
pub struct Case {
    /// Name, unique in its list.
    pub name: String,
    /// `free`, `contact` or `gripper`.
    pub regime: String,
    /// `train`, `test` or `check`.
    pub split: String,
    /// Cavity pressure (MPa).
    pub pressure_mpa: f64,
    /// Distance of the obstacle from the undeformed base (mm); none when free.
    pub gap_mm: Option<f64>,
}

impl Case {
    /// How soon it is computed: training first, checks last.
    #[must_use]
    pub fn urgency(&self) -> usize {
        SPLITS.iter().position(|s| *s == self.split).unwrap_or(SPLITS.len())
    }
}

/// Reads a list; all problems at once.
///
/// # Errors
/// Not readable, a missing column, a value out of range, two cases of one name or at one place.
pub fn read(path: &Path) -> Result<Vec<Case>, FormatError> {
    let text = std::fs::read_to_string(path).map_err(|e| FormatError::read(path, e))?;
    parse(&text).map_err(|problems| FormatError::Content { path: path.into(), problems })
}

/// [`read`] from memory. Lines that begin with `#` are comments.
///
/// # Errors
/// Everything that is wrong; never empty.
pub fn parse(text: &str) -> Result<Vec<Case>, Vec<Diagnostic>> {
    let mut lines = text.lines().enumerate().filter(|(_, l)| !l.trim().is_empty() && !l.starts_with('#'));
    let header: Vec<&str> = lines.next().map_or("", |(_, l)| l).split(',').map(str::trim).collect();
    let places: Vec<Option<usize>> = COLUMNS.iter().map(|c| header.iter().position(|h| h == c)).collect();
    let missing: Vec<Diagnostic> = COLUMNS
        .iter()
        .zip(&places)
        .filter(|(_, place)| place.is_none())
        .map(|(column, _)| Diagnostic::new(format!("column {column}"), COLUMNS.join(","), header.join(",")))
        .collect();
    if !missing.is_empty() {
        return Err(missing);
    }
    let mut problems = Vec::new();
    let mut cases: Vec<Case> = Vec::new();
    for (index, line) in lines {
        let cells: Vec<&str> = line.split(',').map(str::trim).collect();
        let cell = |c: usize| places[c].and_then(|p| cells.get(p)).copied().unwrap_or("");
        match row(&cell, index + 1) {
            Ok(case) => cases.push(case),
            Err(wrong) => problems.extend(wrong),
        }
    }
    problems.extend(repeated(&cases));
    if cases.is_empty() && problems.is_empty() {
        problems.push(Diagnostic::new("rows", "at least one case", "none"));
    }
    if problems.is_empty() { Ok(cases) } else { Err(problems) }
}

fn row<'a>(cell: &impl Fn(usize) -> &'a str, line: usize) -> Result<Case, Vec<Diagnostic>> {
    let mut problems = Vec::new();
    let mut wrong = |column: usize, expected: &str| {
        let place = format!("line {line}, column {}", COLUMNS[column]);
        problems.push(Diagnostic::new(place, expected, format!("`{}`", cell(column))));
    };
    let named = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
    if cell(0).is_empty() || cell(0).starts_with('.') || !cell(0).chars().all(named) {
        wrong(0, "a name of letters, digits, - and _");
    }
    let takes_gap = REGIMES.iter().find(|(name, _)| *name == cell(1)).map(|(_, gap)| *gap);
    if takes_gap.is_none() {
        wrong(1, "free, contact or gripper");
    }
    if !SPLITS.contains(&cell(2)) {
        wrong(2, "train, test or check");
    }
    let pressure = cell(3).parse::<f64>().ok().filter(|p| (0.0..=MAX_MPA).contains(p));
    if pressure.is_none() {
        wrong(3, "a pressure of 0 to 10 MPa");
    }
    let gap = cell(4).parse::<f64>().ok().filter(|g| *g > 0.0 && *g <= MAX_MM);
    match takes_gap {
        Some(true) if gap.is_none() => wrong(4, "a gap above 0 mm (the obstacle stands outside the body)"),
        Some(false) if !cell(4).is_empty() => wrong(4, "nothing, as a free case has no gap"),
        _ => {}
    }
    if !problems.is_empty() {
        return Err(problems);
    }
    Ok(Case {
        name: cell(0).into(),
        regime: cell(1).into(),
        split: cell(2).into(),
        pressure_mpa: pressure.unwrap_or_default(),
        gap_mm: gap,
    })
}

fn repeated(cases: &[Case]) -> Vec<Diagnostic> {
    let mut names = HashMap::new();
    let mut places = HashMap::new();
    let mut problems = Vec::new();
    for case in cases {
        if names.insert(&case.name, ()).is_some() {
            problems.push(Diagnostic::new(format!("case {}", case.name), "every name once", "it twice"));
        }
        let place = (case.pressure_mpa.to_bits(), case.gap_mm.map(f64::to_bits));
        if let Some(other) = places.insert(place, &case.name) {
            problems.push(Diagnostic::new(
                format!("case {}", case.name),
                "every state once",
                format!("that of case {other}"),
            ));
        }
    }
    problems
}

/// The list as text that [`parse`] reads.
#[must_use]
pub fn to_csv(cases: &[Case]) -> String {
    let mut text = COLUMNS.join(",") + "\n";
    for c in cases {
        let gap = c.gap_mm.map_or(String::new(), |gap| gap.to_string());
        text += &format!("{},{},{},{},{gap}\n", c.name, c.regime, c.split, c.pressure_mpa);
    }
    text
}

/// Columns of a table of cavity volumes.
pub(super) const VOLUME_COLUMNS: &str = "case,pressure_mpa,gap_mm,cavity_volume_mm3";

/// A row of `volumes.csv`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Volume {
    /// Cavity pressure (MPa).
    pub pressure_mpa: f64,
    /// Distance of the obstacle (mm); none when free.
    pub gap_mm: Option<f64>,
    /// Volume of the cavity (mm3).
    pub cavity_volume_mm3: f64,
}

/// Reads the `volumes.csv` of a run.
///
/// # Errors
/// Not readable, another heading, or rows that are no finite numbers; all of them at once.
pub fn read_volumes(path: &Path) -> Result<Vec<Volume>, FormatError> {
    let text = std::fs::read_to_string(path).map_err(|e| FormatError::read(path, e))?;
    let mut lines = text.lines().enumerate();
    let heading = lines.next().map_or("", |(_, line)| line.trim());
    if heading != VOLUME_COLUMNS {
        return Err(FormatError::one(
            path,
            Diagnostic::new("heading", VOLUME_COLUMNS, format!("`{heading}`")),
        ));
    }
    let (mut rows, mut problems) = (Vec::new(), Vec::new());
    for (index, line) in lines {
        let cells: Vec<&str> = line.split(',').map(str::trim).collect();
        let number = |c: usize| cells.get(c).and_then(|v| v.parse::<f64>().ok()).filter(|v| v.is_finite());
        match (number(1), number(3)) {
            (Some(pressure_mpa), Some(cavity_volume_mm3)) => {
                rows.push(Volume { pressure_mpa, gap_mm: number(2), cavity_volume_mm3 });
            }
            _ => problems.push(Diagnostic::new(
                format!("line {}", index + 1),
                VOLUME_COLUMNS,
                format!("`{line}`"),
            )),
        }
    }
    FormatError::unless(rows, path, problems)
}
