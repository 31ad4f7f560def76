//! From trained parts to the model and its data sheet.

use crate::boundary::OnsetBoundary;
use crate::config::TrainConfig;
use crate::datasheet::{Candidate, DataSheet, FieldSheet, FitSheet, InputSheet, RegimeSheet};
use crate::group::{GroupFit, Plan};
use crate::regime::Part;
use rom::inputs::{InputSpec, PARAMETERS};
use rom::interpolant::Interpolant;
use rom::model::{BlockData, BlockKind, Model, ModelHeader, OutputField};
use rom::snapshots::Database;

pub(crate) fn assemble(
    database: &Database,
    config: &TrainConfig,
    plan: &Plan,
    parts: Vec<Part>,
    onset: Option<OnsetBoundary>,
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
        clearance: onset.and_then(OnsetBoundary::into_clearance),
    };
    let mut blocks: Vec<(BlockKind, BlockData)> =
        parts.iter().flat_map(|part| field_blocks(database, plan, part)).collect();
    if let Some(mesh) = &database.undeformed_mm {
        for axis in 0..3 {
            let values = mesh.iter().map(|x| x[axis] as f32).collect();
            blocks.push((BlockKind::Undeformed(axis as u8), BlockData::F32(values)));
        }
    }
    for (at, by) in database.undeformed_by.iter().enumerate() {
        let (input, from_bits) = ((PARAMETERS + at) as u32, database.parameters[at].nominal.to_bits());
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

fn field_blocks(database: &Database, plan: &Plan, part: &Part) -> Vec<(BlockKind, BlockData)> {
    let (nodes, regime) = (database.node_count, part.kind);
    let mut blocks = Vec::new();
    for (group, fit) in plan.groups.iter().zip(&part.groups) {
        for (at, &field) in group.fields.iter().enumerate() {
            let (rows, field) = (at * nodes..(at + 1) * nodes, field as u32);
            let mean = fit.compact.mean[rows].iter().map(|v| *v as f32).collect();
            blocks.push((BlockKind::Mean { regime, field }, BlockData::F32(mean)));
            blocks.push((BlockKind::Modes { regime, field }, BlockData::Modes(fit.stored[at].clone())));
        }
    }
    blocks
}

fn regime_sheet(plan: &Plan, part: &Part, inputs: &[InputSpec]) -> RegimeSheet {
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
        force: part.force.as_ref().map(|(model, candidates, rms, _)| {
            fit_sheet("contact_force", 0, 0.0, &model.surrogate, *rms, candidates)
        }),
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
