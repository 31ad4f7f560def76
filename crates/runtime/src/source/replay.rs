//! Replays a recorded trace with its original timing, faster, slower, in part or repeatedly.

use super::reading::{Reading, Scheduled, Source};
use super::trace::Trace;
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
    pub(super) fn open(&self, folder: &Path) -> Result<Box<dyn Source>, Vec<String>> {
        let mut problems = Vec::new();
        if !(self.speed.is_finite() && self.speed > 0.0) {
            problems.push(format!("source.speed: expected a finite number above 0, found {}", self.speed));
        }
        let path = folder.join(&self.trace);
        if self.trace.as_os_str().is_empty() {
            problems.push("source.trace: expected a file, found nothing".into());
            return Err(problems);
        }
        match Trace::read_topic(&path, self.topic.as_deref()) {
            Ok(trace) => {
                let gaps = trace.gaps.clone();
                match Replay::new(self, trace) {
                    Some(replay) if problems.is_empty() => {
                        for (line, seconds) in gaps {
                            let trace = path.display();
                            tracing::warn!(
                                "the trace has a gap of {seconds:.3} s before line {line} ({trace})"
                            );
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
                }
            }
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
    rows: Vec<Reading>,
    speed: f64,
    repeat: bool,
    /// Time of the trace that is second 0 of the replay.
    begin_s: f64,
    /// Length of one round, s of the trace, one period after the last row included.
    round_s: f64,
    next: usize,
    rounds: u32,
}

impl Replay {
    /// `None` when no row is left.
    fn new(spec: &ReplaySpec, mut trace: Trace) -> Option<Self> {
        trace.rows.retain(|row| row.t_trace_s >= spec.from_s && row.t_trace_s <= spec.to_s);
        let (first, last) = (trace.rows.first()?.t_trace_s, trace.rows.last()?.t_trace_s);
        // A single row would otherwise repeat without any time between.
        let period_s = if trace.period_s > 0.0 { trace.period_s } else { 1.0 };
        Some(Self {
            rows: trace.rows,
            speed: spec.speed,
            repeat: spec.repeat,
            begin_s: first,
            round_s: last - first + period_s,
            next: 0,
            rounds: 0,
        })
    }
}

impl Iterator for Replay {
    type Item = Reading;

    /// The next row; at the end the first again when repeating.
    fn next(&mut self) -> Option<Reading> {
        if self.next >= self.rows.len() && self.repeat {
            self.next = 0;
            self.rounds += 1;
        }
        let row = *self.rows.get(self.next)?;
        self.next += 1;
        let elapsed_s = row.t_trace_s - self.begin_s + f64::from(self.rounds) * self.round_s;
        Some(Reading { due_s: elapsed_s / self.speed, ..row })
    }
}
