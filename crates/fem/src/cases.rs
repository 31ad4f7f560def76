//! Lists of cases: `case,regime,split,pressure_mpa,gap_mm`, one row per state to compute; and tables of cavity volumes.
//! Further columns of a list are parameters, headed by their dotted keys in `actuator.toml`. A list with a column `volume_mm3`
//! gives the injected volume instead of the pressure, which is a result.

use crate::actuator::Setting;
use crate::config::MAX_MPA;
use formats::database::{REGIMES, SPLITS};
use formats::table::{Table, TableRow, to_text};
use formats::{Diagnostic, FormatError};
pub(crate) use rom::branch::VOLUME;
use rom::snapshots::RegimeKind;
use std::collections::HashMap;
use std::path::Path;

/// Columns of a list; other columns, as in a table of results, are ignored.
pub(crate) const COLUMNS: [&str; 5] = ["case", "regime", "split", "pressure_mpa", "gap_mm"];
/// Largest injected volume: a litre.
pub const MAX_MM3: f64 = 1.0e6;
pub(crate) const MAX_MM: f64 = 10_000.0;

/// State to compute.
#[derive(Clone, Debug, PartialEq)]
pub struct Case {
    /// Name, unique in its list.
    pub name: String,
    /// `free`, `contact` or `gripper`.
    pub regime: String,
    /// `train`, `test` or `check`.
    pub split: String,
    /// Cavity pressure (MPa); 0 if the volume is given.
    pub pressure_mpa: f64,
    /// Injected volume (mm3), if it is given; in all cases of a list or in none.
    pub volume_mm3: Option<f64>,
    /// Distance of the obstacle from the undeformed base (mm); `None` for a free case.
    pub gap_mm: Option<f64>,
    /// Parameters in the order of their columns: dotted key of `actuator.toml` and value; the same keys in all cases.
    pub settings: Vec<Setting>,
}

impl Case {
    /// A state of the nominal actuator to train on: free without a gap, otherwise in contact.
    pub fn new(name: impl Into<String>, pressure_mpa: f64, gap_mm: Option<f64>) -> Self {
        Self {
            name: name.into(),
            regime: if gap_mm.is_some() { "contact" } else { "free" }.into(),
            split: "train".into(),
            pressure_mpa,
            volume_mm3: None,
            gap_mm,
            settings: Vec::new(),
        }
    }

    /// The gap as a cell of a table: empty when free.
    pub(crate) fn gap_cell(&self) -> String {
        self.gap_mm.map_or(String::new(), |gap| gap.to_string())
    }

    /// The cells of [`COLUMNS`], then one for each parameter.
    pub(crate) fn cells(&self) -> Vec<String> {
        let Self { name, regime, split, pressure_mpa, volume_mm3, .. } = self.clone();
        let driven = volume_mm3.unwrap_or(pressure_mpa).to_string();
        let mut cells = vec![name, regime, split, driven, self.gap_cell()];
        cells.extend(self.settings.iter().map(|(_, value)| value.to_string()));
        cells
    }
}

/// A value in whole parts of a unit, for shorter lists.
pub(crate) fn rounded(value: f64, parts_per_unit: f64) -> f64 {
    (value * parts_per_unit).round() / parts_per_unit
}

/// True if the volume is given in place of the pressure.
pub(crate) fn by_volume(cases: &[Case]) -> bool {
    cases.first().is_some_and(|case| case.volume_mm3.is_some())
}

/// [`COLUMNS`] with the given quantity.
fn head(by_volume: bool) -> [&'static str; 5] {
    let [case, regime, split, pressure, gap] = COLUMNS;
    [case, regime, split, if by_volume { VOLUME } else { pressure }, gap]
}

/// [`COLUMNS`] with the given quantity, and the parameters of these cases.
pub(crate) fn columns(cases: &[Case]) -> Vec<&str> {
    let parameters = cases.first().map_or(&[][..], |case| &case.settings);
    head(by_volume(cases)).into_iter().chain(parameters.iter().map(|(name, _)| name.as_str())).collect()
}

/// Reads a list.
///
/// # Errors
/// All errors in it: I/O, a missing column, a value out of range, two cases of one name or with the same loads.
pub fn read(path: &Path) -> Result<Vec<Case>, FormatError> {
    checked(&Table::read(path, true)?)
        .map_err(|diagnostics| FormatError::Content { path: path.into(), diagnostics })
}

/// [`read`] from memory. Lines that begin with `#` are comments.
///
/// # Errors
/// All errors; never empty.
pub fn parse(text: &str) -> Result<Vec<Case>, Vec<Diagnostic>> {
    checked(&Table::parse(text, true).map_err(|diagnostic| vec![diagnostic])?)
}

