//! Replays a recorded trace with its original timing, faster, slower, in part or for ever.

use super::{Reading, Trace, require_above};
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
    /// Begin again at the end, for ever.
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

/// A trace on its way.
#[derive(Debug)]
pub struct Replay {
    trace: Trace,
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
    /// Reads the trace and keeps the part that was asked for.
    ///
    /// # Errors
    /// All problems of the specification and of the file.
    pub fn open(spec: &ReplaySpec, folder: &Path) -> Result<Self, Vec<String>> {
        let mut problems = Vec::new();
        require_above(&mut problems, "speed", spec.speed, 0.0);
        if spec.trace.as_os_str().is_empty() {
            problems.push("source.trace: expected a file, found nothing".into());
            return Err(problems);
        }
        let path = folder.join(&spec.trace);
        let trace = match Trace::read_topic(&path, spec.topic.as_deref()) {
            Ok(trace) => trace,
            Err(errors) => {
                problems.extend(
                    errors.into_iter().map(|error| format!("source.trace: {error} ({})", path.display())),
                );
                return Err(problems);
            }
        };
        match Self::of(spec, trace) {
            Some(replay) if problems.is_empty() => Ok(replay),
            Some(_) => Err(problems),
            None => {
                problems.push(format!(
                    "source.from_s, source.to_s: no row of the trace lies within {} .. {} s ({})",
                    spec.from_s,
                    spec.to_s,
                    path.display()
                ));
                Err(problems)
            }
        }
    }

    /// `None` when no row is left.
    fn of(spec: &ReplaySpec, mut trace: Trace) -> Option<Self> {
        trace.rows.retain(|row| row.t_s >= spec.from_s && row.t_s <= spec.to_s);
        let (first, last) = (trace.rows.first()?.t_s, trace.rows.last()?.t_s);
        // A single row would otherwise repeat without any time between.
        let period_s = if trace.period_s > 0.0 { trace.period_s } else { 1.0 };
        Some(Self {
            speed: spec.speed,
            repeat: spec.repeat,
            begin_s: first,
            round_s: last - first + period_s,
            trace,
            next: 0,
            rounds: 0,
        })
    }

    /// Gaps in time of the whole trace: (line, seconds).
    pub fn gaps(&self) -> &[(usize, f64)] {
        &self.trace.gaps
    }

    /// The next row; at the end the first again when looping.
    pub fn next_reading(&mut self) -> Option<Reading> {
        if self.next >= self.trace.rows.len() && self.repeat {
            self.next = 0;
            self.rounds += 1;
        }
        let row = self.trace.rows.get(self.next)?;
        self.next += 1;
        let elapsed_s = row.t_s - self.begin_s + f64::from(self.rounds) * self.round_s;
        Some(Reading {
            due_s: elapsed_s / self.speed,
            t_trace_s: row.t_s,
            pressure_mpa: row.pressure_mpa,
            gap_mm: row.gap_mm,
            measured_force_n: row.measured_force_n,
            status: row.status,
        })
    }
}
