//! Database folder, as `softtwin train --database` reads it, with cavity volumes and the balance of forces.

use super::derivatives::{self, Derivative};
use super::store::Solved;
use crate::actuator::{Setting, moved_nodes, unit};
use crate::algebra::norm;
use crate::cases::{COLUMNS, Case, VOLUME, VOLUME_COLUMNS, by_volume, columns};
use crate::family::{Family, Variant, VariantError};
use crate::solver::FORMULATION;
use formats::database::{self, Input, Manifest};
use formats::packed::{self, Snapshots, Stored};
use formats::table::to_text;
use formats::{Diagnostic, FormatError, file, npy, vtu};
use rom::snapshots::{FieldKind, FieldSpec, NodeSet};
use std::path::Path;
use std::sync::Arc;

const DESCRIPTION: &str = "database.toml";
const SNAPSHOTS: &str = "snapshots.npy";
const VOLUMES: &str = "volumes.csv";
const SENSITIVITIES: &str = "sensitivities.pack";
/// Largest error of a derivative, as a fraction of the largest of its row and field.
const SENSITIVITY_ERROR: f64 = 5.0e-5;
const UNDEFORMED_BY: &str = "undeformed_by.npy";
/// Half the step of the difference of undeformed nodes, as a fraction of the parameter.
const SHAPE_STEP: f64 = 1.0e-3;
/// Tolerance (mm) within which the map of the mesh is linear in each parameter.
const FOLLOWS_WITHIN_MM: f64 = 1.0e-6;
/// Columns of the balance of forces.
const RESIDUAL_COLUMNS: [&str; 5] = ["case", "out_of_balance_n", "residual", "factorisations", "steps"];
/// Field of a pressure that is a result.
const PRESSURE: &str = "pressure";

/// Source of a case's derivatives.
type DerivativesOf<'a> = &'a dyn Fn(&Case) -> Option<Vec<Derivative>>;

/// States with their index in the list of cases.
type Indexed = [(usize, Arc<Solved>)];

/// Writes the folder: `cases.csv`, `volumes.csv`, `residuals.csv`, `snapshots.npy`, `mesh.vtu`, with derivatives
/// `sensitivities.pack` and `sensitivities.csv`, and, last, `database.toml`. `solved` holds the index of each state in
/// `cases`; `derivatives` returns those of a case, if the database contains them.
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
    let manifest = Manifest::new(&family.actuator.name, mesh.nodes_mm.len(), &fields(cases));
    let mut manifest = Manifest { mesh: Some("mesh.vtu".into()), solver: Some(solver), ..manifest };
    manifest.node_set = parts(family);
    if by_volume(cases) {
        manifest.pressure_as_result(Input { name: VOLUME.into(), unit: "mm3".into(), nominal: Some(0.0) });
    }
    let parameters = cases.first().map_or(&[][..], |case| &case.settings);
    manifest.input.extend(parameters.iter().map(|(name, _)| Input {
        name: name.clone(),
        unit: unit(name).into(),
        nominal: family.actuator.quantity(name).ok(),
    }));
    if let Some(values) = undeformed_by(dir, family, cases, solved)? {
        npy::write_f32(&dir.join(UNDEFORMED_BY), &[parameters.len(), mesh.nodes_mm.len(), 3], &values)?;
        manifest.undeformed_by = Some(UNDEFORMED_BY.into());
    }
    if let Some(derivatives) = derivatives {
        write_sensitivities(dir, mesh.nodes_mm.len(), cases, solved, derivatives)?;
        manifest.sensitivities = Some(SENSITIVITIES.into());
        manifest.sensitivity_fields = Some(derivatives::FIELDS.map(str::to_owned).to_vec());
    }
    manifest.write(&dir.join(DESCRIPTION))
}

/// Nodes of each cavity, if there are several, of the volumes of each material but the elastomer, by their names, and of the end face
/// `tip` of a mesh of another program.
fn parts(family: &Family) -> Vec<NodeSet> {
    let (mesh, actuator) = (family.problem.mesh(), &family.actuator);
    let further = actuator.pressure_mpa.keys().zip(&mesh.cavities);
    let further = further.map(|(name, walls)| (format!("cavity.{name}"), walls.as_flattened().to_vec()));
    let first = (!mesh.cavities.is_empty()).then(|| ("cavity".into(), mesh.cavity.as_flattened().to_vec()));
    let materials = actuator.materials.keys().zip(1..).map(|(name, material): (_, u16)| {
        let tets = mesh.tets.iter().zip(&mesh.tet_material).filter(|(_, own)| **own == material);
        (format!("material.{name}"), tets.flat_map(|(tet, _)| *tet).collect())
    });
    let set = |(name, mut nodes): (String, Vec<u32>)| {
        nodes.sort_unstable();
        nodes.dedup();
        NodeSet { name, nodes }
    };
    let tip = actuator.shape().is_none().then(|| ("tip".into(), mesh.end_face().nodes));
    first.into_iter().chain(further).chain(materials).chain(tip).map(set).collect()
}

/// Writes the derivatives of all states, each row rounded to a fraction of its largest value, and the table of their cases and
/// inputs. A state without derivatives has no row.
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
    let stored = [Stored::Share(SENSITIVITY_ERROR); derivatives::FIELDS.len()];
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
    let expected = [before.shape[0], mesh.nodes_mm.len(), fields(cases).len()];
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
    for name in [&mesh_file].into_iter().chain(&manifest.undeformed_by) {
        file::copy(&from.join(name), &dir.join(name))?;
    }
    manifest.copy_with_names(
        &from.join(DESCRIPTION),
        &dir.join(DESCRIPTION),
        &[(&manifest.snapshots, SNAPSHOTS)],
    )
}

