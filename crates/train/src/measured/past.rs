//! Models of measurements with memory: the blocks first, then the static map of the inputs behind them.

use super::data::scales;
use super::layout::{PRESSURE_NAME, outputs};
use super::{Learned, Measured, MeasuredError, Run, fit, select};
use crate::memory::{Identified, identify, slopes};
use rom::inputs::{Inputs, PARAMETERS, PRESSURE};
use rom::memory::MemorySpec;
use rom::model::{BlockData, BlockKind, Model};

/// Difference between runs, as a fraction of the length of the outputs' range.
const MOUNTING: f64 = 0.005;
/// Instants at which the slopes of the answers are taken.
const SLOPE_ROWS: usize = 200;

/// Selects the columns that move, identifies their memory, and fits the static map of the inputs behind it. Without a block that improves
/// left-out parts the model is that of [`super::learn`].
///
/// # Errors
/// [`MeasuredError`].
pub fn learn_with_memory(actuator: &str, data: &Measured) -> Result<(Learned, Identified), MeasuredError> {
    let mut remarks = Vec::new();
    let moving = select(data, &mut remarks)?;
    let runs: Vec<Run> = moving.runs.iter().map(driven).filter(|run| run.time_s.len() > 1).collect();
    let scales = scales(&moving.outputs, &runs);
    let are_pressures = moving.inputs.iter().all(|name| name.ends_with("_mpa"));
    let found = identify(&runs, are_pressures, &scales, None).ok_or(MeasuredError::Singular)?;
    let Some(spec) = &found.memory else {
        let mut learned = fit(actuator, &moving)?;
        remarks.append(&mut learned.remarks);
        return Ok((Learned { remarks, ..learned }, found));
    };
    let behind = |run: &Run| Run {
        time_s: run.time_s.clone(),
        inputs: spec.inputs.iter().map(|of| of.responses(&run.time_s, &run.inputs[of.input])).collect(),
        outputs: run.outputs.clone(),
    };
    let behind =
        Measured { runs: runs.iter().map(behind).collect(), inputs: moving.inputs, outputs: moving.outputs };
    let mut learned = fit(actuator, &behind)?;
    remarks.append(&mut learned.remarks);
    learned.remarks = remarks;
    let placed = placed(spec, &behind, &learned.model);
    learned.model.set_record(BlockKind::Memory, &placed)?;
    if behind.runs.len() == 1 {
        allow_for_mounting(&mut learned, &scales);
    }
    Ok((learned, found))
}

/// Adds to the half-widths what one run cannot show: markers and actuator are placed again for the next one.
fn allow_for_mounting(learned: &mut Learned, lengths: &[f64]) {
    for (report, length) in learned.outputs.iter_mut().zip(lengths) {
        report.half_width = report.half_width.hypot(MOUNTING * length);
    }
    for output in outputs(&learned.model) {
        let Some(report) = learned.outputs.iter().find(|report| report.name == output.name) else { continue };
        let kind = BlockKind::HalfWidth { field: output.field as u32 };
        for (_, data) in learned.model.blocks.iter_mut().filter(|(k, _)| *k == kind) {
            if let BlockData::F32(widths) = data {
                widths[output.node] = report.half_width as f32;
            }
        }
    }
}

/// The rows of a run that have all inputs and come after the row before.
fn driven(run: &Run) -> Run {
    let mut last_s = f64::NEG_INFINITY;
    let mut is_driven = |row: &usize| {
        let time_s = run.time_s[*row];
        let keeps = time_s > last_s && run.inputs.iter().all(|column| column[*row].is_finite());
        if keeps {
            last_s = time_s;
        }
        keeps
    };
    let rows: Vec<usize> = (0..run.time_s.len()).filter(&mut is_driven).collect();
    let pick = |column: &Vec<f64>| -> Vec<f64> { rows.iter().map(|row| column[*row]).collect() };
    Run {
        time_s: pick(&run.time_s),
        inputs: run.inputs.iter().map(pick).collect(),
        outputs: run.outputs.iter().map(pick).collect(),
    }
}

/// The blocks at the positions of the model's inputs, with the slopes of its answers.
fn placed(spec: &MemorySpec, behind: &Measured, model: &Model) -> MemorySpec {
    let pressure = behind.inputs.iter().position(|name| name == PRESSURE_NAME);
    let position = |column: usize| {
        let further = column - usize::from(pressure.is_some_and(|at| at < column));
        if Some(column) == pressure { PRESSURE } else { PARAMETERS + further }
    };
    let positions: Vec<usize> = (0..behind.inputs.len()).map(position).collect();
    let state = |run: &Run, row: usize| {
        let start = Inputs::new(0.0, f64::INFINITY);
        positions.iter().zip(&run.inputs).fold(start, |state, (at, column)| state.with(*at, column[row]))
    };
    let rows = || behind.runs.iter().flat_map(|run| (0..run.time_s.len()).map(move |row| (run, row)));
    let step = rows().count().div_ceil(SLOPE_ROWS).max(1);
    let states: Vec<Inputs> = rows().step_by(step).map(|(run, row)| state(run, row)).collect();
    let mut inputs = spec.inputs.clone();
    for of in &mut inputs {
        of.slopes = slopes(model, &states, positions[of.input], of.range);
        of.input = positions[of.input];
    }
    inputs.sort_by_key(|of| of.input);
    MemorySpec { inputs, max_gap_s: spec.max_gap_s }
}
