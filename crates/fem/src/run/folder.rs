//! The database folder: what `softtwin train --database` reads, plus cavity volumes and the balance of forces.

use super::derivatives::{self, Derivative};
use super::store::Solved;
use crate::actuator::{moved_nodes, unit};
use crate::algebra::norm;
use crate::cases::{Case, VOLUME_COLUMNS, columns};
use crate::family::{Family, VariantError};
use crate::solver::FORMULATION;
use formats::database::{self, Input, Manifest};
use formats::packed::{self, Snapshots, Stored};
use formats::table::to_text;
use formats::{Diagnostic, FormatError, file, npy, vtu};
use rom::snapshots::FieldSpec;
use std::path::Path;
use std::sync::Arc;

const DESCRIPTION: &str = "database.toml";
const SNAPSHOTS: &str = "snapshots.npy";
const VOLUMES: &str = "volumes.csv";
const SENSITIVITIES: &str = "sensitivities.pack";
/// Largest error of a derivative, as a share of the largest of its row and field.
const SENSITIVITY_SHARE: f64 = 5.0e-5;
/// Columns of the balance of forces.
const RESIDUAL_COLUMNS: [&str; 5] = ["case", "out_of_balance_n", "residual", "factorisations", "steps"];
/// Fields of a snapshot: deformed coordinates, displacement magnitude, von Mises stress.
const FIELDS: usize = 5;

/// What is known of a case's derivatives.
type DerivativesOf<'a> = &'a dyn Fn(&Case) -> Option<Vec<Derivative>>;

/// States with their index in the list of cases.
type Indexed = [(usize, Arc<Solved>)];

/// Writes the folder: `cases.csv`, `volumes.csv`, `residuals.csv`, `snapshots.npy`, `mesh.vtu`, with derivatives
/// `sensitivities.pack` and `sensitivities.csv`, and, last, `database.toml`. `solved` holds the index of each state in
/// `cases`; `derivatives` gives those of a case where the database is to have them.
///
/// # Errors
/// The operating system's.
pub fn write(
    dir: &Path,
    family: &Family,
    cases: &[Case],
    solved: &Indexed,
    derivatives: Option<DerivativesOf<'_>>,
) -> Result<(), FormatError> {
    file::create_folder(dir)?;
    let mesh = family.problem.mesh();
    let text = |name: &str, text: String| file::replace(&dir.join(name), text.as_bytes());
    text("cases.csv", to_text(&case_columns(cases), case_rows(cases, solved)))?;
    text(VOLUMES, to_text(&VOLUME_COLUMNS, volume_rows(cases, solved)))?;
    text("residuals.csv", to_text(&RESIDUAL_COLUMNS, residual_rows(cases, solved)))?;
    write_snapshots(dir, family, cases, Vec::new(), solved)?;
    let cells = vtu::Cells::QuadraticTets(&mesh.tets);
    let grid = vtu::Grid { points_mm: &mesh.nodes_mm, cells, point_data: &[] };
    vtu::write(&dir.join("mesh.vtu"), &grid)?;
    let version = env!("CARGO_PKG_VERSION");
    let solver = format!(
        "softtwin simulate, version {version}, formulation {FORMULATION}; von Mises stress is the mean over the elements at a node"
    );
    let manifest = Manifest::new(&family.actuator.name, mesh.nodes_mm.len(), &FieldSpec::of_the_paper());
    let mut manifest = Manifest { mesh: Some("mesh.vtu".into()), solver: Some(solver), ..manifest };
    let parameters = cases.first().map_or(&[][..], |case| &case.settings);
    manifest.input.extend(parameters.iter().map(|(name, _)| Input {
        name: name.clone(),
        unit: unit(name).into(),
        nominal: family.actuator.quantity(name).ok(),
    }));
    if let Some(derivatives) = derivatives {
        write_sensitivities(dir, mesh.nodes_mm.len(), cases, solved, derivatives)?;
        manifest.sensitivities = Some(SENSITIVITIES.into());
        manifest.sensitivity_fields = Some(derivatives::FIELDS.map(str::to_owned).to_vec());
    }
    manifest.write(&dir.join(DESCRIPTION))
}

/// Writes the derivatives of all states, each row rounded to a share of its largest value, and the table that says whose
/// they are. A state without derivatives has no row.
fn write_sensitivities(
    dir: &Path,
    nodes: usize,
    cases: &[Case],
    solved: &Indexed,
    derivatives: DerivativesOf<'_>,
) -> Result<(), FormatError> {
    let (mut rows, mut values) = (Vec::new(), Vec::new());
    for (index, _) in solved {
        let case = &cases[*index];
        for (input, derivative) in
            derivatives::inputs(case).into_iter().zip(derivatives(case).unwrap_or_default())
        {
            rows.push([case.name.clone(), input.to_owned(), format!("{:e}", derivative.contact_force_n)]);
            values.extend(derivative.values);
        }
    }
    if rows.is_empty() {
        let diagnostic = Diagnostic::new("sensitivities", "a state with derivatives", "none");
        return Err(FormatError::one(dir, diagnostic));
    }
    let snapshots = Snapshots { shape: [rows.len(), nodes, derivatives::FIELDS.len()], values };
    let stored = [Stored::Share(SENSITIVITY_SHARE); derivatives::FIELDS.len()];
    packed::write(&dir.join(SENSITIVITIES), &snapshots, &stored)?;
    let table = to_text(&["case", "input", "contact_force_n_per_unit"], rows);
    file::replace(&dir.join("sensitivities.csv"), table.as_bytes())
}