/// Table with that heading, ending with a newline.
fn existing(path: &Path, heading: &str) -> Result<String, FormatError> {
    let text = file::read_text(path, file::MAX_TEXT_BYTES)?;
    let found = text.lines().next().unwrap_or("");
    if found != heading {
        return Err(FormatError::one(path, Diagnostic::new("heading", heading, format!("`{found}`"))));
    }
    Ok(text.trim_end().to_owned() + "\n")
}

fn case_columns(cases: &[Case]) -> Vec<&str> {
    let pressure = by_volume(cases).then_some(COLUMNS[3]);
    columns(cases).into_iter().chain(["contact_force_n"]).chain(pressure).collect()
}

/// Fields of a snapshot; a pressure that is a result is one of them, the same at all nodes.
fn fields(cases: &[Case]) -> Vec<FieldSpec> {
    let pressure = FieldSpec { name: PRESSURE.into(), unit: "MPa".into(), kind: FieldKind::Other };
    FieldSpec::of_the_paper().into_iter().chain(by_volume(cases).then_some(pressure)).collect()
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
    let pressure = |state: &Solved| {
        let load = state.state.load;
        load.injected_mm3.map(|_| load.pressure_mpa.to_string())
    };
    solved.iter().map(move |(index, state)| {
        cases[*index].cells().into_iter().chain([force(state)]).chain(pressure(state)).collect()
    })
}

fn volume_rows(cases: &[Case], solved: &Indexed) -> impl Iterator<Item = [String; 4]> {
    solved.iter().map(|(index, state)| {
        let case = &cases[*index];
        let (name, pressure) = (case.name.clone(), state.state.load.pressure_mpa.to_string());
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
        let case = &cases[*index];
        let undeformed = family.variant(&case.settings).and_then(|variant| undeformed(family, &variant));
        let undeformed = undeformed.map_err(|reason| impossible(dir, case, reason))?;
        for (n, x) in undeformed.iter().enumerate() {
            let u = state.state.displacement_mm[n];
            values.extend((0..3).map(|k| (x[k] + u[k]) as f32));
            values.extend([norm(u) as f32, state.von_mises_mpa[n]]);
            values.extend(case.volume_mm3.map(|_| state.state.load.pressure_mpa as f32));
        }
    }
    let fields = fields(cases).len();
    npy::write_f32(&dir.join(SNAPSHOTS), &[values.len() / (nodes * fields), nodes, fields], &values)
}

fn impossible(dir: &Path, case: &Case, reason: VariantError) -> FormatError {
    let place = format!("case {}", case.name);
    FormatError::one(dir, Diagnostic::new(place, "parameters that can be had", reason))
}

/// Undeformed nodes of a variant.
fn undeformed(family: &Family, variant: &Variant) -> Result<Vec<[f64; 3]>, VariantError> {
    let actuator = family.actuator_of(variant)?;
    moved_nodes(family.problem.mesh(), &family.actuator, &actuator).map_err(VariantError::Values)
}

/// Derivatives of the undeformed nodes with respect to each parameter (mm per unit), parameter by parameter. `None` if no
/// parameter moves them or if their positions are not linear in the parameters.
fn undeformed_by(
    dir: &Path,
    family: &Family,
    cases: &[Case],
    solved: &Indexed,
) -> Result<Option<Vec<f32>>, FormatError> {
    let Some(first) = cases.first().filter(|case| !case.settings.is_empty()) else { return Ok(None) };
    let at =
        |case: &Case, variant| undeformed(family, &variant).map_err(|reason| impossible(dir, case, reason));
    let (mesh, nominal) = (&family.problem.mesh().nodes_mm, Variant::default());
    let mut by = Vec::new();
    for (name, _) in &first.settings {
        let step = SHAPE_STEP * family.value(&nominal, name).abs();
        let below = at(first, family.stepped(&nominal, name, -step))?;
        let above = at(first, family.stepped(&nominal, name, step))?;
        let slope = |(a, b): (&[f64; 3], &[f64; 3])| [0, 1, 2].map(|k| (a[k] - b[k]) / (2.0 * step));
        by.push(above.iter().zip(&below).map(slope).collect::<Vec<_>>());
    }
    let mut moves = false;
    for case in solved.iter().map(|(index, _)| &cases[*index]) {
        let variant = family.variant(&case.settings).map_err(|reason| impossible(dir, case, reason))?;
        let step = |(name, value): &Setting| value - family.value(&nominal, name);
        let steps: Vec<f64> = case.settings.iter().map(step).collect();
        for (n, x) in at(case, variant)?.iter().enumerate() {
            moves |= *x != mesh[n];
            let add =
                |x: [f64; 3], (step, by): (&f64, &Vec<[f64; 3]>)| [0, 1, 2].map(|k| x[k] + step * by[n][k]);
            let follows = steps.iter().zip(&by).fold(mesh[n], add);
            if norm([0, 1, 2].map(|k| x[k] - follows[k])) > FOLLOWS_WITHIN_MM {
                return Ok(None);
            }
        }
    }
    Ok(moves.then(|| by.iter().flat_map(|nodal| nodal.as_flattened()).map(|v| *v as f32).collect()))
}
