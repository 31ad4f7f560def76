//! A model from measured inputs and outputs alone: ridge maps of filtered inputs ([`rom::learned`]), and what a finite-element model lacks.
//!
//! [`select`] leaves out columns that do not move, `maps.rs` chooses lags and maps on left-out parts, `widths.rs` makes the half-widths, and
//! `assemble.rs` the model.

mod assemble;
mod data;
mod difference;
mod layout;
mod maps;
mod modes;
mod motion;
mod segments;
mod widths;

pub use data::{Learned, LearningReport, Measured, MeasuredError, MeasuredStates, OutputReport, Run};
pub use difference::{Corrected, Difference, correct};
pub use layout::{MeasuredOutput, outputs, place};
pub use modes::ModesDifference;
pub use motion::select;

use data::MIN_EXPLAINED;
pub(crate) use data::max_gap_s;
use maps::{FittedRows, LagColumns, search};
pub(crate) use segments::{directions, turns};

/// Selects the columns that move, then fits. Cost: some seconds for 1,500 rows.
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

/// Fits over all inputs of `data`; rows with missing values are left out.
///
/// # Errors
/// [`MeasuredError`].
pub fn fit(actuator: &str, data: &Measured) -> Result<Learned, MeasuredError> {
    let mut remarks = Vec::new();
    let rows = FittedRows::new(data, &mut remarks)?;
    let mut filtered = LagColumns::new(&rows);
    let found = search(&rows, &mut filtered).ok_or(MeasuredError::Singular)?;
    let reports = assemble::reports(data, &rows, &found);
    let explained = reports.iter().map(|report| report.explained).fold(f64::NEG_INFINITY, f64::max);
    // NaN, of an error that is no number, is refused too.
    if explained.is_nan() || explained < MIN_EXPLAINED {
        return Err(MeasuredError::Unrelated { explained: 100.0 * explained, least: 100.0 * MIN_EXPLAINED });
    }
    let places = widths::places(&rows, &found, &mut filtered);
    let (widths, drifts) = widths::widths(&rows, &found, &places, &mut filtered);
    assemble::model(actuator, data, &rows, found, places, (widths, drifts), reports, remarks)
}
