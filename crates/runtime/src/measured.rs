//! Measured inputs of a model other than pressure and gap, which readings carry by name.

use crate::config::ActuatorSpec;
use rom::inputs::InputSpec;
use wire::layout::{PARAMETERS_MAX, pack_slot};

/// Measured inputs with the ranges in the scene.
#[derive(Debug, Clone, Default)]
pub struct MeasuredInputs(Vec<MeasuredInput>);

#[derive(Debug, Clone)]
struct MeasuredInput {
    /// Position in the model's inputs.
    input: usize,
    /// The name as readings carry it.
    name: [u8; 32],
    min: f64,
    max: f64,
}

/// The value of such an input in one reading.
#[derive(Debug, Clone, Copy)]
pub(crate) struct MeasuredValue {
    /// Position in the model's inputs.
    pub(crate) input: usize,
    /// NaN where the reading has none.
    pub(crate) value: f64,
    /// True if the range in the scene contains it.
    pub(crate) can_occur: bool,
}

impl MeasuredInputs {
    /// Those of a scene's actuator among the inputs of its model.
    pub fn new(spec: &ActuatorSpec, inputs: &[InputSpec]) -> Self {
        let position = |name: &str| inputs.iter().position(|input| input.key() == name);
        let measured = |(name, within): (&str, crate::config::WithinSpec)| {
            Some(MeasuredInput {
                input: position(name)?,
                name: pack_slot(name),
                min: within.min,
                max: within.max,
            })
        };
        Self(spec.measured_inputs().filter_map(measured).collect())
    }

    /// Their positions in the model's inputs.
    pub(crate) fn positions(&self) -> impl Iterator<Item = usize> {
        self.0.iter().map(|measured| measured.input)
    }

    /// Their values in a reading that carries `values` by `names`, of each the first `count`. `O(inputs x names)`, at most 36
    /// comparisons; allocates nothing.
    pub(crate) fn of<'a>(
        &'a self,
        count: u32,
        names: &'a [u8; 32 * PARAMETERS_MAX],
        values: &'a [f64; PARAMETERS_MAX],
    ) -> impl Iterator<Item = MeasuredValue> {
        let named = move || names.as_chunks::<32>().0.iter().zip(values).take(count as usize);
        self.0.iter().map(move |measured| {
            let found = named().find(|(name, _)| **name == measured.name);
            let value = found.map_or(f64::NAN, |(_, value)| *value);
            let can_occur = (measured.min..=measured.max).contains(&value);
            MeasuredValue { input: measured.input, value, can_occur }
        })
    }
}
