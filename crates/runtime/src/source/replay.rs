//! Replays a recorded trace with its original timing, faster, slower, in part or repeatedly.

use super::reading::{InputNames, Reading, Scheduled, Source};
use super::recorded::{self, TraceError};
use super::trace::{SensorTrace, Survey};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use wire::SensorSample;

/// Settings of a replay.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ReplaySpec {
    /// The trace, CSV or a recording; a relative path is taken from the scene file's folder.
    pub trace: PathBuf,
    /// Mapping of the columns of a bench's table (`log.toml`); a relative path is taken from the scene file's folder.
    pub log: Option<PathBuf>,
    /// Which sensor topic of a recording; needed when it holds several.
    pub topic: Option<String>,
    /// Factor on the speed: 2 sends twice as fast.
    pub speed: f64,
    /// Repeat until stopped.
    #[serde(rename = "loop")]
    pub repeat: bool,
    /// Skip what lies before this time of the trace, s.
    pub from_s: f64,
    /// Skip what lies after this time of the trace, s.
    pub to_s: f64,
}

impl Default for ReplaySpec {
    fn default() -> Self {
        Self {
            trace: PathBuf::new(),
            log: None,
            topic: None,
            speed: 1.0,
            repeat: false,
            from_s: f64::NEG_INFINITY,
            to_s: f64::INFINITY,
        }
    }
}

impl ReplaySpec {
    /// Reads the trace and keeps the part that was asked for. Gaps in time are logged now, not when they come.
    ///
    /// # Errors
    /// All problems of the specification and of the file.
    pub(super) fn open(&self, folder: &Path, inputs: &InputNames) -> Result<Box<dyn Source>, Vec<String>> {
        let mut problems = Vec::new();
        if !(1e-6..=1e6).contains(&self.speed) {
            problems.push(format!("source.speed: expected 0.000001 to 1000000, found {}", self.speed));
        }
        let path = folder.join(&self.trace);
        if self.trace.as_os_str().is_empty() {
            problems.push("source.trace: expected a file, found nothing".into());
            return Err(problems);
        }
        let part = Part { from_s: self.from_s, to_s: self.to_s };
        let opened = match &self.log {
            Some(log) => {
                SensorTrace::read_log(&path, &folder.join(log), inputs).map(|trace| Rows::of(trace, part))
            }
            None => Rows::open(&path, self.topic.as_deref(), part, inputs),
        };
        match opened {
            Ok((rows, about)) => match Replay::new(self, rows, &about) {
                Some(replay) if problems.is_empty() => {
                    for (line, seconds) in about.gaps {
                        let trace = path.display();
                        tracing::warn!("the trace has a gap of {seconds:.3} s before line {line} ({trace})");
                    }
                    return Ok(Box::new(Scheduled::new(replay)));
                }
                Some(_) => {}
                None => problems.push(format!(
                    "source.from_s, source.to_s: no row of the trace lies within {} .. {} s ({})",
                    self.from_s,
                    self.to_s,
                    path.display()
                )),
            },
            Err(errors) => problems.extend(
                errors.into_iter().map(|error| format!("source.trace: {error} ({})", path.display())),
            ),
        }
        Err(problems)
    }
}

/// The rows of a trace that are still to come.
#[derive(Debug)]
struct Replay {
    rows: Rows,
    speed: f64,
    repeat: bool,
    /// Time of the trace that is second 0 of the replay.
    begin_s: f64,
    /// Length of one round, s of the trace, one period after the last row included.
    round_s: f64,
    rounds: u32,
}

impl Replay {
    /// `None` when no row is left.
    fn new(spec: &ReplaySpec, rows: Rows, about: &About) -> Option<Self> {
        let (first_s, last_s) = about.first_and_last_s?;
        // A single row would otherwise repeat without any time between.
        let period_s = if about.period_s > 0.0 { about.period_s } else { 1.0 };
        let round_s = last_s - first_s + period_s;
        Some(Self { rows, speed: spec.speed, repeat: spec.repeat, begin_s: first_s, round_s, rounds: 0 })
    }
}

impl Iterator for Replay {
    type Item = Reading;

    /// The next row; at the end the first again when repeating.
    fn next(&mut self) -> Option<Reading> {
        let row = match self.rows.next() {
            None if self.repeat => {
                self.rounds += 1;
                self.rows.restart();
                self.rows.next()?
            }
            row => row?,
        };
        let elapsed_s = row.t_trace_s - self.begin_s + f64::from(self.rounds) * self.round_s;
        Some(Reading { sample: row, due_s: elapsed_s / self.speed })
    }
}

/// The part of a trace that is replayed, s of its time.
#[derive(Debug, Clone, Copy)]
struct Part {
    from_s: f64,
    to_s: f64,
}

impl Part {
    fn contains(self, row: &SensorSample) -> bool {
        row.t_trace_s >= self.from_s && row.t_trace_s <= self.to_s
    }
}

/// Properties of a trace before its replay.
#[derive(Debug, Default)]
struct About {
    /// Median time between rows, s; 0 for a single row.
    period_s: f64,
    /// Places where time jumps: (line, seconds).
    gaps: Vec<(usize, f64)>,
    /// Times of the first and the last row of the part.
    first_and_last_s: Option<(f64, f64)>,
}

impl About {
    fn take(&mut self, row: &SensorSample, part: Part) {
        if part.contains(row) {
            let first_s = self.first_and_last_s.map_or(row.t_trace_s, |(first_s, _)| first_s);
            self.first_and_last_s = Some((first_s, row.t_trace_s));
        }
    }
}

/// Rows in their order.
#[derive(Debug)]
enum Rows {
    /// Trace in memory.
    Memory {
        rows: Vec<SensorSample>,
        next: usize,
    },
    File {
        path: PathBuf,
        topic: Option<String>,
        part: Part,
        rows: Option<Box<recorded::Rows>>,
    },
}

impl Rows {
    /// The part of a trace in memory.
    fn of(trace: SensorTrace, part: Part) -> (Self, About) {
        let SensorTrace { mut rows, period_s, gaps } = trace;
        let mut about = About { period_s, gaps, ..About::default() };
        rows.iter().for_each(|row| about.take(row, part));
        rows.retain(|row| part.contains(row));
        (Self::Memory { rows, next: 0 }, about)
    }

    /// Reads a trace or a recording once, from start to end, so that what is wrong is known now.
    fn open(
        path: &Path,
        topic: Option<&str>,
        part: Part,
        inputs: &InputNames,
    ) -> Result<(Self, About), Vec<TraceError>> {
        let is_recording = recorded::is_recording(path).map_err(|error| vec![error])?;
        let mut about = About::default();
        if !is_recording {
            return Ok(Self::of(SensorTrace::read_named(path, None, inputs)?, part));
        }
        let mut survey = Survey::default();
        let mut rows = recorded::Rows::open(path, topic).map_err(|error| vec![error])?;
        while let Some(row) = rows.next_row().map_err(|error| vec![error])? {
            survey.take(row.t_trace_s);
            about.take(&row, part);
        }
        rows.check_topics().map_err(|error| vec![error])?;
        rows.left_out().warn(path);
        let (period_s, gaps) = survey.finish();
        let mut rows =
            Self::File { path: path.to_owned(), topic: topic.map(str::to_owned), part, rows: None };
        rows.restart();
        Ok((rows, About { period_s, gaps, ..about }))
    }

    /// Begins again with the first row.
    fn restart(&mut self) {
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
    type Item = SensorSample;

    fn next(&mut self) -> Option<SensorSample> {
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
