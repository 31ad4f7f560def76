//! Columns that move, and the noise of a column.

use super::data::{Measured, MeasuredError, Run};
use super::layout::PRESSURE_NAME;
use rom::inputs::{MAX_INPUTS, PARAMETERS};
use rom::statistics::mean;

/// Smallest range of an input, as a fraction of the largest in the same unit.
const LEAST_FRACTION: f64 = 0.05;
/// Range from which an input moves however it scatters from row to row.
const CLEAR_FRACTION: f64 = 0.25;
/// Largest ratio of half the mean square step to the variance (von Neumann) of a column that moves: 1 for noise.
const LARGEST_RATIO: f64 = 0.1;
/// Quantile at both ends beyond which values count as outliers.
const OUTLIERS: f64 = 0.005;

/// The inputs and outputs that move, the others with a remark.
///
/// # Errors
/// [`MeasuredError::Still`], [`MeasuredError::NoOutput`], [`MeasuredError::Many`].
pub fn select(data: &Measured, remarks: &mut Vec<String>) -> Result<Measured, MeasuredError> {
    let inputs = moving(&data.inputs, &columns(data, |run| &run.inputs), true, remarks);
    let outputs = moving(&data.outputs, &columns(data, |run| &run.outputs), false, remarks);
    let has_pressure = inputs.iter().any(|at| data.inputs[*at] == PRESSURE_NAME);
    let most = MAX_INPUTS - PARAMETERS + usize::from(has_pressure);
    match (inputs.is_empty(), outputs.is_empty()) {
        (true, _) => Err(MeasuredError::Still),
        (_, true) => Err(MeasuredError::NoOutput),
        _ if inputs.len() > most => Err(MeasuredError::Many { expected: most, found: inputs.len() }),
        _ => Ok(Measured {
            inputs: inputs.iter().map(|at| data.inputs[*at].clone()).collect(),
            outputs: outputs.iter().map(|at| data.outputs[*at].clone()).collect(),
            runs: data
                .runs
                .iter()
                .map(|run| Run {
                    time_s: run.time_s.clone(),
                    inputs: inputs.iter().map(|at| run.inputs[*at].clone()).collect(),
                    outputs: outputs.iter().map(|at| run.outputs[*at].clone()).collect(),
                })
                .collect(),
        }),
    }
}

/// Finite values of each run, by column.
fn columns(data: &Measured, columns_of: impl Fn(&Run) -> &Vec<Vec<f64>>) -> Vec<Vec<Vec<f64>>> {
    let count = data.runs.first().map_or(0, |run| columns_of(run).len());
    let finite = |values: &Vec<f64>| values.iter().copied().filter(|v| v.is_finite()).collect();
    (0..count).map(|at| data.runs.iter().map(|run| finite(&columns_of(run)[at])).collect()).collect()
}

fn moving(
    names: &[String],
    columns: &[Vec<Vec<f64>>],
    of_inputs: bool,
    remarks: &mut Vec<String>,
) -> Vec<usize> {
    let unit = |index: usize| names[index].rsplit('_').next().unwrap_or_default();
    let ranges: Vec<f64> = columns.iter().map(|runs| inner_range(&runs.concat())).collect();
    let moves = |index: usize| {
        let same = (0..names.len()).filter(|other| unit(*other) == unit(index)).map(|other| ranges[other]);
        let fraction = ranges[index] / same.fold(0.0, f64::max);
        let is_smooth = von_neumann_ratio(&columns[index]) < LARGEST_RATIO;
        // An output that scatters is fitted all the same: its half-width says how far it follows the inputs.
        let is_clear = !of_inputs || fraction >= CLEAR_FRACTION || is_smooth && fraction >= LEAST_FRACTION;
        ranges[index] > 0.0 && is_clear
    };
    let (kept, others): (Vec<usize>, Vec<usize>) = (0..names.len()).partition(|at| moves(*at));
    for at in others {
        let size = if ranges[at] > 0.0 { format!("range {:.3e}", ranges[at]) } else { "constant".into() };
        remarks.push(format!("{} does not move beyond its noise ({size}): left out", names[at]));
    }
    kept
}

/// Range without outliers.
fn inner_range(values: &[f64]) -> f64 {
    let mut values = values.to_vec();
    values.sort_by(f64::total_cmp);
    let cut = (OUTLIERS * values.len() as f64) as usize;
    match (values.get(cut), values.len().checked_sub(cut + 1).and_then(|last| values.get(last))) {
        (Some(low), Some(high)) => high - low,
        _ => 0.0,
    }
}

fn von_neumann_ratio(runs: &[Vec<f64>]) -> f64 {
    let steps = runs.iter().flat_map(|run| run.windows(2).map(|v| (v[1] - v[0]).powi(2)));
    let centre = mean(runs.iter().flatten().copied());
    0.5 * mean(steps) / mean(runs.iter().flatten().map(|v| (v - centre).powi(2)))
}

/// Fraction of the second differences that are free of motion, and the RMS of a normal distribution cut there.
const CALM: (f64, f64) = (0.9, 0.789);

/// Standard deviation of the noise of one run from second differences: motion that is slow compared with the rate cancels.
pub(super) fn noise_of(values: &[f64]) -> f64 {
    let mut squares: Vec<f64> = values.windows(3).map(|v| (v[0] - 2.0 * v[1] + v[2]).powi(2)).collect();
    squares.sort_by(f64::total_cmp);
    squares.truncate((CALM.0 * squares.len() as f64).ceil() as usize);
    if squares.is_empty() { 0.0 } else { (mean(squares) / 6.0).sqrt() / CALM.1 }
}
