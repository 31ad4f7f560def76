//! Derivatives of snapshots by inputs: an array `rows x nodes x fields` (packed or .npy) and `sensitivities.csv`, whose
//! row `i` says which case and input the array's row `i` is about.

use super::manifest::{FILE, Kind, Manifest};
use super::snapshots::read_snapshots;
use super::words::ObstacleKind;
use crate::error::{Diagnostic, FormatError, collect};
use crate::packed::{self, Snapshots, Stored};
use crate::table::{self, Row, Table};
use crate::{file, npy};
use rom::snapshots::{Case, Database, Sensitivities, Sensitivity, Split};
use std::collections::HashMap;
use std::path::Path;

/// The table of rows, in the same folder.
const TABLE: &str = "sensitivities.csv";
const COLUMNS: [&str; 3] = ["case", "input", "contact_force_n_per_unit"];
/// The name under which [`write()`] puts the array.
const ARRAY: &str = "sensitivities.npy";
/// The name of a packed array.
const PACKED_ARRAY: &str = "sensitivities.pack";

/// Reads and checks both files against the cases; none where the manifest names no array.
pub(super) fn read(
    dir: &Path,
    manifest: &Manifest,
    cases: &[(ObstacleKind, Case)],
) -> Result<Option<Sensitivities>, FormatError> {
    let Some(name) = &manifest.sensitivities else { return Ok(None) };
    let rows = read_rows(&dir.join(TABLE), manifest, cases)?;
    let position = |name: &String| manifest.field.iter().position(|field| field.name == *name);
    let fields: Vec<usize> = match &manifest.sensitivity_fields {
        Some(names) => names.iter().filter_map(position).collect(), // unknown ones were refused by the manifest
        None => (0..manifest.field.len()).collect(),
    };
    let path = dir.join(name);
    let array = read_snapshots(&path, None)?;
    let expected = [rows.len(), manifest.nodes, fields.len()];
    if array.shape != expected {
        let expected = format!("{expected:?} (rows of {TABLE}, nodes and sensitivity_fields of {FILE})");
        return Err(FormatError::one(
            &path,
            Diagnostic::new("shape", expected, format!("{:?}", array.shape)),
        ));
    }
    Ok(Some(Sensitivities { rows, fields, values: array.values }))
}

fn read_rows(
    path: &Path,
    manifest: &Manifest,
    cases: &[(ObstacleKind, Case)],
) -> Result<Vec<Sensitivity>, FormatError> {
    let table = Table::read(path, false)?;
    let columns = table
        .columns(COLUMNS)
        .map_err(|diagnostics| FormatError::Content { path: path.into(), diagnostics })?;
    let places: HashMap<&str, usize> =
        cases.iter().enumerate().map(|(i, (_, case))| (case.name.as_str(), i)).collect();
    let inputs = manifest.positions();
    let (mut rows, mut diagnostics, mut seen) = (Vec::new(), Vec::new(), HashMap::new());
    for row in table.rows() {
        let Some(found) = one(&row, columns, &places, &inputs, &mut diagnostics) else { continue };
        if let Some(first) = seen.insert((found.case, found.input), row.place()) {
            let diagnostic =
                Diagnostic::new(row.place(), "a case and input used once", format!("those of {first}"));
            diagnostics.push(diagnostic);
        }
        rows.push(found);
    }
    FormatError::check(rows, path, diagnostics)
}

fn one(
    row: &Row<'_>,
    columns: [usize; 3],
    cases: &HashMap<&str, usize>,
    inputs: &[(&str, usize)],
    diagnostics: &mut Vec<Diagnostic>,
) -> Option<Sensitivity> {
    collect(row.check_width(false), diagnostics)?;
    let case = cases.get(row.text(columns[0])).copied();
    if case.is_none() {
        diagnostics.push(row.diagnostic(columns[0], "a case of the table of cases"));
    }
    let input = collect(row.choice(columns[1], inputs), diagnostics);
    let force = collect(row.number(columns[2]), diagnostics);
    Some(Sensitivity { case: case?, input: input?, contact_force_n_per_unit: force? })
}

/// The derivatives of the cases that are kept, renumbered.
pub(super) fn of_cases(all: Sensitivities, kept: &[bool], nodes: usize) -> Sensitivities {
    let entries = nodes * all.fields.len();
    let mut rest = Sensitivities { rows: Vec::new(), fields: all.fields, values: Vec::new() };
    for (row, values) in all.rows.iter().zip(all.values.chunks_exact(entries.max(1))) {
        if kept[row.case] {
            let case = kept[..row.case].iter().filter(|kept| **kept).count();
            rest.rows.push(Sensitivity { case, ..*row });
            rest.values.extend_from_slice(values);
        }
    }
    rest
}

/// Writes both files and names them in the manifest.
pub(super) fn write(
    dir: &Path,
    manifest: &mut Manifest,
    database: &Database,
    derivatives: &Sensitivities,
) -> Result<(), FormatError> {
    let names = derivatives.fields.iter().map(|&f| database.fields[f].name.clone());
    manifest.sensitivity_fields = Some(names.collect());
    manifest.sensitivities = Some(ARRAY.into());
    let row = |row: &Sensitivity| line(&database.cases[row.case].name, manifest, row);
    let text = table::to_text(&COLUMNS, derivatives.rows.iter().map(row));
    file::replace(&dir.join(TABLE), text.as_bytes())?;
    let shape = [derivatives.rows.len(), database.node_count, derivatives.fields.len()];
    npy::write_f32(&dir.join(ARRAY), &shape, &derivatives.values)
}

/// Packs the derivatives of a folder's training states into another folder, each row and field within a share of its largest
/// value, with the table that says whose they are. Training reads no others. Returns the bytes of the array; none where the
/// manifest names no array.
///
/// # Errors
/// As [`super::read`], for both tables and the array, or no training state has derivatives.
pub fn pack_sensitivities(
    from: &Path,
    to: &Path,
    manifest: &Manifest,
    share: impl Fn(Kind) -> f64,
) -> Result<Option<usize>, FormatError> {
    let cases = super::cases::read(&from.join(&manifest.cases), manifest)?;
    let Some(all) = read(from, manifest, &cases)? else { return Ok(None) };
    let entries = manifest.nodes * all.fields.len();
    let (mut rows, mut values) = (Vec::new(), Vec::new());
    for (row, derivative) in all.rows.iter().zip(all.values.chunks_exact(entries.max(1))) {
        let case = &cases[row.case].1;
        if case.split == Split::Train {
            rows.push(line(&case.name, manifest, row));
            values.extend_from_slice(derivative);
        }
    }
    if rows.is_empty() {
        let diagnostic = Diagnostic::new("column case", "a training case with derivatives", "none");
        return Err(FormatError::one(&from.join(TABLE), diagnostic));
    }
    let snapshots = Snapshots { shape: [rows.len(), manifest.nodes, all.fields.len()], values };
    let path = to.join(PACKED_ARRAY);
    let stored: Vec<Stored> =
        all.fields.iter().map(|&field| Stored::Share(share(manifest.field[field].kind))).collect();
    let bytes =
        packed::pack(&snapshots, &stored).map_err(|diagnostic| FormatError::one(&path, diagnostic))?;
    file::replace(&to.join(TABLE), table::to_text(&COLUMNS, rows).as_bytes())?;
    file::replace(&path, &bytes)?;
    Ok(Some(bytes.len()))
}

/// A row of the table.
fn line(case: &str, manifest: &Manifest, row: &Sensitivity) -> [String; 3] {
    [case.to_owned(), manifest.input[row.input].name.clone(), row.contact_force_n_per_unit.to_string()]
}