/// Writes to `dir` the database at `from`, made by [`write()`] (packed or not), with more states behind it.
///
/// # Errors
/// The operating system's, or a database of another layout or mesh.
pub fn extend(
    from: &Path,
    dir: &Path,
    family: &Family,
    cases: &[Case],
    solved: &Indexed,
) -> Result<(), FormatError> {
    file::create_folder(dir)?;
    let mesh = family.problem.mesh();
    let manifest = Manifest::read(&from.join(DESCRIPTION))?;
    let mesh_file = manifest.mesh.clone().unwrap_or_default();
    let path = from.join(&manifest.snapshots);
    let before = database::read_snapshots(&path, Some(&from.join(&mesh_file)))?;
    let expected = [before.shape[0], mesh.nodes_mm.len(), FIELDS];
    if before.shape != expected {
        let (expected, found) = (format!("{expected:?} of this mesh"), format!("{:?}", before.shape));
        return Err(FormatError::one(&path, Diagnostic::new("shape", expected, found)));
    }
    let append = |name: &str, source: &str, heading: &[&str], rows: String| {
        let text = existing(&from.join(source), &heading.join(","))? + &rows;
        file::replace(&dir.join(name), text.as_bytes())
    };
    append("cases.csv", &manifest.cases, &case_columns(cases), to_text(&[], case_rows(cases, solved)))?;
    append(VOLUMES, VOLUMES, &VOLUME_COLUMNS, to_text(&[], volume_rows(cases, solved)))?;
    write_snapshots(dir, family, cases, before.values, solved)?;
    file::copy(&from.join(&mesh_file), &dir.join(&mesh_file))?;
    manifest.copy_with_names(
        &from.join(DESCRIPTION),
        &dir.join(DESCRIPTION),
        &[(&manifest.snapshots, SNAPSHOTS)],
    )
}

/// A table with that heading, ending with a line's end.
fn existing(path: &Path, heading: &str) -> Result<String, FormatError> {
    let text = file::read_text(path, file::MAX_TEXT_BYTES)?;
    let found = text.lines().next().unwrap_or("");
    if found != heading {
        return Err(FormatError::one(path, Diagnostic::new("heading", heading, format!("`{found}`"))));
    }
    Ok(text.trim_end().to_owned() + "\n")
}

fn case_columns(cases: &[Case]) -> Vec<&str> {
    columns(cases).into_iter().chain(["contact_force_n"]).collect()
}

/// Force out of balance at the end of each solution, in N and relative to the larger of support reaction and obstacle force.
fn residual_rows(cases: &[Case], solved: &Indexed) -> impl Iterator<Item = [String; 5]> {
    solved.iter().map(|(index, state)| {
        let r = &state.report;
        let counts = [r.factorisations, r.steps].map(|n| n.to_string());
        let [factorisations, steps] = counts;
        let forces = [r.residual_n, r.residual].map(|v| format!("{v:.2e}"));
        let [out_of_balance, residual] = forces;
        [cases[*index].name.clone(), out_of_balance, residual, factorisations, steps]
    })
}

fn case_rows(cases: &[Case], solved: &Indexed) -> impl Iterator<Item = Vec<String>> {
    let force = |state: &Solved| format!("{:.6}", state.contact_force_n);
    solved.iter().map(move |(index, state)| cases[*index].cells().into_iter().chain([force(state)]).collect())
}

fn volume_rows(cases: &[Case], solved: &Indexed) -> impl Iterator<Item = [String; 4]> {
    solved.iter().map(|(index, state)| {
        let case = &cases[*index];
        let (name, pressure) = (case.name.clone(), case.pressure_mpa.to_string());
        [name, pressure, case.gap_cell(), format!("{:.3}", state.cavity_volume_mm3)]
    })
}

/// Writes the states behind the values that are there.
fn write_snapshots(
    dir: &Path,
    family: &Family,
    cases: &[Case],
    mut values: Vec<f32>,
    solved: &Indexed,
) -> Result<(), FormatError> {
    let nodes = family.problem.mesh().nodes_mm.len();
    for (index, state) in solved {
        let undeformed = undeformed(family, &cases[*index]).map_err(|reason| {
            let place = format!("case {}", cases[*index].name);
            FormatError::one(dir, Diagnostic::new(place, "parameters that can be had", reason))
        })?;
        for (n, x) in undeformed.iter().enumerate() {
            let u = state.state.displacement_mm[n];
            values.extend((0..3).map(|k| (x[k] + u[k]) as f32));
            values.extend([norm(u) as f32, state.von_mises_mpa[n]]);
        }
    }
    npy::write_f32(&dir.join(SNAPSHOTS), &[values.len() / (nodes * FIELDS), nodes, FIELDS], &values)
}

/// Undeformed nodes of a case's variant.
fn undeformed(family: &Family, case: &Case) -> Result<Vec<[f64; 3]>, VariantError> {
    let actuator = family.actuator_of(&family.variant(&case.settings)?)?;
    moved_nodes(family.problem.mesh(), &family.actuator, &actuator).map_err(VariantError::Values)
}
