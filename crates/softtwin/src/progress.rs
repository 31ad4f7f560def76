//! Progress of long work on standard error: a spinner for people, plain lines for logs.

use fem::run::Event;
use indicatif::{ProgressBar, ProgressStyle};
use std::io::{IsTerminal, Write};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Longest time without a line.
const BEAT: Duration = Duration::from_secs(10);

/// Steps of one piece of work.
pub struct Progress {
    bar: Option<ProgressBar>,
}

impl Progress {
    /// Silent when `quiet`, a spinner on a terminal, log lines otherwise.
    pub fn new(quiet: bool) -> Self {
        let bar = (!quiet && std::io::stderr().is_terminal()).then(|| {
            let bar = ProgressBar::new_spinner().with_style(ProgressStyle::default_spinner());
            bar.enable_steady_tick(Duration::from_millis(100));
            bar
        });
        Self { bar }
    }

    /// Says what is being done now.
    pub fn step(&mut self, text: &str) {
        match &self.bar {
            Some(bar) => bar.set_message(text.to_owned()),
            None => tracing::info!("{text}"),
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

/// A line on standard error every ten seconds, until it is dropped.
pub struct Heartbeat {
    ended: Arc<(Mutex<bool>, Condvar)>,
    thread: Option<JoinHandle<()>>,
}

impl Heartbeat {
    /// Prints the lines of `text`, unless it returns `None`.
    pub fn new(text: impl Fn() -> Option<String> + Send + 'static) -> Self {
        let ended = Arc::new((Mutex::new(false), Condvar::new()));
        let shared = Arc::clone(&ended);
        let thread = std::thread::spawn(move || {
            let (ended, changed) = &*shared;
            let mut is_over = ended.lock().unwrap_or_else(PoisonError::into_inner);
            while !*is_over {
                let (guard, wait) =
                    changed.wait_timeout(is_over, BEAT).unwrap_or_else(PoisonError::into_inner);
                is_over = guard;
                if let (true, false, Some(line)) = (wait.timed_out(), *is_over, text()) {
                    // Progress that cannot be written must not end the work.
                    let _ = writeln!(std::io::stderr(), "{line}");
                }
            }
        });
        Self { ended, thread: Some(thread) }
    }
}

impl Drop for Heartbeat {
    fn drop(&mut self) {
        *self.ended.0.lock().unwrap_or_else(PoisonError::into_inner) = true;
        self.ended.1.notify_all();
        if let Some(thread) = self.thread.take() {
            // A thread that panicked has printed its message.
            let _ = thread.join();
        }
    }
}

/// Present task of a program, with its start.
#[derive(Clone, Default)]
pub struct Doing(Arc<Mutex<Option<(String, Instant)>>>);

impl Doing {
    /// Begins something.
    pub fn begin(&self, what: impl Into<String>) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some((what.into(), Instant::now()));
    }

    /// Ends it.
    pub fn end(&self) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = None;
    }

    /// Lines about it.
    pub fn heartbeat(&self) -> Heartbeat {
        let doing = self.clone();
        Heartbeat::new(move || {
            let doing = doing.0.lock().unwrap_or_else(PoisonError::into_inner);
            doing.as_ref().map(|(what, since)| format!("{what}, {:.0} s", since.elapsed().as_secs_f64()))
        })
    }
}

/// Mean times per case after which a case that is still in work withdraws the estimate of the time left.
const OVERDUE: f64 = 2.0;

/// Progress of a list of cases.
pub struct Pace {
    cases: usize,
    began: Instant,
    /// Last time a case ended.
    last: Instant,
    reused: usize,
    ended: usize,
    /// Cases in work.
    running: Vec<String>,
}

impl Pace {
    pub fn new(cases: usize) -> Self {
        let now = Instant::now();
        Self { cases, began: now, last: now, reused: 0, ended: 0, running: Vec::new() }
    }

    /// Takes an event; a line for about every tenth of the work.
    pub fn take(&mut self, event: &Event<'_>) -> Option<String> {
        let case = match event {
            Event::Reused(_) => {
                self.reused += 1;
                return None;
            }
            Event::Started(case) => {
                self.running.push(case.name.clone());
                return None;
            }
            Event::Solved(case, _) | Event::Failed { case, .. } => case,
        };
        self.running.retain(|name| *name != case.name);
        if matches!(event, Event::Failed { again: true, .. }) {
            return None;
        }
        self.last = Instant::now();
        self.ended += 1;
        let is_tenth = self.ended.is_multiple_of(self.cases.div_ceil(10)) || self.left() == 0;
        is_tenth.then(|| self.line())
    }

    fn left(&self) -> usize {
        self.cases.saturating_sub(self.reused + self.ended)
    }

    pub fn line(&self) -> String {
        let running = if self.running.is_empty() {
            String::new()
        } else {
            format!(", in work: {}", self.running.join(", "))
        };
        format!("{} of {} cases{}{running}", self.reused + self.ended, self.cases, self.rest())
    }

    /// Estimate of the remaining time; withdrawn while the present case takes much longer than the mean.
    pub fn rest(&self) -> String {
        let mean_s = (self.last - self.began).as_secs_f64() / self.ended.max(1) as f64;
        let since_s = self.last.elapsed().as_secs_f64();
        if self.ended == 0 || since_s > OVERDUE * mean_s.max(1.0) {
            return format!(", none ended for {since_s:.0} s");
        }
        format!(", about {:.0} s left", (mean_s * self.left() as f64 - since_s).max(0.0))
    }
}
