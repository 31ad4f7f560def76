//! One input of a model with everything that a payload says about it.

use super::{INPUTS_MAX, slot};

/// One input of a model, as a payload carries it.
#[derive(Debug, Clone, PartialEq)]
pub struct InputValue {
    /// Its name; of a name of more than 31 bytes the end.
    pub name: String,
    /// The value, in the unit at the end of the name.
    pub value: f64,
    /// Gradient of the force by it, N per unit; NaN when not known.
    pub force_by: f64,
    /// Where the value comes from: a number of [`super::input_source`].
    pub source: u8,
}

/// The inputs of a payload, `count` of them.
pub(super) fn inputs_of<'a>(
    count: u32,
    names: &'a [u8; 32 * INPUTS_MAX],
    values: &'a [f64; INPUTS_MAX],
    force_by: &'a [f64; INPUTS_MAX],
    sources: &'a [u8; INPUTS_MAX],
) -> impl Iterator<Item = InputValue> + 'a {
    let all = values.iter().zip(force_by).zip(sources).take(count as usize);
    all.enumerate().map(|(at, ((value, force_by), source))| InputValue {
        name: slot(names, at),
        value: *value,
        force_by: *force_by,
        source: *source,
    })
}
