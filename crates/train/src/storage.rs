//! What storing the basis as 16-bit integers costs in accuracy.

use rom::evaluator::Evaluator;
use rom::kernel::Precision;
use rom::model::{Model, ModelError, Selection};
use rom::reconstructor::Reconstructor;
use rom::snapshots::{Database, Split};

/// For every field the largest bound over the training states of what [`Precision::I16`] adds to the error of a value,
/// in the field's unit. Cost: laying the basis out once, then `O(cases x modes)`.
pub(crate) fn i16_bounds(model: &Model, database: &Database) -> Result<Vec<f64>, ModelError> {
    let evaluator = Evaluator::new(&model.header)?;
    let fields = Reconstructor::with_precision(model, &Selection::default(), Precision::I16)?;
    let mut evaluation = evaluator.evaluation();
    let mut bounds = vec![0.0_f64; database.fields.len()];
    for case in database.cases.iter().filter(|case| case.split == Split::Train) {
        evaluator.evaluate(case.inputs(), &mut evaluation);
        if let (Some(basis), Ok(coefficients)) =
            (fields.basis_of(&evaluation), fields.coefficients(&evaluation))
        {
            for (field, bound) in bounds.iter_mut().enumerate() {
                *bound = bound.max(basis.error_bound(field, &coefficients));
            }
        }
    }
    Ok(bounds)
}
