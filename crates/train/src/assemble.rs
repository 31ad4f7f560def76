//! Model and data sheet from trained regimes; checks that the effects of inputs can be separated.

use crate::config::TrainConfig;
use crate::datasheet::{Candidate, CaseError, DataSheet, FieldSheet, FitSheet, InputSheet, RegimeSheet};
use crate::error::TrainError;
use crate::group::{GroupFit, Plan};
use crate::regime::{OnsetModel, TrainedRegime};
use crate::sort::{TrainingCases, varying};
use faer::Mat;
use rom::inputs::{InputMap, InputSpec, Inputs, MAX_INPUTS, PARAMETERS};
use rom::interpolant::Interpolant;
use rom::model::{BlockData, BlockKind, Model, ModelHeader, OutputField};
use rom::snapshots::{Database, FieldKind, RegimeKind};

/// Largest distance from a plane, as a fraction of their spread, at which states count as lying on it.
const FLAT: f64 = 1e-6;
/// Smallest component in the direction normal to the plane at which an input is named.
const NAMED_COMPONENT: f64 = 0.1;
/// Two inputs do the same when the cosine between their derivatives of all states is at least this.
const SAME: f64 = 0.99;

pub(crate) fn assemble(
    database: &Database,
    config: &TrainConfig,
    plan: &Plan,
    parts: &[TrainedRegime],
    onset: Option<OnsetModel>,
    remarks: Vec<String>,
) -> (Model, DataSheet) {
    let fields = database.fields.iter().zip(&plan.magnitude_of);
    let maps = parts.iter().map(|part| &part.inputs);
    let inputs = InputSpec::ranged(InputSpec::without_range(&database.parameters), maps);
    let sheet = DataSheet {
        actuator: database.actuator.clone(),
        database_hash: database.hash.iter().map(|b| format!("{b:02x}")).collect(),
        node_count: database.node_count,
        fields: fields
            .clone()
            .map(|(f, derived)| FieldSheet {
                name: f.name.clone(),
                unit: f.unit.clone(),
                source: if derived.is_some() { "derived from the coordinates" } else { "interpolated" }
                    .into(),
            })
            .collect(),
        regimes: parts.iter().map(|part| regime_sheet(plan, part, &inputs)).collect(),
        sag_mm: onset.as_ref().map(|onset| onset.table.sag_mm()),
        reach_mm: onset.as_ref().map(|onset| onset.table.reach_mm()),
        remarks,
        config: config.clone(),
    };
    let header = ModelHeader {
        actuator: database.actuator.clone(),
        inputs,
        fields: fields.map(|(spec, axes)| OutputField { spec: spec.clone(), magnitude_of: *axes }).collect(),
        node_count: database.node_count,
        regimes: parts.iter().map(|part| part.model(plan)).collect(),
        onset: onset.as_ref().map(|onset| onset.table.clone()),
        hysteresis_mpa: config.hysteresis_mpa,
        node_sets: database.node_sets.clone(),
        database_hash: database.hash,
        clearance: onset.and_then(OnsetModel::into_clearance),
        limit: config.limit.clone(),
        body: None,
        learned: None,
    };
    let mut blocks: Vec<(BlockKind, BlockData)> = Vec::new();
    // A basis that goes on from that of the free regime holds that one's modes.
    let is_shared = config.centred && parts.len() > 1;
    for part in parts.iter().filter(|part| !is_shared || part.kind == RegimeKind::Contact) {
        blocks.extend(field_blocks(database, plan, part));
    }
    if let Some(mesh) = &database.undeformed_mm {
        for axis in 0..3 {
            let values = mesh.iter().map(|x| x[axis] as f32).collect();
            blocks.push((BlockKind::Undeformed(axis as u8), BlockData::F32(values)));
        }
    }
    for (index, by) in database.undeformed_by.iter().enumerate() {
        let (input, from_bits) = ((PARAMETERS + index) as u32, database.parameters[index].nominal.to_bits());
        for axis in (0..3).filter(|axis| by.iter().any(|x| x[*axis] != 0.0)) {
            let values = by.iter().map(|x| x[axis]).collect();
            let kind = BlockKind::UndeformedBy { input, axis: axis as u8, from_bits };
            blocks.push((kind, BlockData::F32(values)));
        }
    }
    if !database.surface_triangles.is_empty() {
        blocks.push((BlockKind::Surface, BlockData::U32(database.surface_triangles.concat())));
    }
    (Model { header, blocks }, sheet)
}

fn field_blocks(database: &Database, plan: &Plan, part: &TrainedRegime) -> Vec<(BlockKind, BlockData)> {
    let (nodes, regime) = (database.node_count, part.kind);
    let mut blocks = Vec::new();
    for (group, fit) in plan.groups.iter().zip(&part.groups) {
        for (index, &field) in group.fields.iter().enumerate() {
            let (rows, field) = (index * nodes..(index + 1) * nodes, field as u32);
            let mean = fit.compact.mean[rows].iter().map(|v| *v as f32).collect();
            blocks.push((BlockKind::Mean { regime, field }, BlockData::F32(mean)));
            blocks.push((BlockKind::Modes { regime, field }, BlockData::Modes(fit.stored[index].clone())));
        }
    }
    blocks
}

