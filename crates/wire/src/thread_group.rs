//! Threads that are supervised and end together. None of them ends unnoticed.

use std::any::Any;
use std::error::Error;
use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::Duration;

/// Longest sleep of a thread, so that it soon sees that it is to end.
pub const WAIT: Duration = Duration::from_millis(50);

/// Time between two checks of work in another thread.
const POLL: Duration = Duration::from_millis(5);

/// Result of a thread. `Ok` before the group ends is a failure too.
pub type ThreadResult = Result<(), Box<dyn Error + Send + Sync>>;

/// A thread ended unexpectedly. A program without it would do only a part of its work.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("the thread `{thread}` ended the program: {cause}")]
pub struct ThreadEnded {
    /// Its name.
    pub thread: String,
    /// Its error, the message of its panic, or that there was neither.
    pub cause: String,
}

/// Threads that are asked to end, and waited for, when this is dropped.
#[derive(Debug, Default)]
pub struct ThreadGroup {
    /// Ends the program's own loop; set by the first thread that fails.
    program: Arc<AtomicBool>,
    end: StopFlag,
    failure: Arc<Mutex<Option<ThreadEnded>>>,
    threads: Vec<JoinHandle<()>>,
}

/// Whether a thread is asked to end.
#[derive(Debug, Clone, Default)]
pub struct StopFlag(Arc<AtomicBool>);

impl ThreadGroup {
    /// A group that sets `program` when one of its threads fails. Its threads end with the group, which is after the
    /// program's loop.
    pub fn new(program: Arc<AtomicBool>) -> Self {
        Self::of(program, StopFlag::default())
    }

    /// A group whose threads end together with the program's loop, when `program` is set.
    pub fn with_program(program: Arc<AtomicBool>) -> Self {
        Self::of(program.clone(), StopFlag(program))
    }

    fn of(program: Arc<AtomicBool>, end: StopFlag) -> Self {
        Self { program, end, failure: Arc::default(), threads: Vec::new() }
    }

    /// Starts one more thread, which does `work` until it is asked to end.
    ///
    /// # Errors
    /// The thread cannot be started.
    pub fn start(
        &mut self,
        name: &str,
        work: impl FnOnce(&StopFlag) -> ThreadResult + Send + 'static,
    ) -> io::Result<()> {
        let (program, end, failure) = (self.program.clone(), self.end.clone(), self.failure.clone());
        // The system keeps 15 bytes of a thread's name and refuses a zero byte.
        let short: String = name.chars().filter(char::is_ascii_graphic).take(15).collect();
        let name = name.to_owned();
        let supervised = move || {
            let cause = match catch_unwind(AssertUnwindSafe(|| work(&end))) {
                // The work was over: neither the return nor an error concerns anybody.
                Ok(_) if end.is_set() => return,
                Ok(Ok(())) => "it returned; this is a defect, please report it".to_owned(),
                Ok(Err(error)) => error.to_string(),
                Err(panic) => panic_cause(&*panic),
            };
            let mut failure = failure.lock().unwrap_or_else(PoisonError::into_inner);
            failure.get_or_insert(ThreadEnded { thread: name, cause });
            program.store(true, Ordering::Release);
        };
        self.threads.push(thread::Builder::new().name(short).spawn(supervised)?);
        Ok(())
    }

    /// Whether no thread has failed.
    ///
    /// # Errors
    /// [`ThreadEnded`] of the first one that has.
    pub fn check(&self) -> Result<(), ThreadEnded> {
        let failure = self.failure.lock().unwrap_or_else(PoisonError::into_inner);
        failure.clone().map_or(Ok(()), Err)
    }

    /// Asks all threads to end and waits for them.
    ///
    /// # Errors
    /// As [`Self::check`], a panic after they were asked to end included.
    pub fn end(mut self) -> Result<(), ThreadEnded> {
        self.join();
        self.check()
    }

    fn join(&mut self) {
        self.end.0.store(true, Ordering::Release);
        for thread in self.threads.drain(..) {
            // Panics are caught in the thread.
            let _ended = thread.join();
        }
    }
}

impl Drop for ThreadGroup {
    fn drop(&mut self) {
        self.join();
    }
}

/// The text of a panic.
pub fn panic_text(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("without a message")
}

/// Message of a panicked thread.
pub fn panic_cause(panic: &(dyn Any + Send)) -> String {
    format!("it panicked: {}; this is a defect, please report it", panic_text(panic))
}

impl StopFlag {
    /// Whether the thread is asked to end.
    pub fn is_set(&self) -> bool {
        self.0.load(Ordering::Acquire)
    }

    /// The flag itself.
    pub fn as_atomic(&self) -> &AtomicBool {
        &self.0
    }

    /// Result of `work`, which runs in a separate thread; `None` if the caller is asked to end first. The thread is then left to the
    /// end of the process: `work` must only read.
    pub fn unless_set<T: Send + 'static>(&self, work: impl FnOnce() -> T + Send + 'static) -> Option<T> {
        let mut work = Some(thread::spawn(work));
        while !self.is_set() {
            match work.take_if(|work| work.is_finished()).map(JoinHandle::join) {
                Some(Ok(done)) => return Some(done),
                Some(Err(panic)) => std::panic::resume_unwind(panic),
                None => thread::sleep(POLL),
            }
        }
        None
    }

    /// Sleeps for `time`, or until the thread is asked to end.
    pub fn pause(&self, time: Duration) {
        let mut left = time;
        while !self.is_set() && !left.is_zero() {
            let nap = left.min(WAIT);
            thread::sleep(nap);
            left -= nap;
        }
    }
}