fn checked(table: &Table) -> Result<Vec<Case>, Vec<Diagnostic>> {
    let by_volume = table.column(VOLUME).is_ok();
    let columns = table.columns(head(by_volume))?;
    let mut diagnostics = Vec::new();
    // Only quantities of actuator.toml have a dot in their name; other columns are ignored.
    let header = table.header().iter().enumerate();
    let parameters: Vec<(usize, &String)> = header.filter(|(_, name)| name.contains('.')).collect();
    for (k, (_, name)) in parameters.iter().enumerate() {
        if parameters[..k].iter().any(|(_, other)| other == name) {
            diagnostics.push(Diagnostic::new("header", "every parameter once", format!("{name} twice")));
        }
    }
    let rows = table.rows().filter_map(|row| case(&row, &columns, by_volume, &parameters, &mut diagnostics));
    let cases: Vec<Case> = rows.collect();
    diagnostics.extend(repeated(&cases));
    if cases.is_empty() && diagnostics.is_empty() {
        diagnostics.push(Diagnostic::new("rows", "at least one case", "none"));
    }
    if diagnostics.is_empty() { Ok(cases) } else { Err(diagnostics) }
}

fn case(
    row: &TableRow<'_>,
    at: &[usize; 5],
    by_volume: bool,
    parameters: &[(usize, &String)],
    diagnostics: &mut Vec<Diagnostic>,
) -> Option<Case> {
    let before = diagnostics.len();
    let mut expect = |fits: bool, column: usize, expected: &str| {
        if !fits {
            diagnostics.push(row.diagnostic(column, expected));
        }
    };
    let name = row.text(at[0]);
    let letters = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
    let named = !name.is_empty() && !name.starts_with('.') && name.chars().all(letters);
    expect(named, at[0], "a name of letters, digits, - and _");
    let regime = row.choice(at[1], &REGIMES);
    expect(regime.is_ok(), at[1], "free, contact or gripper");
    expect(row.choice(at[2], &SPLITS).is_ok(), at[2], "train, test or check");
    let (largest, expected) = if by_volume {
        (MAX_MM3, "a volume of 0 to 1e6 mm3")
    } else {
        (MAX_MPA, "a pressure of 0 to 10 MPa")
    };
    let driven = row.number(at[3]).ok().filter(|value| (0.0..=largest).contains(value));
    expect(driven.is_some(), at[3], expected);
    let gap_mm = row.number(at[4]).ok().filter(|g| *g > 0.0 && *g <= MAX_MM);
    match regime {
        Ok((_, RegimeKind::Contact)) => {
            expect(gap_mm.is_some(), at[4], "a gap above 0 mm (the obstacle is outside the body)");
        }
        Ok(_) => {
            expect(row.text(at[4]).is_empty(), at[4], "nothing, as a free case has no gap");
        }
        Err(_) => {}
    }
    let value = |(column, name): &(usize, &String)| {
        let value = row.number(*column).ok();
        expect(value.is_some(), *column, "the parameter's value (every case has one)");
        Some(((*name).clone(), value?))
    };
    let settings: Vec<Setting> = parameters.iter().filter_map(value).collect();
    (diagnostics.len() == before).then(|| Case {
        name: name.into(),
        regime: row.text(at[1]).into(),
        split: row.text(at[2]).into(),
        pressure_mpa: driven.filter(|_| !by_volume).unwrap_or_default(),
        volume_mm3: driven.filter(|_| by_volume),
        gap_mm,
        settings,
    })
}

fn repeated(cases: &[Case]) -> Vec<Diagnostic> {
    let (mut names, mut loads) = (HashMap::new(), HashMap::new());
    let mut diagnostics = Vec::new();
    for case in cases {
        let place = format!("case {}", case.name);
        if names.insert(&case.name, ()).is_some() {
            diagnostics.push(Diagnostic::new(&place, "every name once", "it twice"));
        }
        let values: Vec<u64> = case.settings.iter().map(|(_, value)| value.to_bits()).collect();
        let driven = case.volume_mm3.unwrap_or(case.pressure_mpa);
        let load = (driven.to_bits(), case.gap_mm.map(f64::to_bits), values);
        if let Some(other) = loads.insert(load, &case.name) {
            diagnostics.push(Diagnostic::new(place, "every state once", format!("that of case {other}")));
        }
    }
    diagnostics
}

/// The list in the format of [`parse`].
pub fn to_csv(cases: &[Case]) -> String {
    to_text(&columns(cases), cases.iter().map(Case::cells))
}

/// Columns of a table of cavity volumes.
pub(crate) const VOLUME_COLUMNS: [&str; 4] = ["case", "pressure_mpa", "gap_mm", "cavity_volume_mm3"];
