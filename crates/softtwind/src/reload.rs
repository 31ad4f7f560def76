//! SIGHUP: reads scene and models again beside the running loop, and hands them over between two readings.

use crate::beside::{Beside, Successor};
use runtime::config::ConfigError;
use runtime::service;
use runtime::twin::{Loaded, Retired, SwapError, Twin};
use runtime::wire::layout;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::time::Duration;

/// How often the flag is looked at.
const INTERVAL: Duration = Duration::from_millis(20);

/// Scene and models, read again: for the loop and for what runs beside it.
pub type Reread = (Vec<Loaded>, Beside);

/// The loop's end: takes what was loaded, gives back what was replaced.
pub struct Desk {
    new: Receiver<Vec<Loaded>>,
    old: Sender<Result<Retired, SwapError>>,
}

/// The loader's end.
pub struct Loader {
    new: Sender<Vec<Loaded>>,
    old: Receiver<Result<Retired, SwapError>>,
}

/// The two ends.
pub fn pair() -> (Desk, Loader) {
    let (new_in, new_out) = channel();
    let (old_in, old_out) = channel();
    (Desk { new: new_out, old: old_in }, Loader { new: new_in, old: old_out })
}

impl Desk {
    /// Between two readings: swaps when something new lies there. Costs one look at an empty queue otherwise.
    pub fn serve(&self, twin: &mut Twin) {
        match self.new.try_recv() {
            // What was replaced is freed by the loader's thread; without it (the process ends) here.
            Ok(loaded) => drop(self.old.send(twin.swap(loaded))),
            Err(TryRecvError::Empty | TryRecvError::Disconnected) => {}
        }
    }
}

impl Loader {
    /// Loads again each time `asked` is set, until `done`. Whatever is wrong, the twin keeps what it has and the log says
    /// why.
    pub fn run(
        &self,
        asked: &AtomicBool,
        done: &AtomicBool,
        beside: &Successor,
        load: impl Fn() -> Result<Reread, ConfigError>,
    ) {
        while !done.load(Ordering::Acquire) {
            if asked.swap(false, Ordering::Relaxed) {
                service::tell_reloading();
                self.reload(done, beside, &load);
                service::tell_reloaded();
            }
            std::thread::sleep(INTERVAL);
        }
    }

    fn reload(&self, done: &AtomicBool, beside: &Successor, load: &impl Fn() -> Result<Reread, ConfigError>) {
        let (loaded, next_beside) = match load() {
            Ok(reread) => reread,
            Err(error) => return tracing::error!("reload refused, the old scene and models go on: {error}"),
        };
        let models: Vec<String> = loaded.iter().map(|loaded| layout::hex(&loaded.model_hash)).collect();
        if self.new.send(loaded).is_err() {
            return;
        }
        // The loop answers within a turn, unless it has ended meanwhile.
        while !done.load(Ordering::Acquire) {
            match self.old.recv_timeout(INTERVAL) {
                Ok(Ok(_freed_here)) => {
                    beside.replace(next_beside);
                    return tracing::info!(
                        "reloaded: scene and models swapped (models {})",
                        models.join(", ")
                    );
                }
                Ok(Err(error)) => {
                    return tracing::error!("reload refused, the old scene and models go on: {error}");
                }
                Err(_not_yet) => {}
            }
        }
    }
}
