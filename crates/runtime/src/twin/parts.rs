//! Everything of scene and model that a start and a reload set in the same way.

use super::ingest::Needed;
use super::markers::Markers;
use super::observed::MeasuredObservables;
use crate::config::StateSpec;
use crate::estimation::{FollowedOutputs, LastUsed};
use crate::load::{LoadedActuator, PayloadContents};
use rom::evaluator::RegimeLabels;
use rom::session::Session;
use wire::layout::INPUTS_MAX;
use wire::{Health, State};

/// Parts of one actuator.
#[derive(Debug)]
pub(super) struct Parts {
    pub model_hash: [u8; 16],
    pub session: Session,
    pub labels: RegimeLabels,
    pub needed: Needed,
    pub contents: PayloadContents,
    /// Source of the value of each input of the payloads.
    pub input_sources: [u8; INPUTS_MAX],
    pub backlog: usize,
    pub wanted: StateSpec,
    /// Standard deviation of the load cell, N.
    pub force_sigma_n: f64,
    /// `None` if the scene has no markers.
    pub markers: Option<Markers>,
    pub observed: MeasuredObservables,
    /// `None` if the session follows nothing.
    pub followed: Option<FollowedOutputs>,
    pub used: LastUsed,
}

impl Parts {
    /// Parts of a loaded actuator whose outputs and estimator have been taken.
    pub fn new(mut loaded: LoadedActuator) -> Self {
        let markers = loaded.markers.take().map(|model| Markers::new(model, &loaded.spec));
        Self {
            model_hash: loaded.model_hash,
            needed: Needed::of(&loaded),
            input_sources: loaded.contents.sources(&loaded.spec, loaded.session.evaluator().inputs()),
            backlog: loaded.spec.backlog,
            wanted: loaded.spec.state,
            force_sigma_n: loaded.spec.force_sigma_n(),
            markers,
            observed: MeasuredObservables::new(&loaded.spec, &loaded.observed),
            followed: loaded.followed,
            used: LastUsed::default(),
            contents: loaded.contents,
            labels: RegimeLabels::new(loaded.session.evaluator()),
            session: loaded.session,
        }
    }

    /// Writes model and inputs into the state and the health.
    pub fn write_names(&self, state: &mut State, health: &mut Health) {
        (state.model_hash, health.model_hash) = (self.model_hash, self.model_hash);
        (state.input_count, state.input_names) = (self.contents.count, self.contents.names);
        state.input_sources = self.input_sources;
    }
}
