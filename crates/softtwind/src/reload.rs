//! SIGHUP of a twin: reads scene and models again while the loop runs, which takes them between two readings.

use crate::side_services::{ReloadHandle, SideServices};
use runtime::config::ConfigError;
use runtime::load::LoadedActuator;
use runtime::service;
use runtime::thread_group::StopFlag;
use runtime::twin::{Retired, SwapError, Twin};
use runtime::wire::layout;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::time::Duration;

/// Interval of checks of the flag.
const INTERVAL: Duration = Duration::from_millis(20);

/// Scene and models, read again: for the loop and for the side services.
pub type Reloaded = (Vec<LoadedActuator>, SideServices);

/// The end of the loop: receives loaded models and returns the replaced ones.
pub struct ModelInbox {
    new: Receiver<Vec<LoadedActuator>>,
    old: Sender<Result<Retired, SwapError>>,
}

/// The end of the loader thread.
pub struct Loader {
    new: Sender<Vec<LoadedActuator>>,
    old: Receiver<Result<Retired, SwapError>>,
}

/// The two ends.
pub fn pair() -> (ModelInbox, Loader) {
    let (new_in, new_out) = channel();
    let (old_in, old_out) = channel();
    (ModelInbox { new: new_out, old: old_in }, Loader { new: new_in, old: old_out })
}

impl ModelInbox {
    /// Swaps models between two readings, if new ones wait; otherwise checks an empty queue.
    pub fn swap(&self, twin: &mut Twin) {
        match self.new.try_recv() {
            // The loader thread frees the replaced models; at the end of the process this one does.
            Ok(loaded) => drop(self.old.send(twin.swap(loaded))),
            Err(TryRecvError::Empty | TryRecvError::Disconnected) => {}
        }
    }
}

impl Loader {
    /// Loads again each time `requested` is set, until `end`. On any error the twin stays unchanged, and the error is logged.
    pub fn run(
        &self,
        requested: &AtomicBool,
        end: &StopFlag,
        services: &ReloadHandle,
        load: impl Fn() -> Result<Reloaded, ConfigError> + Clone + Send + 'static,
    ) {
        while !end.is_set() {
            if requested.swap(false, Ordering::Relaxed) {
                service::notify_reloading();
                self.reload(end, services, load.clone());
                service::notify_reloaded();
            }
            end.pause(INTERVAL);
        }
    }

    fn reload(
        &self,
        end: &StopFlag,
        services: &ReloadHandle,
        load: impl Fn() -> Result<Reloaded, ConfigError> + Send + 'static,
    ) {
        let Some(reread) = end.unless_set(load) else { return };
        let (loaded, new_services) = match reread {
            Ok(reread) => reread,
            Err(error) => return tracing::error!("reload refused, the old scene and models stay: {error}"),
        };
        let models: Vec<String> = loaded.iter().map(|loaded| layout::hex(&loaded.model_hash)).collect();
        if self.new.send(loaded).is_err() {
            return;
        }
        // The loop takes them in its next iteration, unless it has ended.
        while !end.is_set() {
            match self.old.recv_timeout(INTERVAL) {
                Ok(Ok(retired)) => {
                    services.replace(new_services);
                    // Before the log line: after it the memory of one model is in use.
                    drop(retired);
                    return tracing::info!(
                        "reloaded: scene and models swapped (models {})",
                        models.join(", ")
                    );
                }
                Ok(Err(error)) => {
                    return tracing::error!("reload refused, the old scene and models stay: {error}");
                }
                Err(_not_yet) => {}
            }
        }
    }
}
