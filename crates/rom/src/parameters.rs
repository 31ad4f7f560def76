//! Default parameter values of a model.

use crate::evaluation::{Number, NumberNeeds};
use crate::evaluator::Evaluator;
use crate::halfwidths::HalfWidths;
use crate::inputs::{GAP, InputSpec, Needs, PARAMETERS, PRESSURE, nearest_name};
use crate::model::{ModelError, ModelHeader};
use crate::snapshots::FieldKind;

impl ModelHeader {
    /// Position of the field that is the coordinate along an axis (0 = x, 1 = y, 2 = z).
    pub fn coordinate_field(&self, axis: u8) -> Option<usize> {
        self.fields.iter().position(|field| field.spec.kind == FieldKind::Coordinate(axis))
    }

    /// Sets default values of parameters by name. All are checked before any is changed; the onset table is that of the new values.
    ///
    /// # Errors
    /// [`ModelError::UnknownInput`] for a name that is no parameter of the model, [`ModelError::NotFinite`].
    pub fn set_parameters<'a>(
        &mut self,
        given: impl IntoIterator<Item = (&'a str, f64)>,
    ) -> Result<(), ModelError> {
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

    /// Inputs that the model was trained over or its onset depends on, with their position.
    pub fn taken_inputs(&self) -> impl Iterator<Item = (usize, &InputSpec)> {
        let needs = self.needs();
        let inputs = self.inputs.iter().enumerate();
        inputs
            .filter(move |(index, _)| (*index != PRESSURE || needs.pressure) && (*index != GAP || needs.gap))
    }

    /// True if the model was trained on contact forces; an onset remains where a scene loads the free regime alone.
    pub fn has_forces(&self) -> bool {
        self.onset.is_some() || self.regimes.iter().any(|regime| regime.force.is_some())
    }

    /// True if the model has a von Mises stress.
    pub fn has_stress(&self) -> bool {
        self.fields.iter().any(|field| field.spec.kind == FieldKind::Stress)
    }

    /// True if the evaluations of the model have a number.
    pub fn has_number(&self, number: &Number) -> bool {
        match number.needs {
            NumberNeeds::Nothing => true,
            NumberNeeds::Forces => self.has_forces(),
            NumberNeeds::Stress => self.has_stress(),
            NumberNeeds::Onset => self.onset.is_some(),
        }
    }

    /// Half-widths of the quantities that the model has; NaN for the others.
    pub fn known_halfwidths(&self, widths: HalfWidths) -> HalfWidths {
        let known = |is_known: bool, value: f64| if is_known { value } else { f64::NAN };
        let (stress_mpa, force_n) =
            (known(self.has_stress(), widths.stress_mpa), known(self.has_forces(), widths.force_n));
        HalfWidths { stress_mpa, force_n, ..widths }
    }

    /// Needs of pressure and gap: an input is needed if a regime was trained over it or the onset depends on it. Any value is valid for
    /// an input that is not needed.
    pub fn needs(&self) -> Needs {
        let needs = |input: usize| {
            let is_sampled = self.inputs.get(input).is_some_and(|input| input.range[0].is_finite());
            is_sampled || self.onset.is_some()
        };
        Needs { pressure: needs(PRESSURE), gap: needs(GAP) }
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
