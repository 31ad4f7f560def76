//! Threads of a program that start one by one, are supervised, and end together.

use std::any::Any;
use std::error::Error;
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::Duration;

/// Longest sleep of a thread, so that it soon sees the stop flag.
pub const WAIT: Duration = Duration::from_millis(50);

/// What the work of a thread returns. `Ok` before it was asked to end is an error too.
pub type ThreadResult = Result<(), Box<dyn Error + Send + Sync>>;

/// A thread ended although nobody asked it to. A program that goes on without it would do only a part of its work.
#[derive(Debug, thiserror::Error)]
#[error("the thread `{thread}` ended although the program goes on: {cause}")]
pub struct ThreadEnded {
    /// Its name.
    pub thread: String,
    /// Its error, the message of its panic, or that there was neither.
    pub cause: String,
}

/// Threads that are asked to end, and waited for, when this is dropped.
#[derive(Debug, Default)]
pub struct ThreadGroup {
    stop: StopFlag,
    threads: Vec<(String, JoinHandle<ThreadResult>)>,
}

/// Whether a thread is asked to end.
#[derive(Debug, Clone, Default)]
pub struct StopFlag(Arc<AtomicBool>);

impl ThreadGroup {
    /// A group whose threads end when `stop` is set, by whomever.
    pub fn with_stop(stop: Arc<AtomicBool>) -> Self {
        Self { stop: StopFlag(stop), threads: Vec::new() }
    }

    /// Starts one more thread, which does `work` until the flag is set.
    ///
    /// # Errors
    /// The system's refusal to start a thread.
    pub fn start(
        &mut self,
        name: &str,
        work: impl FnOnce(&StopFlag) -> ThreadResult + Send + 'static,
    ) -> io::Result<()> {
        let stop = self.stop.clone();
        // The system keeps 15 bytes of a thread's name and refuses a zero byte.
        let short: String = name.chars().filter(char::is_ascii_graphic).take(15).collect();
        let thread = thread::Builder::new().name(short).spawn(move || work(&stop))?;
        self.threads.push((name.to_owned(), thread));
        Ok(())
    }

    /// Whether all threads still run.
    ///
    /// # Errors
    /// [`ThreadEnded`] for the first one that does not, unless all are asked to end.
    pub fn check(&mut self) -> Result<(), ThreadEnded> {
        if self.stop.is_set() {
            return Ok(());
        }
        match self.threads.iter().position(|(_, thread)| thread.is_finished()) {
            None => Ok(()),
            Some(at) => {
                let (thread, handle) = self.threads.swap_remove(at);
                Err(match handle.join() {
                    Ok(Ok(())) => ThreadEnded {
                        thread,
                        cause: "it returned; this is a defect, please report it".into(),
                    },
                    Ok(Err(error)) => ThreadEnded { thread, cause: error.to_string() },
                    Err(panic) => panicked(&thread, &*panic),
                })
            }
        }
    }
}

/// The error of a thread that panicked.
pub fn panicked(thread: &str, panic: &(dyn Any + Send)) -> ThreadEnded {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    let text = text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("without a message");
    ThreadEnded {
        thread: thread.to_owned(),
        cause: format!("it panicked: {text}; this is a defect, please report it"),
    }
}

impl StopFlag {
    /// Whether the thread is asked to end.
    pub fn is_set(&self) -> bool {
        self.0.load(Ordering::Relaxed)
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

impl Drop for ThreadGroup {
    fn drop(&mut self) {
        self.stop.0.store(true, Ordering::Relaxed);
        for (_, thread) in self.threads.drain(..) {
            // An error after the flag was set concerns nobody: the work was over.
            let _ = thread.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc;

    fn end_of(work: impl FnOnce(&StopFlag) -> ThreadResult + Send + 'static) -> String {
        let mut group = ThreadGroup::default();
        group
            .start("healthy", |stop| {
                stop.pause(Duration::from_secs(60));
                Ok(())
            })
            .unwrap();
        group.start("softtwin/finger/sensor", work).unwrap();
        loop {
            if let Err(ended) = group.check() {
                return ended.to_string();
            }
            thread::yield_now();
        }
    }

    #[test]
    fn a_thread_that_ends_unasked_is_named_with_its_cause() {
        for (ended, cause) in [
            (end_of(|_| Ok(())), "it returned"),
            (end_of(|_| Err("no disk".into())), "no disk"),
            (end_of(|_| panic!("index {}", 7)), "it panicked: index 7"),
        ] {
            assert!(ended.contains("`softtwin/finger/sensor` ended") && ended.contains(cause), "{ended}");
        }
    }

    #[test]
    fn threads_that_were_asked_to_end_are_no_error_and_are_waited_for() {
        let (sender, ends) = mpsc::channel();
        let mut group = ThreadGroup::default();
        group
            .start("worker", move |stop| {
                while !stop.is_set() {
                    stop.pause(Duration::from_secs(60));
                }
                sender.send(()).map_err(Into::into)
            })
            .unwrap();
        group.check().unwrap();
        drop(group);
        ends.try_recv().expect("it was waited for");
    }
}
