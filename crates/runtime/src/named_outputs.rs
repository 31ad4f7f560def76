//! What a model answers by name beside force and positions: observables of a mesh's shape, or the scalar outputs of a model learned from
//! measurements, such as an angle or a force.

use rom::evaluation::Evaluation;
use rom::model::{Model, ModelFileError};
use rom::observable::{Observables, Observed};

/// The named outputs of a model.
#[derive(Debug, Clone)]
pub(crate) struct NamedOutputs {
    observables: Observables,
    /// Names and numbers of a learned model's outputs.
    learned: Vec<(String, usize)>,
}

impl NamedOutputs {
    /// Takes a model with its record of observables, or a learned model with its modes, loaded.
    ///
    /// # Errors
    /// Observables that do not fit the model.
    pub(crate) fn new(model: &Model) -> Result<Self, ModelFileError> {
        Ok(Self { observables: Observables::of(model)?, learned: model.learned_scalars() })
    }

    pub(crate) fn names(&self) -> impl Iterator<Item = &str> {
        self.observables.names().chain(self.learned.iter().map(|(name, _)| name.as_str()))
    }

    /// How many, of which payloads carry the first `OBSERVABLES_MAX`.
    pub(crate) fn count(&self) -> usize {
        self.observables.count() + self.learned.len()
    }

    /// Which output of a learned model one of them is.
    pub(crate) fn learned_output(&self, at: usize) -> Option<usize> {
        self.learned.get(at.checked_sub(self.observables.count())?).map(|(_, output)| *output)
    }

    /// Value of one of a complete evaluation; NaN without an answer.
    pub(crate) fn value(&self, at: usize, evaluation: &Evaluation) -> Observed {
        let Some(output) = self.learned_output(at) else { return self.observables.value(at, evaluation) };
        let entry = |values: &[f64]| values.get(output).copied().unwrap_or(f64::NAN);
        let (value, halfwidth) = (entry(&evaluation.coefficients), entry(&evaluation.output_half_widths));
        Observed { value, halfwidth, offset: 0.0 }
    }
}
