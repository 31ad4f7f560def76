//! Names of regimes that are a model's own, as running twins tell them.

use std::collections::BTreeMap;
use wire::layout::regime;
use wire::{AnySample, Bus, RegimeNames, WireError};

/// Names by model, each looked up once.
#[derive(Debug)]
pub struct Regimes {
    bus: Bus,
    known: BTreeMap<[u8; 16], RegimeNames>,
}

impl Regimes {
    /// Of the twins of a domain.
    pub fn new(bus: &Bus) -> Self {
        Self { bus: bus.clone(), known: BTreeMap::new() }
    }

    /// The name that a model has for a number; none for free and contact, and where no twin of this domain tells it.
    ///
    /// # Errors
    /// When the domain's files cannot be read.
    pub fn name(&mut self, model_hash: &[u8; 16], number: u32) -> Result<Option<&str>, WireError> {
        if number < regime::NAMED1 {
            return Ok(None);
        }
        if !self.known.contains_key(model_hash) {
            self.known.insert(*model_hash, self.bus.regime_names(model_hash)?);
        }
        Ok(self.known.get(model_hash).and_then(|names| names.get(&number)).map(String::as_str))
    }

    /// The name of a sample's regime, as [`Self::name`].
    ///
    /// # Errors
    /// As [`Self::name`].
    pub fn of(&mut self, sample: &AnySample) -> Result<Option<&str>, WireError> {
        match sample {
            AnySample::State(state) => self.name(&state.model_hash, state.regime),
            AnySample::Field(field) => self.name(&field.header().model_hash, field.header().regime),
            _ => Ok(None),
        }
    }
}
