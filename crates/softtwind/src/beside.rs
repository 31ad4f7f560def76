//! What runs beside the twin's loop, each in an ordinary thread with a node of its own: answers to questions, the grasp.

use runtime::config::{ConfigError, Scene};
use runtime::grasp::{GraspModel, GraspService};
use runtime::query::{Answerer, QueryService, load_answerers};
use runtime::realtime;
use runtime::wire::{Bus, Domain, WireError};
use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::{Sender, channel};
use std::sync::{Mutex, PoisonError};
use std::thread::Scope;

/// Everything that was loaded for it, before anything is bound.
pub struct Beside {
    answerers: Vec<Answerer>,
    grasp: Option<GraspModel>,
}

impl Beside {
    /// Loads the models of a scene once more, as far as answers need them.
    pub fn load(scene: &Scene, path: &Path) -> Result<Self, ConfigError> {
        Ok(Self { answerers: load_answerers(scene, path)?, grasp: GraspModel::load(scene, path)? })
    }
}

/// What a reload leaves for the threads beside the loop. The loop itself never looks here.
#[derive(Default)]
pub struct Shelf {
    prepared: Mutex<Option<Beside>>,
    answerers: Mutex<Option<Vec<Answerer>>>,
    grasp: Mutex<Option<GraspModel>>,
}

/// A panic in another thread leaves the place as it was: whole.
fn place<T>(slot: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    slot.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Shelf {
    /// Keeps what was loaded until the loop has taken its part.
    pub fn prepare(&self, beside: Beside) {
        *place(&self.prepared) = Some(beside);
    }

    /// The loop has taken its part: now the threads get theirs.
    pub fn release(&self) {
        if let Some(beside) = place(&self.prepared).take() {
            *place(&self.answerers) = Some(beside.answerers);
            *place(&self.grasp) = beside.grasp;
        }
    }
}

/// Starts the threads and waits until all of them serve; they end with `done`. Called before the loop takes real-time
/// rights, so that none of them inherits these.
pub fn start<'scope>(
    scope: &'scope Scope<'scope, '_>,
    domain: &Domain,
    beside: Beside,
    shelf: &'scope Shelf,
    done: &'scope AtomicBool,
) -> anyhow::Result<()> {
    let (started, starts) = channel::<Result<(), WireError>>();
    let mut threads = 0;
    if !beside.answerers.is_empty() {
        let (domain, started) = (domain.clone(), started.clone());
        threads += 1;
        scope.spawn(move || {
            let service = Bus::open(&domain).and_then(|bus| QueryService::start(&bus, beside.answerers));
            serve(service, &started, |mut service| service.run(done, || place(&shelf.answerers).take()));
        });
    }
    if let Some(model) = beside.grasp {
        let domain = domain.clone();
        threads += 1;
        scope.spawn(move || {
            let service = Bus::open(&domain).and_then(|bus| GraspService::start(&bus, model));
            serve(service, &started, |mut service| service.run(done, || place(&shelf.grasp).take()));
        });
    }
    for _ in 0..threads {
        starts.recv()??;
    }
    Ok(())
}

/// Tells how the start went, then serves.
fn serve<S>(service: Result<S, WireError>, started: &Sender<Result<(), WireError>>, run: impl FnOnce(S)) {
    match service {
        Ok(service) => {
            realtime::step_back();
            // Nobody listens any more when another thread failed to start: then the end is near anyway.
            let _ = started.send(Ok(()));
            run(service);
        }
        Err(error) => {
            let _ = started.send(Err(error));
        }
    }
}
