//! Thread that removes incomplete shared memory while a bus is open.
//!
//! If another program is killed while it creates its connection to one of our ports, iceoryx2 waits in our thread for the
//! completion of that connection: a second each time, or indefinitely while the file has no size.

use super::places::Places;
use crate::background_thread;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// How often it looks. It takes some 50 us.
const PERIOD: Duration = Duration::from_millis(200);
/// Period at which files of this program are granted to the group, if there is one; takes about 200 us.
const SHARING_PERIOD: Duration = Duration::from_millis(10);
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
            let mut looked = Instant::now();
            // Connections are made while samples are sent: those of a shared domain are given to the group soon.
            let period = if places.group().is_some() { SHARING_PERIOD } else { PERIOD };
            while stopped.recv_timeout(period) == Err(RecvTimeoutError::Timeout) {
                places.share();
                if period == PERIOD || looked.elapsed() >= PERIOD {
                    looked = Instant::now();
                    places.remove_incomplete();
                }
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