fn regime_sheet(plan: &Plan, part: &TrainedRegime, inputs: &[InputSpec]) -> RegimeSheet {
    RegimeSheet {
        kind: part.kind,
        cases: part.cases,
        boundary_states: part.boundary_states,
        inputs: part
            .inputs
            .axes
            .iter()
            .map(|a| InputSheet { name: inputs[a.input].key(), min: a.min, max: a.max })
            .collect(),
        groups: plan
            .groups
            .iter()
            .zip(&part.groups)
            .map(|(group, fit)| group_sheet(&group.name, fit))
            .collect(),
        force: part.force.as_ref().map(|force| {
            fit_sheet("contact_force", 0, 0.0, &force.model.surrogate, force.error_n, &force.candidates)
        }),
        force_violation: part.force.as_ref().and_then(|force| force.violation.clone()),
        halfwidths: part.halfwidths,
        unseen_states: 0,
        leave_one_out: part.errors.clone(),
    }
}

fn group_sheet(name: &str, fit: &GroupFit) -> FitSheet {
    // The score is the norm of a whole error vector; by entry it reads in the field's unit.
    let entries = fit.compact.mean.len() as f64;
    let (choice, error) = (&fit.choice, fit.choice.error / entries.sqrt());
    let truncation = fit.pod.truncation_error(choice.modes);
    fit_sheet(name, choice.modes, truncation, &choice.fit.interpolant, error, &choice.candidates)
}

fn fit_sheet(
    name: &str,
    modes: usize,
    truncation_error: f64,
    fit: &Interpolant,
    leave_one_out: f64,
    candidates: &[Candidate],
) -> FitSheet {
    FitSheet {
        name: name.into(),
        modes,
        truncation_error,
        condition: fit.condition,
        residual: fit.residual,
        leave_one_out,
        candidates: candidates.to_vec(),
    }
}

/// Refuses states along which several inputs vary together: no model could tell what is whose effect.
///
/// # Errors
/// [`TrainError::Database`] with the inputs by name.
pub(crate) fn check_spread(database: &Database, sorted: &TrainingCases) -> Result<(), TrainError> {
    let mut problems = Vec::new();
    for kind in [RegimeKind::Free, RegimeKind::Contact] {
        let (cases, inputs) = (sorted.of(kind), varying(database, kind));
        let states: Vec<Inputs> = cases.iter().map(|&i| database.cases[i].inputs()).collect();
        let map = InputMap::of_states(&states, &inputs);
        if map.operating() == map.dimensions() || states.is_empty() {
            continue;
        }
        if let Some(across) = flat_direction(&map, &states) {
            let specs = InputSpec::without_range(&database.parameters);
            let named =
                map.axes.iter().zip(&across).filter(|(_, component)| component.abs() > NAMED_COMPONENT);
            let names: Vec<String> = named.map(|(axis, _)| specs[axis.input].key()).collect();
            problems.push(format!(
                "in the {} {} training states {} vary together: no model can tell their effects apart; vary each for \
                 itself, or leave all but one out",
                states.len(),
                kind.name(),
                names.join(", ")
            ));
        }
    }
    if problems.is_empty() { Ok(()) } else { Err(TrainError::Database(problems)) }
}

/// The direction over scaled inputs in which the states do not spread.
fn flat_direction(map: &InputMap, states: &[Inputs]) -> Option<Vec<f64>> {
    let (n, d) = (states.len(), map.dimensions());
    let points: Vec<_> = states.iter().map(|state| map.scale(state)).collect();
    let mean: Vec<f64> = (0..d).map(|i| points.iter().map(|p| p[i]).sum::<f64>() / n as f64).collect();
    let spread = Mat::from_fn(n.max(d), d, |j, i| if j < n { points[j][i] - mean[i] } else { 0.0 });
    let svd = spread.thin_svd().ok()?;
    let values = svd.S().column_vector();
    (values[d - 1] < FLAT * values[0]).then(|| svd.V().col(d - 1).iter().copied().collect())
}

