//! Log of a sensor or of a user's program, limited by rate: one that complains all the time must not fill a disk.

use std::fmt::Display;
use std::time::{Duration, Instant};

/// Most lines within [`PERIOD`].
const LINES_MAX: u32 = 20;
const PERIOD: Duration = Duration::from_secs(1);

/// Lines of one source: [`LINES_MAX`] within [`PERIOD`], of the others their number and the last one.
#[derive(Debug)]
pub(super) struct LimitedLog {
    name: String,
    begin: Instant,
    shown: u32,
    hidden: u64,
    last: String,
}

impl LimitedLog {
    pub(super) fn new(name: String) -> Self {
        Self { name, begin: Instant::now(), shown: 0, hidden: 0, last: String::new() }
    }

    /// Whether `line` is to be logged now. If not, it is counted.
    pub(super) fn admits(&mut self, line: impl Display) -> bool {
        self.flush();
        if self.shown < LINES_MAX {
            self.shown += 1;
            return true;
        }
        self.hidden += 1;
        self.last = line.to_string();
        false
    }

    /// Begins a period if the last one is over.
    pub(super) fn flush(&mut self) {
        if self.begin.elapsed() >= PERIOD {
            self.close();
            (self.begin, self.shown) = (Instant::now(), 0);
        }
    }

    fn close(&mut self) {
        if self.hidden > 0 {
            tracing::warn!("{}: {} more lines, the last one: {}", self.name, self.hidden, self.last);
            self.hidden = 0;
        }
    }
}

impl Drop for LimitedLog {
    fn drop(&mut self) {
        self.close();
    }
}
