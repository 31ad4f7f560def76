//! What readers know of the names that twins tell for regimes of a model's own: each model looked up once.

use super::any::AnySample;
use super::regime_names::RegimeNames;
use crate::bus::Bus;
use crate::layout::regime;
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// How long a model without names is not looked up again: its twin may come, or tell them a moment after its first state.
const RETRY: Duration = Duration::from_secs(1);
/// Models that are kept; with one more, all are looked up anew.
const MODELS_MAX: usize = 64;

/// Names of regimes by model. They belong to the model's hash: once found they do not change, and stay when the twin ends.
#[derive(Debug)]
pub struct KnownRegimes {
    bus: Bus,
    models: BTreeMap<[u8; 16], Known>,
}

#[derive(Debug)]
struct Known {
    names: RegimeNames,
    /// When to look again, as long as there are none.
    again_at: Instant,
}

impl KnownRegimes {
    /// Of the twins of a domain.
    pub fn new(bus: &Bus) -> Self {
        Self { bus: bus.clone(), models: BTreeMap::new() }
    }

    /// The name that a model has for a number; none for free and contact, and where no twin of this domain has told it. Found names
    /// cost a search in memory; one that is not found is looked up again at most once a second ([`Bus::regime_names`]).
    pub fn name(&mut self, model_hash: &[u8; 16], number: u32) -> Option<&str> {
        if number < regime::NAMED1 {
            return None;
        }
        let is_due = |known: &Known| known.names.is_empty() && Instant::now() >= known.again_at;
        if self.models.get(model_hash).is_none_or(is_due) {
            self.look_up(model_hash);
        }
        self.models.get(model_hash)?.names.get(&number).map(String::as_str)
    }

    /// The name of a sample's regime, as [`Self::name`].
    pub fn of(&mut self, sample: &AnySample) -> Option<&str> {
        match sample {
            AnySample::State(state) => self.name(&state.model_hash, state.regime),
            AnySample::Field(field) => self.name(&field.header().model_hash, field.header().regime),
            _ => None,
        }
    }

    fn look_up(&mut self, model_hash: &[u8; 16]) {
        if self.models.len() >= MODELS_MAX {
            self.models.clear();
        }
        // What cannot be read is not known: samples have all they need but a text.
        let names = self.bus.regime_names(model_hash).unwrap_or_default();
        self.models.insert(*model_hash, Known { names, again_at: Instant::now() + RETRY });
    }
}
