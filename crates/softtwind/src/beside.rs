//! What runs beside the twin's loop, each in an ordinary thread with a node of its own: answers to questions, the grasp.

use runtime::config::{ConfigError, Scene};
use runtime::grasp::{GraspModel, GraspService};
use runtime::query::{Answerer, QueryService, load_answerers};
use runtime::realtime;
use runtime::wire::{Bus, Domain, WireError};
use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::{Receiver, Sender, channel};
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

/// Hands what was loaded again to the threads that run.
pub struct Successor {
    answerers: Sender<Vec<Answerer>>,
    grasp: Sender<GraspModel>,
}

impl Successor {
    /// The threads take it up between two turns.
    pub fn replace(&self, beside: Beside) {
        // A thread that does not run, or runs no more, needs nothing.
        let _ = self.answerers.send(beside.answerers);
        if let Some(model) = beside.grasp {
            let _ = self.grasp.send(model);
        }
    }
}

/// Starts the threads and waits until all of them serve; they end with `done`. Called before the loop takes real-time
/// rights, so that none of them inherits these.
pub fn start<'scope>(
    scope: &'scope Scope<'scope, '_>,
    domain: &Domain,
    beside: Beside,
    done: &'scope AtomicBool,
) -> anyhow::Result<Successor> {
    let (started, starts) = channel::<Result<(), WireError>>();
    let (answerers, next_answerers) = channel();
    let (grasp, next_grasp) = channel();
    let mut threads = 0;
    if !beside.answerers.is_empty() {
        let (domain, started) = (domain.clone(), started.clone());
        threads += 1;
        scope.spawn(move || {
            let service = Bus::open(&domain).and_then(|bus| QueryService::start(&bus, beside.answerers));
            serve(service, &started, |mut service| {
                service.run_with(done, |service| {
                    take_up("answers", &next_answerers, |new| service.replace(new))
                });
            });
        });
    }
    if let Some(model) = beside.grasp {
        let domain = domain.clone();
        threads += 1;
        scope.spawn(move || {
            let service = Bus::open(&domain).and_then(|bus| GraspService::start(&bus, model));
            serve(service, &started, |mut service| {
                service.run_with(done, |service| take_up("grasp", &next_grasp, |new| service.replace(new)));
            });
        });
    }
    for _ in 0..threads {
        starts.recv()??;
    }
    Ok(Successor { answerers, grasp })
}

/// Takes up what was loaded again, if anything was.
fn take_up<T>(what: &str, next: &Receiver<T>, replace: impl FnOnce(T) -> bool) {
    if let Ok(new) = next.try_recv()
        && !replace(new)
    {
        tracing::error!(
            "{what}: the new scene asks for other actuators; the old models go on, start the twin anew"
        );
    }
}

/// Tells how the start went, then serves.
fn serve<S>(service: Result<S, WireError>, started: &Sender<Result<(), WireError>>, run: impl FnOnce(S)) {
    match service {
        Ok(service) => {
            // Nobody listens any more when another thread failed to start: then the end is near anyway.
            let _ = started.send(Ok(()));
            realtime::step_back();
            run(service);
        }
        Err(error) => {
            let _ = started.send(Err(error));
        }
    }
}
