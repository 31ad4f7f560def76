//! Calls that take seconds or hours: they are computed on a thread of their own, so that Ctrl-C ends the call at once and the interpreter
//! hears what is being done.

use pyo3::prelude::*;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

/// Longest time until a signal is seen.
const BEAT: Duration = Duration::from_millis(50);

/// What unwinds a computation that nobody waits for any more.
struct Abandoned;

/// Where a computation says what it does.
pub struct Progress(Sender<String>);

impl Progress {
    /// Tells one step. Does not return if the call was interrupted: the thread unwinds, without a message.
    pub fn tell(&self, text: impl Into<String>) {
        if self.0.send(text.into()).is_err() {
            std::panic::resume_unwind(Box::new(Abandoned));
        }
    }
}

/// Computes and waits for the result. `progress` is called with each step; when it raises, or a signal's handler does, the call ends with that
/// exception, and the computation ends at its next step.
pub fn long_call<T: Send + 'static>(
    py: Python<'_>,
    progress: Option<&Py<PyAny>>,
    work: impl FnOnce(&Progress) -> T + Send + 'static,
) -> PyResult<T> {
    let (sender, steps) = channel();
    let thread = std::thread::spawn(move || work(&Progress(sender)));
    let steps: Mutex<Receiver<String>> = Mutex::new(steps);
    let next = || steps.lock().unwrap_or_else(PoisonError::into_inner).recv_timeout(BEAT);
    loop {
        match py.detach(next) {
            Ok(step) => {
                progress.map(|progress| progress.call1(py, (step,))).transpose()?;
            }
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => break,
        }
        py.check_signals()?;
    }
    py.detach(|| thread.join().or_else(|panic| std::panic::resume_unwind(panic)))
}
