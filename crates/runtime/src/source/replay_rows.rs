//! The rows of a replay: those of a CSV trace in memory, those of a recording as they are needed.

use super::named::InputNames;
use super::reading::Reading;
use super::recorded;
use super::trace::{Survey, Trace};
use super::trace_error::TraceError;
use std::path::{Path, PathBuf};

/// The part of a trace that is replayed, s of its time.
#[derive(Debug, Clone, Copy)]
pub(super) struct Part {
    pub(super) from_s: f64,
    pub(super) to_s: f64,
}

impl Part {
    fn contains(self, row: &Reading) -> bool {
        row.t_trace_s >= self.from_s && row.t_trace_s <= self.to_s
    }
}

/// What is known of a trace before it is replayed.
#[derive(Debug, Default)]
pub(super) struct About {
    /// Median time between rows, s; 0 for a single row.
    pub(super) period_s: f64,
    /// Places where time jumps: (line, seconds).
    pub(super) gaps: Vec<(usize, f64)>,
    /// Times of the first and the last row of the part.
    pub(super) first_and_last_s: Option<(f64, f64)>,
}

impl About {
    fn take(&mut self, row: &Reading, part: Part) {
        if part.contains(row) {
            let first_s = self.first_and_last_s.map_or(row.t_trace_s, |(first_s, _)| first_s);
            self.first_and_last_s = Some((first_s, row.t_trace_s));
        }
    }
}

/// Rows in their order.
#[derive(Debug)]
pub(super) enum Rows {
    /// Of a trace in memory.
    Memory { rows: Vec<Reading>, next: usize },
    /// Of a recording.
    File { path: PathBuf, topic: Option<String>, part: Part, rows: Option<Box<recorded::Rows>> },
}

impl Rows {
    /// Reads a trace or a recording once, from start to end, so that what is wrong is known now.
    pub(super) fn open(
        path: &Path,
        topic: Option<&str>,
        part: Part,
        inputs: &InputNames,
    ) -> Result<(Self, About), Vec<TraceError>> {
        let is_recording = recorded::is_recording(path)
            .map_err(|error| vec![TraceError::Unreadable { cause: error.to_string() }])?;
        let mut about = About::default();
        if !is_recording {
            let Trace { mut rows, period_s, gaps } = Trace::read_named(path, None, inputs)?;
            rows.iter().for_each(|row| about.take(row, part));
            rows.retain(|row| part.contains(row));
            return Ok((Self::Memory { rows, next: 0 }, About { period_s, gaps, ..about }));
        }
        let mut survey = Survey::default();
        let mut rows = recorded::Rows::open(path, topic).map_err(|error| vec![error])?;
        while let Some(row) = rows.next_row().map_err(|error| vec![error])? {
            survey.take(row.t_trace_s);
            about.take(&row, part);
        }
        rows.check_topics().map_err(|error| vec![error])?;
        let (period_s, gaps) = survey.finish();
        let mut rows =
            Self::File { path: path.to_owned(), topic: topic.map(str::to_owned), part, rows: None };
        rows.restart();
        Ok((rows, About { period_s, gaps, ..about }))
    }

    /// Begins again with the first row.
    pub(super) fn restart(&mut self) {
        match self {
            Self::Memory { next, .. } => *next = 0,
            // A recording that is gone by now has no more rows.
            Self::File { path, topic, rows, .. } => {
                *rows = recorded::Rows::open(path, topic.as_deref()).ok().map(Box::new);
            }
        }
    }
}

impl Iterator for Rows {
    type Item = Reading;

    fn next(&mut self) -> Option<Reading> {
        match self {
            Self::Memory { rows, next } => {
                let row = rows.get(*next).copied();
                *next += 1;
                row
            }
            Self::File { part, rows, .. } => loop {
                // What is damaged was reported when the recording was read first; it ends there.
                let row = rows.as_mut()?.next_row().ok().flatten()?;
                if part.contains(&row) {
                    return Some(row);
                }
            },
        }
    }
}