/// Remarks of the data sheet on parameters without effect and on inputs with equal effects.
pub(crate) fn remarks(database: &Database, parts: &[TrainedRegime]) -> Vec<String> {
    let specs = InputSpec::without_range(&database.parameters);
    let mut remarks = Vec::new();
    for (input, spec) in specs.iter().enumerate().skip(PARAMETERS) {
        let taken: Vec<&TrainedRegime> =
            parts.iter().filter(|part| part.inputs.axes.iter().any(|axis| axis.input == input)).collect();
        if !taken.is_empty() && taken.iter().all(|part| part.idle.contains(&input)) {
            remarks.push(format!(
                "{} changes nothing that the training states show: leaving it out predicts left-out states as well; leave \
                 the column out or widen its range",
                spec.key()
            ));
        }
    }
    let slopes = Slopes::of(parts);
    for a in 0..specs.len() {
        for b in (a + 1).max(PARAMETERS)..specs.len() {
            if let Some(cosine) = slopes.cosine(a, b).filter(|cosine| cosine.abs() >= SAME) {
                remarks.push(format!(
                    "{} and {} do the same in all training states (cosine of their derivatives {cosine:.5}): forces and fields \
                     cannot tell one from the other",
                    specs[a].key(),
                    specs[b].key()
                ));
            }
        }
    }
    for part in parts {
        let violation = part.force.as_ref().and_then(|force| force.violation.as_ref());
        remarks.extend(violation.map(ToString::to_string));
        remarks.extend(off_curve(database, &part.errors));
    }
    remarks
}

/// Products of the derivatives of all coefficients in all training states, by pairs of inputs.
struct Slopes([[f64; MAX_INPUTS]; MAX_INPUTS]);

impl Slopes {
    fn of(parts: &[TrainedRegime]) -> Self {
        let mut products = [[0.0; MAX_INPUTS]; MAX_INPUTS];
        for part in parts.iter().filter(|part| part.inputs.operating() < part.inputs.dimensions()) {
            let gradients_of = |fit: &Interpolant| -> Vec<Vec<Vec<f64>>> {
                part.scaled.iter().map(|x| fit.gradient_at(x)).collect()
            };
            let square_of =
                |all: &[Vec<Vec<f64>>]| all.iter().flatten().flatten().map(|v| v * v).sum::<f64>();
            let fits: Vec<&Interpolant> =
                part.groups.iter().map(|group| &group.choice.fit.interpolant).collect();
            let gradients: Vec<Vec<Vec<Vec<f64>>>> = fits.iter().map(|fit| gradients_of(fit)).collect();
            for (fit, all) in fits.iter().zip(&gradients) {
                // Coordinates count by their common length: one along which hardly anything moves says little.
                let together = fits.iter().zip(&gradients).filter(|(other, _)| other.shares_kernel_with(fit));
                let square: f64 = together.map(|(_, all)| square_of(all)).sum();
                for rows in all.iter().filter(|_| square > 0.0) {
                    for (a, axis) in part.inputs.axes.iter().enumerate() {
                        for (b, other) in part.inputs.axes.iter().enumerate() {
                            let product: f64 = rows[a].iter().zip(&rows[b]).map(|(x, y)| x * y).sum();
                            products[axis.input][other.input] += product / square;
                        }
                    }
                }
            }
        }
        Self(products)
    }

    fn cosine(&self, a: usize, b: usize) -> Option<f64> {
        let sizes = self.0[a][a] * self.0[b][b];
        (sizes > 0.0).then(|| self.0[a][b] / sizes.sqrt())
    }
}

/// Ratio of a leave-one-out error to the median of its regime from which a state lies off the curve of its neighbours.
const OFF_CURVE: f64 = 10.0;
/// Least such error, as a fraction of the largest change of a coordinate between states.
const OFF_CURVE_FLOOR: f64 = 0.005;
/// Fewer states than this say nothing about a median.
const OFF_CURVE_CASES: usize = 5;

/// States that lie off the curve of their neighbours, such as those of a solver that stopped early.
fn off_curve(database: &Database, errors: &[CaseError]) -> Vec<String> {
    let inner: Vec<&CaseError> = errors.iter().filter(|error| !error.on_hull).collect();
    if inner.len() < OFF_CURVE_CASES {
        return Vec::new();
    }
    let mut sorted: Vec<f64> = inner.iter().map(|error| error.displacement_mm).collect();
    sorted.sort_by(f64::total_cmp);
    let median = sorted[sorted.len() / 2];
    let coordinates = (0..database.fields.len())
        .filter(|f| matches!(database.fields[*f].kind, FieldKind::Coordinate(_)))
        .flat_map(|f| (1..database.cases.len()).map(move |case| (f, case)));
    let change_mm = |(f, case)| {
        let pairs = database.field(0, f).zip(database.field(case, f));
        pairs.fold(0.0_f64, |most, (a, b)| most.max(f64::from(a - b).abs()))
    };
    let largest_mm = coordinates.map(change_mm).fold(0.0, f64::max);
    let is_off = |error: &&&CaseError| {
        error.displacement_mm > OFF_CURVE * median && error.displacement_mm > OFF_CURVE_FLOOR * largest_mm
    };
    // A state off the curve raises the errors of its neighbours: only the largest is named.
    let worst = inner.iter().filter(is_off).max_by(|a, b| a.displacement_mm.total_cmp(&b.displacement_mm));
    let say = |error: &&CaseError| {
        format!(
            "state {} lies {:.3} mm off what the others predict there, {:.0} times the median of the regime: check that its \
             simulation converged",
            error.case,
            error.displacement_mm,
            error.displacement_mm / median
        )
    };
    worst.into_iter().map(say).collect()
}
