//! A model from measured inputs and outputs alone: a smoothed map without memory.
//!
//! `y(x) = sum_k w_k g(|x - c_k|) + tail(x)` with centres `c_k` at the means of cells of the measured inputs, by least squares over all rows
//! with `lambda |w|^2`: repeats are averaged. Segments of the runs that are left out choose tail and `lambda`; a run has as many as changes
//! of direction, 5 to 20.
//!
//! The model keeps the modes of the fitted values, each output over its error on left-out segments, with singular values beyond those of noise:
//! outputs that move together share them.
//!
//! Half-width of an output: `q + 1.28 s sqrt(1 + 1/n)`. `q` is the 90 % quantile of the errors on left-out segments; it contains noise,
//! repeats, and the difference of loading and unloading. `s` is the standard deviation of the mean errors of the `n` runs, or of the two
//! halves of a single run: the second term is the 90 % bound of a further run's mean error, if these means are normally distributed.
//!
//! With memory ([`learn_with_memory`]) blocks that transform inputs over time (lag, play, creep) act between [`select`] and [`fit`]: they change
//! [`Run::inputs`].

mod assemble;
mod curve;
mod data;
mod difference;
mod layout;
mod modes;
mod motion;
mod past;

pub use data::{Learned, Measured, MeasuredError, MeasuredStates, OutputReport, Run};
pub use difference::{Corrected, Difference, correct};
pub use layout::{MeasuredOutput, outputs, place};
pub use modes::ModesDifference;
pub use motion::select;
pub use past::learn_with_memory;

use curve::Curve;
pub(crate) use curve::{directions, turns};
use data::MIN_EXPLAINED;

/// Selects the columns that move, then fits. Cost: `O(rows centres^2)`.
///
/// # Errors
/// [`MeasuredError`].
pub fn learn(actuator: &str, data: &Measured) -> Result<Learned, MeasuredError> {
    let mut remarks = Vec::new();
    let moving = select(data, &mut remarks)?;
    let mut learned = fit(actuator, &moving)?;
    remarks.append(&mut learned.remarks);
    Ok(Learned { remarks, ..learned })
}

/// Fits the static map over all inputs of `data`; rows with missing values are left out. Cost: `O(rows centres^2)`.
///
/// # Errors
/// [`MeasuredError`].
pub fn fit(actuator: &str, data: &Measured) -> Result<Learned, MeasuredError> {
    let mut remarks = Vec::new();
    let curve = Curve::new(data, &mut remarks)?;
    let (choice, errors) = curve.choose().ok_or(MeasuredError::Singular)?;
    let fitted = curve.interpolant(&choice).ok_or(MeasuredError::Singular)?;
    let (modes, errors) = curve.modes(&fitted, &errors).ok_or(MeasuredError::Singular)?;
    let turns = curve.turns;
    if turns < 4 {
        remarks.push(format!(
            "{turns} changes between rising and falling inputs, less than two periods: the half-widths rest on few repeats"
        ));
    }
    let predicted: Vec<Vec<f64>> = curve.x.iter().map(|x| modes.values(x)).collect();
    let reports: Vec<OutputReport> =
        (0..data.outputs.len()).map(|k| curve.report(&data.outputs[k], k, &predicted, &errors)).collect();
    let explained = reports.iter().map(|report| report.explained).fold(f64::NEG_INFINITY, f64::max);
    if explained < MIN_EXPLAINED {
        return Err(MeasuredError::Unrelated { explained: 100.0 * explained, least: 100.0 * MIN_EXPLAINED });
    }
    for report in reports.iter().filter(|report| report.explained < MIN_EXPLAINED) {
        remarks.push(format!("{} does not follow the inputs; its half-width says so", report.name));
    }
    let length =
        |of: &dyn Fn(&OutputReport) -> f64| reports.iter().map(|r| of(r).powi(2)).sum::<f64>().sqrt();
    Ok(Learned {
        error_share: length(&|r| r.rms) / length(&|r| r.range),
        modes: modes.shapes.len(),
        model: curve.model(actuator, data, modes, &errors, &reports)?,
        inputs: data.inputs.clone(),
        outputs: reports,
        remarks,
        kernel: choice.to_string(),
        turns,
        rows: curve.x.len(),
    })
}
