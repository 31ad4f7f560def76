//! A model at one state, with all of its numbers: evaluator, reconstructor and the memory they write to.

use crate::evaluation::Evaluation;
use crate::evaluator::Evaluator;
use crate::inputs::Inputs;
use crate::kernel::Precision;
use crate::model::{Model, ModelError, Selection};
use crate::reconstructor::{Peaks, ReconstructError, Reconstructor};

/// Evaluates and reconstructs in one call, for programs that want whole states one after the other.
#[derive(Clone, Debug)]
pub struct ModelState {
    evaluator: Evaluator,
    reconstructor: Reconstructor,
    evaluation: Evaluation,
    fields: Vec<f32>,
}

impl ModelState {
    /// Prepares a model for a selection of fields and nodes in the number format of the model.
    ///
    /// # Errors
    /// As [`Reconstructor::new`].
    pub fn new(model: &Model, selection: &Selection) -> Result<Self, ModelError> {
        Self::with_precision(model, selection, None)
    }

    /// As [`Self::new`], with the modes in this number format.
    ///
    /// # Errors
    /// As [`Reconstructor::with_precision`].
    pub fn with_precision(
        model: &Model,
        selection: &Selection,
        precision: Option<Precision>,
    ) -> Result<Self, ModelError> {
        let reconstructor = Reconstructor::with_precision(model, selection, precision)?;
        let evaluator = Evaluator::new(&model.header)?;
        let (evaluation, fields) = (evaluator.evaluation(), vec![0.0; reconstructor.entries()]);
        Ok(Self { evaluator, reconstructor, evaluation, fields })
    }

    /// Moves to a state; returns its largest displacement and stress. No allocation.
    ///
    /// # Errors
    /// [`ReconstructError`] when the model was not trained in the state's regime; the fields are those of the state before.
    pub fn update(&mut self, inputs: Inputs) -> Result<Peaks, ReconstructError> {
        self.evaluator.evaluate(inputs, &mut self.evaluation);
        self.reconstructor.reconstruct_into(&self.evaluation, &mut self.fields)
    }

    /// The state's evaluation.
    pub fn evaluation(&self) -> &Evaluation {
        &self.evaluation
    }

    /// The evaluator: inputs, onset.
    pub fn evaluator(&self) -> &Evaluator {
        &self.evaluator
    }

    /// The state's fields, field-major (all of the first field, then the next).
    pub fn fields(&self) -> &[f32] {
        &self.fields
    }

    /// The reconstructor: rows, fields, bases.
    pub fn reconstructor(&self) -> &Reconstructor {
        &self.reconstructor
    }
}
