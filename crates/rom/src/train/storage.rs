//! What storing the basis as 16-bit integers costs in accuracy.

use crate::evaluation::Input;
use crate::kernel::Precision;
use crate::model::Model;
use crate::predict::{PredictError, Predictor, Selection};
use crate::regime::RegimeSwitch;
use crate::snapshots::{Database, Split};

/// For every field the largest bound over the training states of what [`Precision::I16`] adds to the error of a value,
/// in the field's unit. Cost: laying the basis out once, then `O(cases x modes)`.
pub(super) fn i16_bounds(model: &Model, database: &Database) -> Result<Vec<f64>, PredictError> {
    let mut predictor = Predictor::with_precision(model, &Selection::default(), Precision::I16)?;
    let mut evaluation = predictor.evaluation();
    let mut bounds = vec![0.0_f64; database.fields.len()];
    for case in database.cases.iter().filter(|case| case.split == Split::Train) {
        let input = Input { pressure_mpa: case.pressure_mpa, gap_mm: case.gap_mm.unwrap_or(f64::INFINITY) };
        predictor.evaluate(input, &mut RegimeSwitch::default(), &mut evaluation);
        if let Some(basis) = predictor.basis(evaluation.basis) {
            for (field, bound) in bounds.iter_mut().enumerate() {
                *bound = bound.max(basis.error_bound(field, &evaluation.coefficients));
            }
        }
    }
    Ok(bounds)
}
