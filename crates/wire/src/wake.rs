//! Sleeping until one of several readers has something.

use crate::WireError;
use crate::bus::Ipc;
use iceoryx2::port::listener::Listener;
use iceoryx2::prelude::FileDescriptorBased;
use std::time::Duration;

/// A reader that can be waited for.
pub trait Wakeable {
    /// `None`: this reader is never woken.
    #[doc(hidden)]
    fn listener(&self) -> Option<&Listener<Ipc>>;
}

/// Whether a reader is woken when something comes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Waking {
    /// With every sample: it costs the writer 5-8 us a sample.
    ByEvent,
    /// Never: for a reader that looks at a pace of its own, and costs the writer next to nothing. It may be in a [`WakeSet`],
    /// and ends no wait there.
    Never,
}

/// Why a wait ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wake {
    /// At least one reader was notified (its samples may have been taken already: look, do not assume).
    Event,
    /// The time is over.
    Timeout,
    /// A signal came: look at your shutdown flag.
    Signal,
}

/// Waits for any of a fixed set of readers with one system call and without allocating.
#[derive(Debug)]
pub struct WakeSet {
    poll: Vec<libc::pollfd>,
}

impl WakeSet {
    /// A set over `readers`; [`Self::wait`] must be given the same readers in the same order.
    pub fn new<'a>(readers: impl IntoIterator<Item = &'a dyn Wakeable>) -> Self {
        let poll = readers
            .into_iter()
            .map(|reader| {
                // SAFETY: the descriptor is only polled, never closed or read here, and only while `wait` borrows the
                // readers that own it. The system passes over -1.
                let fd = reader
                    .listener()
                    .map_or(-1, |listener| unsafe { listener.file_descriptor().native_handle() });
                libc::pollfd { fd, events: libc::POLLIN, revents: 0 }
            })
            .collect();
        Self { poll }
    }

    /// Sleeps until a reader is notified, `timeout` is over, or a signal comes. Pending notifications are taken away, so
    /// that the next wait sleeps again; samples stay for the caller to take.
    ///
    /// # Errors
    /// [`WireError::Wait`] when the system refuses to wait.
    pub fn wait<'a>(
        &mut self,
        readers: impl IntoIterator<Item = &'a dyn Wakeable>,
        timeout: Duration,
    ) -> Result<Wake, WireError> {
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
        for (reader, poll) in readers.into_iter().zip(&self.poll) {
            if let (true, Some(listener)) = (poll.revents != 0, reader.listener()) {
                listener.try_wait(|_| {}).map_err(|error| WireError::Wait { cause: format!("{error:?}") })?;
            }
        }
        Ok(Wake::Event)
    }
}
