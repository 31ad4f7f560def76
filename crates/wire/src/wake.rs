//! Waiting until one of several readers has something.

use crate::error::WireError;
use crate::sys::Ipc;
use iceoryx2::port::listener::Listener;
use iceoryx2::prelude::FileDescriptorBased;
use std::os::fd::{AsRawFd, FromRawFd, OwnedFd};
use std::rc::Rc;
use std::time::Duration;

/// A reader that can be waited for.
pub trait Wakeable {
    /// Event source for a [`WakeSet`].
    fn waker(&self) -> Waker;
}

/// Event source of a reader; empty for a reader that is never woken. It outlives its reader.
#[derive(Debug, Clone)]
pub struct Waker(Option<Rc<Listener<Ipc>>>);

impl Waker {
    pub(crate) fn new(listener: Option<Listener<Ipc>>) -> Self {
        Self(listener.map(Rc::new))
    }
}

/// Whether a reader is woken when something comes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Waking {
    /// With every sample: it costs the writer 5-8 us a sample.
    ByEvent,
    /// Never: for a reader that polls, with almost no cost for the writer. It may be in a [`WakeSet`], and ends no wait there.
    Never,
}

/// Why a wait ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wake {
    /// At least one reader was notified. Its samples may have been taken already: the reader is to be read, not assumed full.
    Event,
    /// The time is over.
    Timeout,
    /// A signal came: a shutdown flag may be set now.
    Signal,
}

/// Waits for any of a fixed set of readers with one system call and without allocating.
///
/// The set shares the listeners with their readers, so none of them can end while it is waited for.
#[derive(Debug)]
pub struct WakeSet {
    listeners: Vec<Rc<Listener<Ipc>>>,
    /// One for each listener, in the same order.
    poll: Vec<libc::pollfd>,
}

impl WakeSet {
    /// A set over `readers`.
    pub fn new<'a>(readers: impl IntoIterator<Item = &'a dyn Wakeable>) -> Self {
        Self::of(readers.into_iter().map(|reader| reader.waker()))
    }

    pub(crate) fn of(wakers: impl IntoIterator<Item = Waker>) -> Self {
        let listeners: Vec<_> = wakers.into_iter().filter_map(|waker| waker.0).collect();
        let poll = listeners
            .iter()
            .map(|listener| {
                // SAFETY: the descriptor is only polled, never closed or read, and its owner is kept in `listeners` for
                // as long as this set lives.
                let fd = unsafe { listener.file_descriptor().native_handle() };
                libc::pollfd { fd, events: libc::POLLIN, revents: 0 }
            })
            .collect();
        Self { listeners, poll }
    }

    /// A descriptor that is readable while a reader of the set is notified, for a program's own event loop. What it tells is taken
    /// by [`Self::wait`] with no time.
    ///
    /// # Errors
    /// [`WireError::Wait`] when the system refuses one more descriptor.
    pub fn descriptor(&self) -> Result<OwnedFd, WireError> {
        let refused = || WireError::Wait { cause: std::io::Error::last_os_error().to_string() };
        // SAFETY: the call has no pointers.
        let code = unsafe { libc::epoll_create1(libc::EPOLL_CLOEXEC) };
        if code < 0 {
            return Err(refused());
        }
        // SAFETY: the descriptor was just created and has no other owner.
        let all = unsafe { OwnedFd::from_raw_fd(code) };
        for one in &self.poll {
            let mut event = libc::epoll_event { events: libc::EPOLLIN as u32, u64: 0 };
            // SAFETY: both descriptors are open (the listener's is kept in `listeners`), `event` lives across the call.
            if unsafe { libc::epoll_ctl(all.as_raw_fd(), libc::EPOLL_CTL_ADD, one.fd, &mut event) } != 0 {
                return Err(refused());
            }
        }
        Ok(all)
    }

    /// Sleeps until a reader is notified, `timeout` is over, or a signal comes. Pending notifications are consumed, so
    /// that the next wait sleeps again; samples stay in their readers.
    ///
    /// # Errors
    /// [`WireError::Wait`] when the system refuses to wait.
    pub fn wait(&mut self, timeout: Duration) -> Result<Wake, WireError> {
        let time = libc::timespec {
            tv_sec: timeout.as_secs().min(1 << 30) as libc::time_t,
            tv_nsec: timeout.subsec_nanos().into(),
        };
        let count = self.poll.len() as libc::nfds_t;
        // SAFETY: the pointer and count describe our own vector, `time` lives across the call, no signal mask is given.
        let ready = unsafe { libc::ppoll(self.poll.as_mut_ptr(), count, &time, std::ptr::null()) };
        if ready < 0 {
            let error = std::io::Error::last_os_error();
            return match error.kind() {
                std::io::ErrorKind::Interrupted => Ok(Wake::Signal),
                _ => Err(WireError::Wait { cause: error.to_string() }),
            };
        }
        if ready == 0 {
            return Ok(Wake::Timeout);
        }
        for (listener, _) in self.listeners.iter().zip(&self.poll).filter(|(_, poll)| poll.revents != 0) {
            listener.try_wait(|_| {}).map_err(|error| WireError::Wait { cause: format!("{error:?}") })?;
        }
        Ok(Wake::Event)
    }
}
