//! Services of a twin that only one program can have at a time: answers to questions, the grasp, the port of the metrics page.

use crate::metrics::{self, MetricsOptions};
use crate::side_services::{ReloadHandle, SideServices};
use runtime::thread_group::ThreadGroup;
use runtime::wire::{Bus, Domain, Held, Topic};
use std::time::Duration;

/// How long to wait for an earlier twin to end.
const PATIENCE: Duration = Duration::from_secs(10);

/// Everything that is to be started.
pub struct ExclusiveServices {
    pub metrics: MetricsOptions,
    /// Names of the actuators, and whether they have estimates.
    pub shown: Vec<(String, bool)>,
    pub services: SideServices,
    pub domain: Domain,
    /// The topics that stand for the actuators.
    pub topics: Vec<Topic>,
}

impl ExclusiveServices {
    /// Waits until an earlier twin has ended, then starts everything in `group`. What comes first says that this twin lives: it is to
    /// be dropped after the group has ended.
    ///
    /// # Errors
    /// The earlier twin does not end; a port in use; the refusals of the topics.
    pub fn start(self, group: &mut ThreadGroup) -> anyhow::Result<(Held, ReloadHandle)> {
        let place = Bus::open(&self.domain)?.hold_place(&self.topics, PATIENCE)?;
        let listener = self.metrics.open()?;
        let (domain, shown) = (self.domain.clone(), self.shown);
        runtime::metrics::start(group, listener, move || metrics::twins(&domain, &shown))?;
        Ok((place, self.services.start(group, &self.domain)?))
    }
}
