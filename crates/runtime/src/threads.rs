//! The threads beside the loop of a daemon. None of them ends unnoticed: one that ends before it should ends the daemon.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{Builder, Scope};

/// A thread ended before it should, or found a reason to end the program.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("the thread `{thread}` ended the program: {cause}")]
pub struct ThreadEnded {
    /// Name of the thread.
    pub thread: &'static str,
    /// What it found, the text of its panic, or that it returned.
    pub cause: String,
}

/// Threads that end together with a loop.
#[derive(Debug)]
pub struct ThreadGroup {
    stop: Arc<AtomicBool>,
    done: AtomicBool,
    failure: Mutex<Option<ThreadEnded>>,
}

/// Sets the end flag of the threads, also when the loop panics: otherwise it would wait for them without end.
struct EndOnDrop<'a>(&'a AtomicBool);

impl Drop for EndOnDrop<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Release);
    }
}

impl ThreadGroup {
    /// An empty group; `stop` is the flag that ends the loop.
    pub fn new(stop: Arc<AtomicBool>) -> Self {
        Self { stop, done: AtomicBool::new(false), failure: Mutex::default() }
    }

    /// Set when the threads are to end.
    pub fn done(&self) -> &AtomicBool {
        &self.done
    }

    /// Runs `main`, which spawns the threads and then loops; afterwards sets their end flag and waits for them.
    ///
    /// # Errors
    /// [`ThreadEnded`] when one of them ended before.
    pub fn run<'env, R>(
        &'env self,
        main: impl for<'scope> FnOnce(&'scope Scope<'scope, 'env>) -> R,
    ) -> Result<R, ThreadEnded> {
        let result = std::thread::scope(|scope| {
            let _end = EndOnDrop(&self.done);
            main(scope)
        });
        match self.failure.lock().unwrap_or_else(PoisonError::into_inner).take() {
            Some(ended) => Err(ended),
            None => Ok(result),
        }
    }

    /// Starts a thread that runs until [`Self::done`]. When it ends before, or panics, the stop flag is set.
    ///
    /// # Errors
    /// The system's refusal.
    pub fn spawn<'scope>(
        &'scope self,
        scope: &'scope Scope<'scope, '_>,
        name: &'static str,
        body: impl FnOnce() + Send + 'scope,
    ) -> std::io::Result<()> {
        let supervised = move || {
            let cause = match catch_unwind(AssertUnwindSafe(body)) {
                Ok(()) if self.done.load(Ordering::Acquire) => return,
                Ok(()) => "it returned".to_owned(),
                Err(panic) => panic_text(panic.as_ref()),
            };
            self.fail(name, cause);
        };
        Builder::new().name(name.into()).spawn_scoped(scope, supervised).map(drop)
    }

    /// Ends the loop because of what a thread found; the first cause counts.
    pub fn fail(&self, thread: &'static str, cause: String) {
        let mut failure = self.failure.lock().unwrap_or_else(PoisonError::into_inner);
        failure.get_or_insert(ThreadEnded { thread, cause });
        self.stop.store(true, Ordering::Release);
    }
}

/// The text of a panic.
pub fn panic_text(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(ToString::to_string);
    text.or(panic.downcast_ref::<String>().cloned()).unwrap_or("a panic without a text".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A group whose loop runs until its stop flag is set, beside a thread with this body.
    fn run(body: impl FnOnce(&AtomicBool) + Send) -> Result<(), ThreadEnded> {
        let stop = Arc::new(AtomicBool::new(false));
        let group = ThreadGroup::new(stop.clone());
        group.run(|scope| {
            group.spawn(scope, "worker", || body(group.done())).unwrap();
            while !stop.load(Ordering::Acquire) {
                std::thread::yield_now();
            }
        })
    }

    #[test]
    fn a_thread_that_panics_or_returns_ends_the_loop_and_is_named() {
        let panicked = run(|_| panic!("number {}", 7)).unwrap_err();
        assert_eq!(panicked, ThreadEnded { thread: "worker", cause: "number 7".into() });
        assert_eq!(run(|_| ()).unwrap_err().cause, "it returned");
    }

    #[test]
    fn a_thread_that_ends_when_asked_is_no_failure_and_a_panic_of_the_loop_ends_it_too() {
        let group = ThreadGroup::new(Arc::default());
        let wait = || {
            while !group.done().load(Ordering::Acquire) {
                std::thread::yield_now();
            }
        };
        assert_eq!(group.run(|scope| group.spawn(scope, "worker", wait).is_ok()), Ok(true));
        let group = ThreadGroup::new(Arc::default());
        let ended = catch_unwind(AssertUnwindSafe(|| {
            group.run(|scope| {
                let wait = || {
                    while !group.done().load(Ordering::Acquire) {
                        std::thread::yield_now();
                    }
                };
                group.spawn(scope, "worker", wait).unwrap();
                panic!("the loop");
            })
        }));
        assert!(ended.is_err());
    }
}
