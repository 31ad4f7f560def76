//! Names of models' own regimes: told to the domain, beside the states that carry their numbers, and to this program's log.

use runtime::load::Loaded;
use runtime::twin::regime_value;
use runtime::wire::layout::regime;
use runtime::wire::{Bus, Domain, RegimeNames, ToldRegimes, WireError};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

/// Tells the names of the models that a twin has now. Stays in the thread that made it.
pub struct RegimeTeller {
    domain: Domain,
    /// Joined when there is something to tell: most models have no names of their own.
    bus: Option<Bus>,
    told: Vec<ToldRegimes>,
    log: LogRegimes,
}

/// The names for the log, by [`regime_value`]: of every model that this twin has had. The loop does not touch them.
#[derive(Clone, Default)]
pub struct LogRegimes(Arc<Mutex<BTreeMap<u64, String>>>);

impl LogRegimes {
    fn add(&self, model_hash: &[u8; 16], names: &RegimeNames) {
        let named = names.iter().map(|(number, name)| (regime_value(model_hash, *number), name.clone()));
        self.0.lock().unwrap_or_else(PoisonError::into_inner).extend(named);
    }

    /// What a change of regime changed to.
    pub fn name(&self, value: u64) -> String {
        let names = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        names.get(&value).cloned().unwrap_or_else(|| regime::as_str(value as u32).to_owned())
    }
}

impl RegimeTeller {
    /// One that has told nothing yet; `bus` is the thread's membership in the domain, if it has any.
    pub fn new(domain: Domain, bus: Option<Bus>, log: LogRegimes) -> Self {
        Self { domain, bus, told: Vec::new(), log }
    }

    /// Tells the names of these models instead of those before, which go on being told until the result is dropped. Without them states
    /// have all they need but a text, so that a failure is logged and the twin goes on.
    pub fn tell(&mut self, loaded: &[Loaded]) -> Vec<ToldRegimes> {
        let told = self.try_tell(loaded).unwrap_or_else(|error| {
            tracing::warn!("names of regimes are not told, their numbers stand for them: {error}");
            Vec::new()
        });
        std::mem::replace(&mut self.told, told)
    }

    /// Goes back to the names before, because the twin kept its models.
    pub fn keep(&mut self, before: Vec<ToldRegimes>) {
        self.told = before;
    }

    fn try_tell(&mut self, loaded: &[Loaded]) -> Result<Vec<ToldRegimes>, WireError> {
        let mut told = Vec::new();
        for model in loaded {
            let names = model.evaluator.named_regimes().map(|(number, name)| (number, name.to_owned()));
            let names: RegimeNames = names.collect();
            if !names.is_empty() {
                self.log.add(&model.model_hash, &names);
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
