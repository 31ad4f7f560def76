//! Recorded traces: CSV with a header, `t_s,pressure_mpa[,gap_mm][,measured_force_n]`, comment lines begin with `#`.
//!
//! A trace is read as a whole before anything is sent: a stray text in line 900 is said at start, not after 4.5 s.
//! Recordings (MCAP) are traces as well, see `recorded`.
//!
//! `nan` and `inf` are values (gauges say such things); text that is no number is an error.

use super::recorded;
use std::path::Path;

/// One line of a trace.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TraceRow {
    /// Time, s, never before the row above.
    pub t_s: f64,
    /// Gauge pressure, MPa.
    pub pressure_mpa: f64,
    /// Gap, mm; NaN when the trace has no such column.
    pub gap_mm: f64,
    /// Measured contact force, N; NaN when the trace has no such column.
    pub measured_force_n: f64,
    /// The sensor's own fault code, 0: good; CSV has none.
    pub status: u32,
}

/// A trace in memory.
#[derive(Debug, Clone, PartialEq)]
pub struct Trace {
    /// Rows in order of time; at least one.
    pub rows: Vec<TraceRow>,
    /// Median time between rows, s; 0 for a single row.
    pub period_s: f64,
    /// Places where time jumps by more than [`GAP_FACTOR`] periods: (line, seconds).
    pub gaps: Vec<(usize, f64)>,
}

/// A jump of more than so many median periods is reported as a gap in time.
pub const GAP_FACTOR: f64 = 5.0;
/// Largest accepted file: a day at 200 Hz is 430 MB, and that belongs into a recording.
pub const MAX_BYTES: u64 = 1 << 29;

/// What is wrong with a trace.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TraceError {
    /// The file could not be read.
    #[error("cannot read the trace: {cause}")]
    Unreadable {
        /// The system's word for it.
        cause: String,
    },
    /// Too large.
    #[error("the trace has {found} bytes; expected at most {MAX_BYTES}: cut it, or record it as a recording")]
    TooLarge {
        /// Bytes found.
        found: u64,
    },
    /// No header or no rows.
    #[error(
        "the trace has no {what}; expected the header `t_s,pressure_mpa,gap_mm` and at least one row, or a recording with readings"
    )]
    Empty {
        /// `header`, `rows` or `readings`.
        what: &'static str,
    },
    /// A required column is missing.
    #[error(
        "line {line}: the column `{column}` is missing; expected `t_s,pressure_mpa,gap_mm`, found `{found}`"
    )]
    MissingColumn {
        /// Line of the header.
        line: usize,
        /// The column.
        column: &'static str,
        /// The header as found.
        found: String,
    },
    /// A cell that is no number.
    #[error("line {line}, column `{column}`: expected a number, found `{found}`")]
    NotANumber {
        /// Line.
        line: usize,
        /// Column.
        column: &'static str,
        /// The text.
        found: String,
    },
    /// A message of a recording that is no reading.
    #[error("reading {number} of the recording cannot be read: {cause}")]
    NotAReading {
        /// Which reading, from 1.
        number: usize,
        /// What is wrong with it.
        cause: String,
    },
    /// A recording of several actuators.
    #[error("the recording has several sensors ({found}); say which with `topic`")]
    SeveralTopics {
        /// Their topics.
        found: String,
    },
    /// The topic that was asked for is not there.
    #[error("the recording has no readings on `{topic}`; found: {found}")]
    NoSuchTopic {
        /// Asked for.
        topic: String,
        /// What there is.
        found: String,
    },
    /// More than fits into memory.
    #[error(
        "the recording has more than {limit} readings; record with --rotate-minutes and replay the part you need"
    )]
    TooManyRows {
        /// The limit.
        limit: usize,
    },
    /// Time is not finite or runs backwards.
    #[error("line {line}: time goes from {before} s to {found} s; expected rows in order of time")]
    TimeOrder {
        /// Line.
        line: usize,
        /// Time of the row above.
        before: f64,
        /// Time found.
        found: f64,
    },
}

/// Where the columns are; a missing optional column gives NaN.
struct Columns {
    t_s: usize,
    pressure_mpa: usize,
    gap_mm: Option<usize>,
    measured_force_n: Option<usize>,
}

impl Trace {
    /// Reads and checks a file: CSV or a recording, told apart by its first bytes.
    ///
    /// # Errors
    /// All problems found, each with its line (at most 20 of them: a wrong file would give thousands).
    pub fn read(path: &Path) -> Result<Self, Vec<TraceError>> {
        Self::read_topic(path, None)
    }

