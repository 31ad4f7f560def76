//! The model inputs beside pressure and gap that the readings of an actuator carry, by name.

use super::reading::Reading;
use super::value::{NAMED, slot};
use wire::layout::{PARAMETERS_MAX, set_slot};

/// Names of inputs in the order in which readings carry them; at most [`PARAMETERS_MAX`].
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct InputNames(Vec<String>);

impl InputNames {
    /// Of these inputs; those beyond the first [`PARAMETERS_MAX`] are left out (scenes with more are refused).
    pub fn new<'a>(names: impl IntoIterator<Item = &'a str>) -> Self {
        Self(names.into_iter().take(PARAMETERS_MAX).map(str::to_owned).collect())
    }

    /// The names in their order.
    pub fn iter(&self) -> impl Iterator<Item = &str> {
        self.0.iter().map(String::as_str)
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The place of a value of a reading by its name. An input goes before a value that every reading has: a model's `force_n` is
    /// a load, not the force of contact.
    pub(crate) fn slot(&self, name: &str) -> Option<usize> {
        self.iter().position(|known| known == name).map(|at| NAMED + at).or_else(|| slot(name))
    }

    /// A reading with these names; the values are its own.
    pub(super) fn name(&self, reading: Reading) -> Reading {
        let mut named = Reading { input_count: self.0.len() as u32, ..reading };
        self.iter().enumerate().for_each(|(at, name)| set_slot(&mut named.input_names, at, name));
        named
    }
}
