//! Thread that removes incomplete shared memory while a bus is open.
//!
//! If another program is killed while it creates its connection to one of our ports, iceoryx2 waits in our thread for the
//! completion of that connection: a second each time, or indefinitely while the file has no size.

use super::places::Places;
use crate::background_thread;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Pause between two looks. A look takes some 50 us, longer the more files all users together have in /dev/shm.
const PAUSE: Duration = Duration::from_millis(200);
/// Ratio of the pause to the duration of the look before it, at least.
const PAUSE_RATIO: u32 = 20;
/// The thread calls little and keeps little.
const STACK_BYTES: usize = 128 << 10;

/// The running thread; ended when dropped.
#[derive(Debug)]
pub(crate) struct Watch {
    stop: Option<Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Watch {
    /// Starts to watch `places`. If no thread can be started, other programs still remove incomplete files at their start.
    pub(crate) fn start(places: Places) -> Self {
        let (stop, stopped) = channel::<()>();
        let watch = move || {
            leave_signals_to_others();
            background_thread();
            let mut pause = PAUSE;
            while stopped.recv_timeout(pause) == Err(RecvTimeoutError::Timeout) {
                let begin = Instant::now();
                places.remove_incomplete();
                pause = PAUSE.max(PAUSE_RATIO * begin.elapsed());
            }
        };
        let thread =
            std::thread::Builder::new().name("domain-watch".into()).stack_size(STACK_BYTES).spawn(watch);
        Self { stop: Some(stop), thread: thread.ok() }
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        self.stop.take();
        if let Some(thread) = self.thread.take() {
            let _a_panic_there_ends_nothing_here = thread.join();
        }
    }
}

/// A program's own threads wait for its signals.
fn leave_signals_to_others() {
    // SAFETY: the set is filled before it is used; the mask is that of this thread only.
    unsafe {
        let mut all: libc::sigset_t = std::mem::zeroed();
        libc::sigfillset(&mut all);
        libc::pthread_sigmask(libc::SIG_SETMASK, &all, std::ptr::null_mut());
    }
}
