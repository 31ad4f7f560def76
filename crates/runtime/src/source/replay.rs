//! Replays a recorded trace with its original timing, faster, slower, in part or repeatedly.

use super::named::InputNames;
use super::reading::{Reading, Scheduled, Source};
use super::replay_rows::{About, Part, Rows};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// What to replay and how.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ReplaySpec {
    /// The trace, CSV or a recording; a relative path is taken from the scene file's folder.
    pub trace: PathBuf,
    /// Which sensor topic of a recording; needed when it holds several.
    pub topic: Option<String>,
    /// Factor on the speed: 2 sends twice as fast.
    pub speed: f64,
    /// Begin again at the end, without end.
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
        if !(self.speed.is_finite() && self.speed > 0.0) {
            problems.push(format!("source.speed: expected a finite number above 0, found {}", self.speed));
        }
        let path = folder.join(&self.trace);
        if self.trace.as_os_str().is_empty() {
            problems.push("source.trace: expected a file, found nothing".into());
            return Err(problems);
        }
        let part = Part { from_s: self.from_s, to_s: self.to_s };
        match Rows::open(&path, self.topic.as_deref(), part, inputs) {
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
        Some(Reading { due_s: elapsed_s / self.speed, ..row })
    }
}
