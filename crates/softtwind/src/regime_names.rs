//! Tells the names of models' own regimes to the domain, beside the states that carry their numbers.

use runtime::load::Loaded;
use runtime::wire::{Bus, Domain, RegimeNames, ToldRegimes, WireError};

/// Tells the names of the models that a twin has now. Stays in the thread that made it.
pub struct RegimeTeller {
    domain: Domain,
    /// Joined when there is something to tell: most models have no names of their own.
    bus: Option<Bus>,
    told: Vec<ToldRegimes>,
}

impl RegimeTeller {
    /// One that has told nothing yet; `bus` is the thread's membership in the domain, if it has any.
    pub fn new(domain: Domain, bus: Option<Bus>) -> Self {
        Self { domain, bus, told: Vec::new() }
    }

    /// Tells the names of these models instead of those before. Without them states have all they need but a text, so that a
    /// failure is logged and the twin goes on.
    pub fn tell(&mut self, loaded: &[Loaded]) {
        match self.try_tell(loaded) {
            Ok(told) => self.told = told,
            Err(error) => {
                tracing::warn!("names of regimes are not told, their numbers stand for them: {error}")
            }
        }
    }

    fn try_tell(&mut self, loaded: &[Loaded]) -> Result<Vec<ToldRegimes>, WireError> {
        let mut told = Vec::new();
        for model in loaded {
            let names = model.evaluator.named_regimes().map(|(number, name)| (number, name.to_owned()));
            let names: RegimeNames = names.collect();
            if !names.is_empty() {
                let bus = match &mut self.bus {
                    Some(bus) => bus,
                    none => none.insert(Bus::open(&self.domain)?),
                };
                told.push(ToldRegimes::tell(bus, &model.model_hash, &names)?);
            }
        }
        Ok(told)
    }
}
