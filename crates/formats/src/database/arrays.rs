//! Arrays of a database and their mesh: snapshots and derivatives, packed or `.npy`; `sensitivities.csv`, whose row `i` names the
//! case and input of row `i` of the derivatives.

use super::cases::CaseRow;
use super::manifest::{FILE, Manifest, StoredKind};
use crate::error::{Diagnostic, FormatError, collect};
use crate::mesh_reader::read_blocks;
use crate::packed::{self, Snapshots, Stored};
use crate::table::{self, Table};
use crate::{cells, file, npy, vtu};
use rom::snapshots::{Database, NodeSet, Sensitivities, Sensitivity, Split};
use std::collections::HashMap;
use std::path::Path;

/// Ending of packed snapshots, see [`packed`].
pub const PACKED: &str = "pack";

/// Table of the rows, in the same folder.
const TABLE: &str = "sensitivities.csv";
const COLUMNS: [&str; 3] = ["case", "input", "contact_force_n_per_unit"];
/// Name of an array that is not packed.
const ARRAY: &str = "sensitivities.npy";
/// Name of a packed array.
const PACKED_ARRAY: &str = "sensitivities.pack";

/// Reads snapshots from `.npy` or, by the ending [`PACKED`], packed; then fields may follow from the mesh.
///
/// # Errors
/// An unreadable array, or one that does not have three dimensions.
pub fn read_snapshots(path: &Path, mesh: Option<&Path>) -> Result<Snapshots, FormatError> {
    if path.extension().is_some_and(|e| e == PACKED) {
        let mesh = mesh.map(vtu::read).transpose()?;
        return packed::read(path, mesh.as_ref().map(|m| m.points_mm.as_slice()));
    }
    let array = npy::read_f32(path)?;
    let shape = <[usize; 3]>::try_from(array.shape).map_err(|found| {
        FormatError::one(path, Diagnostic::new("shape", "cases x nodes x fields", format!("{found:?}")))
    })?;
    Ok(Snapshots { shape, values: array.data })
}

/// Adds the undeformed mesh, its surface and node sets to a database, and its hash.
///
/// # Errors
/// A mesh that cannot be read or has another number of nodes.
pub(crate) fn complete(mut database: Database, mesh: Option<&Path>) -> Result<Database, FormatError> {
    if let Some(path) = mesh {
        let (points_mm, blocks, _) = read_blocks(path)?;
        if points_mm.len() != database.node_count {
            let expected = format!("{} as in the snapshots", database.node_count);
            return Err(FormatError::one(path, Diagnostic::new("points", expected, points_mm.len())));
        }
        database.surface_triangles = cells::surface(&points_mm, &blocks);
        database.node_sets = node_sets(&points_mm, &database.surface_triangles);
        database.undeformed_mm = Some(points_mm);
    }
    database.hash = database.content_hash();
    Ok(database)
}

/// Node sets of every mesh: underside and surface.
fn node_sets(points_mm: &[[f64; 3]], triangles: &[[u32; 3]]) -> Vec<NodeSet> {
    let mut skin: Vec<u32> = triangles.iter().flatten().copied().collect();
    skin.sort_unstable();
    skin.dedup();
    vec![
        NodeSet { name: "bottom".into(), nodes: bottom_nodes(points_mm) },
        NodeSet { name: "surface".into(), nodes: skin },
    ]
}

/// Nodes on the lowest plane of the undeformed body, which touches the plate first.
pub fn bottom_nodes(points_mm: &[[f64; 3]]) -> Vec<u32> {
    let lowest = points_mm.iter().map(|p| p[1]).fold(f64::INFINITY, f64::min);
    // Tolerance of 1 um: mesh generators round coordinates.
    (0..points_mm.len() as u32).filter(|i| points_mm[*i as usize][1] - lowest < 1e-3).collect()
}

/// Reads and checks both files against the cases; `None` if the manifest names no array.
pub(super) fn read_sensitivities(
    dir: &Path,
    manifest: &Manifest,
    cases: &[CaseRow],
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

fn read_rows(path: &Path, manifest: &Manifest, cases: &[CaseRow]) -> Result<Vec<Sensitivity>, FormatError> {
    let table = Table::read(path, false)?;
    let columns = table
        .columns(COLUMNS)
        .map_err(|diagnostics| FormatError::Content { path: path.into(), diagnostics })?;
    let places: HashMap<&str, usize> =
        cases.iter().enumerate().map(|(i, row)| (row.case.name.as_str(), i)).collect();
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
    row: &table::TableRow<'_>,
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

/// Derivatives of the selected cases, renumbered.
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
pub(super) fn write_sensitivities(
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

/// Packs the derivatives of a folder's training states into another folder with their table, each row and field within a fraction
/// of its largest value. Training reads no others. Returns the bytes of the array; `None` if the manifest names no array.
///
/// # Errors
/// As [`super::read`], for both tables and the array, or no training state has derivatives.
pub fn pack_sensitivities(
    from: &Path,
    to: &Path,
    manifest: &Manifest,
    share: impl Fn(StoredKind) -> f64,
) -> Result<Option<usize>, FormatError> {
    let cases = super::cases::read(&from.join(&manifest.cases), manifest)?;
    let Some(all) = read_sensitivities(from, manifest, &cases)? else { return Ok(None) };
    let entries = manifest.nodes * all.fields.len();
    let (mut rows, mut values) = (Vec::new(), Vec::new());
    for (row, derivative) in all.rows.iter().zip(all.values.chunks_exact(entries.max(1))) {
        let case = &cases[row.case].case;
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

/// A row of the table of sensitivities.
fn line(case: &str, manifest: &Manifest, row: &Sensitivity) -> [String; 3] {
    [case.to_owned(), manifest.input[row.input].name.clone(), row.contact_force_n_per_unit.to_string()]
}
