//! Names of regimes that are a model's own. A recording has them beside its messages, in the metadata about each model.

use std::collections::BTreeMap;

use wire::layout::regime;
use wire::{RegimeNames, State};

use crate::Item;

/// Metadata about the model of an actuator; the actuator's name follows.
pub const MODEL: &str = "softtwin.model.";
/// Key of the model's hash in it.
pub const HASH: &str = "model_hash";

/// The entries that tell the names: `regime 3 = straight`.
pub fn entries(names: &RegimeNames) -> impl Iterator<Item = (String, String)> {
    names.iter().map(|(number, name)| (regime::as_str(*number).to_owned(), name.clone()))
}

/// The names that a recording has told so far.
#[derive(Debug, Clone, Default)]
pub struct RecordedRegimes {
    /// By the model's hash and the text that stands in messages, such as `regime 3`.
    names: BTreeMap<String, BTreeMap<String, String>>,
}

impl RecordedRegimes {
    /// Takes note of what an item says of a model.
    pub fn observe(&mut self, item: &Item) {
        let Item::Metadata { name, entries } = item else { return };
        if let (true, Some(hash)) = (name.starts_with(MODEL), entries.get(HASH)) {
            self.names.insert(hash.clone(), entries.clone());
        }
    }

    /// The name of a regime, by the model's hash in hexadecimal digits and the text of the message.
    pub fn name(&self, model_hash: &str, regime: &str) -> Option<&str> {
        let number = regime::ALL.iter().find(|code| code.name == regime)?.number;
        let is_own = number >= regime::NAMED1;
        self.names.get(model_hash).filter(|_| is_own)?.get(regime).map(String::as_str)
    }

    /// The name of a state's regime.
    pub fn of(&self, state: &State) -> Option<&str> {
        self.name(&wire::layout::hex(&state.model_hash), regime::as_str(state.regime))
    }
}
