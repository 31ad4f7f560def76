//! Table of a model's errors on held-out states: `evaluate --errors` writes it, `train --errors` reads it.

use crate::failure::configuration;
use crate::files;
use anyhow::Context;
use formats::FormatError;
use formats::table::{Table, to_text};
use rom::halfwidths::Errors;
use rom::hull::DomainStatus;
use rom::inputs::Inputs;
use rom::model::Model;
use std::path::Path;
use train::calibration::UnseenState;
use train::datasheet::DataSheet;
use train::evaluate::CaseReport;

/// Columns behind the inputs: worst node's displacement and stress, force, and whose errors these are.
const ERRORS: [&str; 4] = ["displacement_error_mm", "stress_error_mpa", "force_error_n", "predictions"];

/// Writes the errors of all states inside the training range.
///
/// # Errors
/// The operating system's; a model that cannot be written.
pub fn write(path: &Path, model: &Model, cases: &[CaseReport]) -> anyhow::Result<()> {
    let (header, hash) = (&model.header, wire::layout::hex(&model.prediction_hash()?[..8]));
    let (places, keys): (Vec<usize>, Vec<String>) =
        header.taken_inputs().map(|(at, input)| (at, input.key())).unzip();
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
    files::save(path, to_text(&columns.collect::<Vec<_>>(), inside.map(row)).as_bytes())
}

/// Whether there is such a table; whose errors they are is seen when the model is there.
///
/// # Errors
/// A table that cannot be read or has other columns.
pub fn check(path: &Path) -> anyhow::Result<()> {
    let table = Table::read(path, true).map_err(files::refusal)?;
    let missing = |diagnostic| files::refusal(FormatError::one(path, diagnostic));
    ERRORS.iter().try_for_each(|name| table.column(name).map(drop).map_err(missing))
}

/// Sets a model's half-widths by a table of its errors.
///
/// # Errors
/// A table that cannot be read, that is of another model, or that has too few states.
pub fn calibrate(path: &Path, model: &mut Model, sheet: &mut DataSheet) -> anyhow::Result<()> {
    let states = read(path, model)?;
    train::calibration::calibrate(model, sheet, &states)
        .with_context(|| path.display().to_string())
        .map_err(configuration)
}

/// The states of such a table and a model's errors there.
///
/// # Errors
/// A table that cannot be read or that is of another model.
pub fn read(path: &Path, model: &Model) -> anyhow::Result<Vec<UnseenState>> {
    let (header, hash) = (&model.header, wire::layout::hex(&model.prediction_hash()?[..8]));
    let table = Table::read(path, true).map_err(files::refusal)?;
    let refused = |diagnostic| files::refusal(FormatError::one(path, diagnostic));
    let column = |name: &str| table.column(name).map_err(refused);
    let inputs = header.taken_inputs().map(|(at, input)| Ok((at, column(&input.key())?)));
    let inputs = inputs.collect::<anyhow::Result<Vec<_>>>()?;
    let (regime, [displacement, stress, force, predictions]) = (column("regime")?, ERRORS.map(column));
    let (errors, predictions) = ([displacement?, stress?, force?], predictions?);
    let names: Vec<_> = header.regimes.iter().map(|r| (r.kind.name(), r.kind)).collect();
    let state = |row: formats::table::Row<'_>| {
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
        for (at, column) in &inputs {
            if let Some(value) = row.optional_number(*column)? {
                values = values.with(*at, value);
            }
        }
        let [displacement, stress, force] = errors;
        let of = |is_known: bool, column| if is_known { row.number(column) } else { Ok(0.0) };
        Ok(UnseenState {
            regime: row.choice(regime, &names)?,
            inputs: values,
            domain: DomainStatus::Inside,
            errors: Errors {
                displacement_mm: row.number(displacement)?,
                stress_mpa: of(header.has_stress(), stress)?,
                force_n: of(header.has_forces(), force)?,
            },
        })
    };
    table.rows().map(|row| state(row).map_err(refused)).collect()
}
