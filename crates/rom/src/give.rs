//! Values of parameters that a model is told once: what a state takes that says nothing about them.

use crate::evaluator::Evaluator;
use crate::inputs::{PARAMETERS, nearest_name};
use crate::model::{ModelError, ModelHeader};

impl ModelHeader {
    /// Gives parameters values by name. All are checked before any is taken; the onset table is that of the new values.
    ///
    /// # Errors
    /// [`ModelError::UnknownInput`] for a name that is no parameter of the model, [`ModelError::NotFinite`].
    pub fn give<'a>(&mut self, given: impl IntoIterator<Item = (&'a str, f64)>) -> Result<(), ModelError> {
        let mut inputs = self.inputs.clone();
        let mut changed = false;
        for (name, value) in given {
            inputs[self.parameter(name)?].value = Some(value);
            changed = true;
            if !value.is_finite() {
                return Err(ModelError::NotFinite { name: name.into(), value });
            }
        }
        if changed {
            self.inputs = inputs;
            self.onset = Evaluator::new(self)?.onset().cloned();
        }
        Ok(())
    }

    /// Whether any answer depends on an input: a regime was trained over it, or the onset is found with it. A state may say
    /// anything about the others, such as 0 for a pressure that there is none of.
    pub fn needs(&self, input: usize) -> bool {
        let is_sampled = self.inputs.get(input).is_some_and(|input| input.range[0].is_finite());
        is_sampled || (input < PARAMETERS && self.onset.is_some())
    }

    /// Position of a parameter by its name.
    ///
    /// # Errors
    /// [`ModelError::UnknownInput`].
    pub fn parameter(&self, name: &str) -> Result<usize, ModelError> {
        let found = self.inputs.iter().skip(PARAMETERS).position(|input| input.name == name);
        found.map(|at| PARAMETERS + at).ok_or_else(|| {
            let known: Vec<String> = self.inputs.iter().skip(PARAMETERS).map(|i| i.name.clone()).collect();
            let nearest = nearest_name(name, &known).cloned();
            ModelError::UnknownInput { found: name.into(), nearest, known }
        })
    }
}
