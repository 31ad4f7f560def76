//! Table of a model's errors on held-out states: `evaluate --errors` writes it, `train --errors` reads it.

use crate::calibration::{self, UnseenState};
use crate::datasheet::DataSheet;
use crate::evaluate::CaseReport;
use formats::table::{Table, TableRow, to_text};
use formats::{FormatError, file};
use rom::halfwidths::Errors;
use rom::hull::DomainStatus;
use rom::inputs::Inputs;
use rom::model::{Model, hex};
use std::path::Path;

/// Columns behind the inputs: worst node's displacement and stress, force, and whose errors these are.
const ERRORS: [&str; 4] = ["displacement_error_mm", "stress_error_mpa", "force_error_n", "predictions"];

/// Writes the errors of all states inside the training range.
///
/// # Errors
/// The operating system's; a model that cannot be written.
pub fn write(path: &Path, model: &Model, cases: &[CaseReport]) -> Result<(), FormatError> {
    let (header, hash) = (&model.header, prediction_mark(path, model)?);
    let (places, keys): (Vec<usize>, Vec<String>) =
        header.taken_inputs().map(|(index, input)| (index, input.key())).unzip();
    let columns = ["case", "regime"].into_iter().chain(keys.iter().map(String::as_str)).chain(ERRORS);
    let row = |case: &CaseReport| {
        let inputs = places.iter().map(|at| case.inputs.values()[*at]);
        // No obstacle: an empty cell.
        let inputs = inputs.map(|value| if value.is_finite() { value.to_string() } else { String::new() });
        // Nor is there an error of a quantity that the model does not have.
        let errors = case.errors.values();
        let errors = errors.map(|error| if error.is_nan() { String::new() } else { format!("{error:.4e}") });
        let names = [case.case.clone(), case.regime.name().to_owned()];
        names.into_iter().chain(inputs).chain(errors).chain([hash.clone()]).collect::<Vec<_>>()
    };
    let inside = cases.iter().filter(|case| case.domain == DomainStatus::Inside);
    file::replace(path, to_text(&columns.collect::<Vec<_>>(), inside.map(row)).as_bytes())
}

/// Whether there is such a table; whose errors they are is seen when the model is there.
///
/// # Errors
/// A table that cannot be read or has other columns.
pub fn check(path: &Path) -> Result<(), FormatError> {
    let table = Table::read(path, true)?;
    let missing = |diagnostic| FormatError::one(path, diagnostic);
    ERRORS.iter().try_for_each(|name| table.column(name).map(drop).map_err(missing))
}

/// Sets a model's half-widths by a table of its errors.
///
/// # Errors
/// A table that cannot be read, that is of another model, or that has too few states.
pub fn calibrate(path: &Path, model: &mut Model, sheet: &mut DataSheet) -> Result<(), FormatError> {
    let states = read(path, model)?;
    calibration::calibrate(model, sheet, &states).map_err(|error| FormatError::refused(path, error))
}

/// The states of such a table and a model's errors there.
///
/// # Errors
/// A table that cannot be read or that is of another model.
pub fn read(path: &Path, model: &Model) -> Result<Vec<UnseenState>, FormatError> {
    let (header, hash) = (&model.header, prediction_mark(path, model)?);
    let table = Table::read(path, true)?;
    let refused = |diagnostic| FormatError::one(path, diagnostic);
    let column = |name: &str| table.column(name).map_err(refused);
    let inputs = header.taken_inputs().map(|(index, input)| Ok((index, column(&input.key())?)));
    let inputs = inputs.collect::<Result<Vec<_>, FormatError>>()?;
    let (regime, [displacement, stress, force, predictions]) = (column("regime")?, ERRORS.map(column));
    let (errors, predictions) = ([displacement?, stress?, force?], predictions?);
    let names: Vec<_> = header.regimes.iter().map(|r| (r.kind.name(), r.kind)).collect();
    let state = |row: TableRow<'_>| {
        if row.text(predictions) != hash {
            return Err(row.diagnostic(
                predictions,
                &format!(
                    "{hash}, the predictions of this model; these errors are of another one: measure them again with \
                     `softtwin evaluate --errors`"
                ),
            ));
        }
        let mut values = Inputs::new(f64::NAN, f64::INFINITY);
        for (index, column) in &inputs {
            if let Some(value) = row.optional_number(*column)? {
                values = values.with(*index, value);
            }
        }
        let [displacement, stress, force] = errors;
        let error = |is_known: bool, column| if is_known { row.number(column) } else { Ok(0.0) };
        Ok(UnseenState {
            regime: row.choice(regime, &names)?,
            inputs: values,
            domain: DomainStatus::Inside,
            errors: Errors {
                displacement_mm: row.number(displacement)?,
                stress_mpa: error(header.has_stress(), stress)?,
                force_n: error(header.has_forces(), force)?,
            },
        })
    };
    table.rows().map(|row| state(row).map_err(refused)).collect()
}

/// Eight bytes that tell the predictions of one model from those of another, hexadecimal.
fn prediction_mark(path: &Path, model: &Model) -> Result<String, FormatError> {
    let hash = model.prediction_hash().map_err(|error| FormatError::refused(path, error))?;
    Ok(hex(&hash[..8]))
}
