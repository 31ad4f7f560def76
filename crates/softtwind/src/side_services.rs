//! Services of a twin on separate threads with their own ports: answers to queries, the grasp.

use runtime::config::{ConfigError, Scene};
use runtime::grasp::{GraspModel, GraspService};
use runtime::query::{Answerer, QueryService, load_answerers};
use runtime::realtime;
use runtime::side_service::SideService;
use runtime::thread_group::{StopFlag, ThreadGroup};
use runtime::wire::{Bus, Domain, WireError};
use std::path::Path;
use std::sync::mpsc::{Receiver, Sender, channel};

/// The models of all side services, loaded before anything is bound.
pub struct SideServices {
    answerers: Vec<Answerer>,
    grasp: Option<GraspModel>,
}

impl SideServices {
    /// Loads the models of a scene once more, as far as the services need them.
    pub fn load(scene: &Scene, path: &Path) -> Result<Self, ConfigError> {
        Ok(Self { answerers: load_answerers(scene, path)?, grasp: GraspModel::load(scene, path)? })
    }

    /// Starts the threads and waits until all of them serve. To be called before the loop takes real-time rights, which threads
    /// inherit.
    ///
    /// # Errors
    /// Ports in use, and I/O errors.
    pub fn start(self, group: &mut ThreadGroup, domain: &Domain) -> anyhow::Result<ReloadHandle> {
        let answerers = Some(self.answerers).filter(|answerers| !answerers.is_empty());
        Ok(ReloadHandle {
            answerers: start::<QueryService>(group, domain, answerers)?,
            grasp: start::<GraspService>(group, domain, self.grasp)?,
        })
    }
}

/// Passes reloaded models to the running services.
pub struct ReloadHandle {
    answerers: Sender<Vec<Answerer>>,
    grasp: Sender<GraspModel>,
}

impl ReloadHandle {
    /// Passes models to the running services, which take them in their next iteration.
    pub fn replace(&self, services: SideServices) {
        let _not_running = self.answerers.send(services.answerers);
        if let Some(model) = services.grasp {
            let _not_running = self.grasp.send(model);
        }
    }
}

/// Starts one service, if it has a model, and waits until it serves.
fn start<S: SideService<Model: 'static>>(
    group: &mut ThreadGroup,
    domain: &Domain,
    model: Option<S::Model>,
) -> anyhow::Result<Sender<S::Model>> {
    let (models, next_models) = channel();
    let Some(model) = model else { return Ok(models) };
    let (started, start) = channel();
    let domain = domain.clone();
    group.start(S::NAME, move |end| {
        serve::<S>(&domain, model, &started, &next_models, end);
        Ok(())
    })?;
    // The other end is dropped only by a thread that panicked; the group reports it.
    start.recv().unwrap_or(Ok(()))?;
    Ok(models)
}

/// Opens the ports, reports how that went, then serves.
fn serve<S: SideService>(
    domain: &Domain,
    model: S::Model,
    started: &Sender<Result<(), WireError>>,
    models: &Receiver<S::Model>,
    end: &StopFlag,
) {
    let service = Bus::open(domain).and_then(|bus| S::start(&bus, model));
    let (mut service, result) = match service {
        Ok(service) => (Some(service), Ok(())),
        Err(error) => (None, Err(error)),
    };
    let _received = started.send(result);
    if let Some(service) = &mut service {
        realtime::lower_priority();
        service.run(end.as_atomic(), models);
    }
}