    /// The same for a recording that holds several sensors: the readings of `topic`.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn read_topic(path: &Path, topic: Option<&str>) -> Result<Self, Vec<TraceError>> {
        if recorded::is_recording(path) {
            let rows = recorded::rows(path, topic)?;
            let numbers = (1..=rows.len()).collect();
            return Ok(Self::of_rows(rows, numbers));
        }
        let unreadable = |error: std::io::Error| vec![TraceError::Unreadable { cause: error.to_string() }];
        let length = std::fs::metadata(path).map_err(unreadable)?.len();
        if length > MAX_BYTES {
            return Err(vec![TraceError::TooLarge { found: length }]);
        }
        let bytes = std::fs::read(path).map_err(unreadable)?;
        Self::parse(&String::from_utf8_lossy(&bytes))
    }

    /// Parses a trace's text.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn parse(text: &str) -> Result<Self, Vec<TraceError>> {
        let mut lines = text
            .trim_start_matches('\u{feff}')
            .lines()
            .enumerate()
            .map(|(index, line)| (index + 1, line.trim()))
            .filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
        let (header_line, header) = lines.next().ok_or_else(|| vec![TraceError::Empty { what: "header" }])?;
        let columns = Columns::find(header_line, header)?;
        let mut problems = Vec::new();
        let mut rows: Vec<TraceRow> = Vec::new();
        let mut line_of = Vec::new();
        for (line, text) in lines {
            match columns.row(line, text, rows.last().map(|row| row.t_s)) {
                Ok(row) => {
                    rows.push(row);
                    line_of.push(line);
                }
                Err(problem) => problems.push(problem),
            }
            if problems.len() >= 20 {
                break;
            }
        }
        if rows.is_empty() && problems.is_empty() {
            problems.push(TraceError::Empty { what: "rows" });
        }
        if !problems.is_empty() {
            return Err(problems);
        }
        Ok(Self::of_rows(rows, line_of))
    }

    /// Adds what is known about time as a whole.
    fn of_rows(rows: Vec<TraceRow>, line_of: Vec<usize>) -> Self {
        let period_s = median_period(&rows);
        let gaps = rows
            .windows(2)
            .zip(line_of.iter().skip(1))
            .filter_map(|(pair, line)| match pair {
                [a, b] if period_s > 0.0 && b.t_s - a.t_s > GAP_FACTOR * period_s => {
                    Some((*line, b.t_s - a.t_s))
                }
                _ => None,
            })
            .collect();
        Self { rows, period_s, gaps }
    }
}

impl Columns {
    fn find(line: usize, header: &str) -> Result<Self, Vec<TraceError>> {
        let place = |name: &str| header.split(',').position(|column| column.trim() == name);
        let required = |column: &'static str| {
            place(column).ok_or_else(|| TraceError::MissingColumn {
                line,
                column,
                found: header.chars().take(80).collect(),
            })
        };
        match (required("t_s"), required("pressure_mpa")) {
            (Ok(t_s), Ok(pressure_mpa)) => Ok(Self {
                t_s,
                pressure_mpa,
                gap_mm: place("gap_mm"),
                measured_force_n: place("measured_force_n"),
            }),
            (t_s, pressure) => Err([t_s.err(), pressure.err()].into_iter().flatten().collect()),
        }
    }

    fn row(&self, line: usize, text: &str, before: Option<f64>) -> Result<TraceRow, TraceError> {
        let cell = |column: &'static str, place: usize| {
            let found = text.split(',').nth(place).unwrap_or("").trim();
            found.parse::<f64>().map_err(|_| TraceError::NotANumber {
                line,
                column,
                found: found.chars().take(40).collect(),
            })
        };
        let optional = |column, place: Option<usize>| place.map_or(Ok(f64::NAN), |place| cell(column, place));
        let row = TraceRow {
            t_s: cell("t_s", self.t_s)?,
            pressure_mpa: cell("pressure_mpa", self.pressure_mpa)?,
            gap_mm: optional("gap_mm", self.gap_mm)?,
            measured_force_n: optional("measured_force_n", self.measured_force_n)?,
            status: 0,
        };
        let before = before.unwrap_or(f64::NEG_INFINITY);
        if !row.t_s.is_finite() || row.t_s < before {
            return Err(TraceError::TimeOrder { line, before, found: row.t_s });
        }
        Ok(row)
    }
}

fn median_period(rows: &[TraceRow]) -> f64 {
    let mut steps: Vec<f64> = rows
        .windows(2)
        .filter_map(|pair| match pair {
            [a, b] => Some(b.t_s - a.t_s),
            _ => None,
        })
        .collect();
    steps.sort_by(f64::total_cmp);
    steps.get(steps.len() / 2).copied().unwrap_or(0.0)
}
