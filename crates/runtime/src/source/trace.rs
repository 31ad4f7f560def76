//! Recorded traces: CSV with a header, `t_s,pressure_mpa[,gap_mm][,measured_force_n][,marker1_x_mm,marker1_y_mm,marker1_z_mm]...`,
//! comment lines begin with `#`.
//!
//! A trace is read as a whole before anything is sent: an invalid cell in line 900 is reported at the start, not after 4.5 s.
//! Recordings (MCAP) are traces as well, see `recorded`. Where a scene calls model inputs measured (`load_n`), each is a column of its name, and
//! a pressure is needed no more.
//!
//! `nan` and `inf` are values (gauges send them); any other cell must be a number.

use super::reading::{InputNames, MARKERS, QUANTITIES, value_mut};
use super::recorded::{self, TraceError};
use crate::file;
use formats::log::Mapping;
use formats::table::{Table, TableRow};
use formats::{Diagnostic, FormatError, collect, unit};
use rom::statistics::median;
use std::path::Path;
use wire::SensorSample;

/// A trace in memory.
#[derive(Debug, Clone, PartialEq)]
pub struct SensorTrace {
    /// Readings in order of their time in the trace; at least one.
    pub rows: Vec<SensorSample>,
    /// Median time between rows (of the first 65,537), s; 0 for a single row.
    pub period_s: f64,
    /// Places where time jumps by more than 5 periods: (line, seconds); at most 1000.
    pub gaps: Vec<(usize, f64)>,
}

/// Multiple of the median period beyond which a jump is reported as a gap in time.
const GAP_FACTOR: f64 = 5.0;

/// Problems that are listed: a wrong file would give thousands.
const MAX_PROBLEMS: usize = 20;

/// Where the columns are; a missing optional column gives NaN.
struct Columns {
    t_s: usize,
    pressure_mpa: Option<usize>,
    gap_mm: Option<usize>,
    measured_force_n: Option<usize>,
    /// Columns of marker coordinates.
    markers: Vec<Option<usize>>,
    /// Columns of named inputs.
    inputs: Vec<usize>,
    names: InputNames,
}

/// Names of a marker's columns, by coordinate: `marker1_x_mm`, `marker1_y_mm`, ...
fn marker_columns() -> impl Iterator<Item = &'static str> {
    QUANTITIES.into_iter().skip(MARKERS)
}

impl SensorTrace {
    /// Reads and checks a file: CSV or a recording, recognised by its first bytes.
    ///
    /// # Errors
    /// All problems found, each with its line; at most 20 of them.
    pub fn read(path: &Path) -> Result<Self, Vec<TraceError>> {
        Self::read_named(path, None, &InputNames::default())
    }

    /// The same with the columns of `inputs`; for a recording, which has the inputs that it has, the readings of `topic` where
    /// it holds several sensors.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn read_named(
        path: &Path,
        topic: Option<&str>,
        inputs: &InputNames,
    ) -> Result<Self, Vec<TraceError>> {
        if recorded::is_recording(path).map_err(|error| vec![error])? {
            let rows = recorded::rows(path, topic)?;
            let numbers = (1..=rows.len()).collect();
            return Ok(Self::of_rows(rows, numbers));
        }
        let bytes = file::read_bytes(path, MAX_BYTES);
        let bytes = bytes.map_err(|error| vec![TraceError::unreadable(error.cause())])?;
        if let Some(found) = file::other_than_text(&bytes) {
            let cause = format!("expected a table as text or a recording, found {found}");
            return Err(vec![TraceError::unreadable(cause)]);
        }
        Self::parse_named(String::from_utf8_lossy(&bytes), inputs)
    }

    /// Reads a table of a bench with the mapping of its columns (`log.toml`): the mapping's quantities are the columns of the trace.
    /// Remarks on the table are logged.
    ///
    /// # Errors
    /// All errors in the mapping or in the table; columns of `inputs` that the mapping lacks.
    pub fn read_log(path: &Path, mapping: &Path, inputs: &InputNames) -> Result<Self, Vec<TraceError>> {
        let unreadable = |error: FormatError| vec![TraceError::unreadable(error)];
        let mapping = Mapping::read(mapping).map_err(unreadable)?;
        let recording = mapping.read_run(path).map_err(unreadable)?;
        for remark in &recording.remarks {
            tracing::warn!("{}: {remark}", path.display());
        }
        Self::parse_named(recording.csv(), inputs)
    }

    /// Parses a trace's text.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn parse(text: &str) -> Result<Self, Vec<TraceError>> {
        Self::parse_named(text, &InputNames::default())
    }

    /// The same with the columns of `inputs`.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn parse_named(text: impl Into<String>, inputs: &InputNames) -> Result<Self, Vec<TraceError>> {
        let table = Table::parse(text, true).map_err(|wrong| vec![TraceError::Table(wrong)])?;
        let all = |wrong: Vec<Diagnostic>| {
            wrong.into_iter().take(MAX_PROBLEMS).map(TraceError::Table).collect::<Vec<_>>()
        };
        let columns = Columns::find(&table, inputs).map_err(all)?;
        let mut problems = Vec::new();
        let mut rows: Vec<SensorSample> = Vec::new();
        let mut line_of = Vec::new();
        for row in table.rows() {
            let before_s = rows.last().map_or(f64::NEG_INFINITY, |row| row.t_trace_s);
            let Some(sample) = collect(columns.sample(&row, before_s), &mut problems) else { continue };
            rows.push(sample);
            line_of.push(row.line);
            if problems.len() >= MAX_PROBLEMS {
                break;
            }
        }
        match (problems.is_empty(), rows.is_empty()) {
            (false, _) => Err(all(problems)),
            (true, true) => Err(vec![TraceError::Empty]),
            (true, false) => Ok(Self::of_rows(rows, line_of)),
        }
    }

    /// Adds what is known about time as a whole.
    fn of_rows(rows: Vec<SensorSample>, line_of: Vec<usize>) -> Self {
        let mut survey = Survey::default();
        rows.iter().for_each(|row| survey.take(row.t_trace_s));
        let (period_s, gaps) = survey.finish();
        // Rows are counted without comments and header.
        let line = |row: usize| line_of.get(row - 1).copied().unwrap_or(row);
        let gaps = gaps.into_iter().map(|(row, seconds)| (line(row), seconds)).collect();
        Self { rows, period_s, gaps }
    }
}

/// Steps from which the median period is taken.
const MAX_STEPS: usize = 1 << 16;
/// Most gaps that are listed.
const MAX_GAPS: usize = 1000;

/// Period and gaps of a trace whose times come one by one. Memory is bounded, whatever its length.
#[derive(Debug, Default)]
pub(super) struct Survey {
    rows: usize,
    last_s: f64,
    /// The first steps, s.
    steps: Vec<f64>,
    /// Later steps that are gaps: number of the row behind it, seconds.
    later: Vec<(usize, f64)>,
    period_s: Option<f64>,
}

impl Survey {
    /// The time of the next row, s.
    pub(super) fn take(&mut self, t_s: f64) {
        let step_s = t_s - self.last_s;
        self.last_s = t_s;
        self.rows += 1;
        if self.rows == 1 {
            return;
        }
        if self.steps.len() < MAX_STEPS {
            return self.steps.push(step_s);
        }
        let period_s = *self.period_s.get_or_insert_with(|| median_s(&self.steps));
        if is_gap(step_s, period_s) && self.later.len() < MAX_GAPS {
            self.later.push((self.rows, step_s));
        }
    }

    /// Median step, s, and gaps as (number of the row behind it, from 1; seconds).
    pub(super) fn finish(self) -> (f64, Vec<(usize, f64)>) {
        let period_s = self.period_s.unwrap_or_else(|| median_s(&self.steps));
        let early = (2..).zip(self.steps.iter().copied()).filter(|(_, step_s)| is_gap(*step_s, period_s));
        (period_s, early.chain(self.later.iter().copied()).take(MAX_GAPS).collect())
    }
}

fn median_s(steps: &[f64]) -> f64 {
    median(steps.iter().copied()).unwrap_or(0.0)
}

fn is_gap(step_s: f64, period_s: f64) -> bool {
    period_s > 0.0 && step_s > GAP_FACTOR * period_s
}

/// The column that is read, for one of the same quantity in another unit (`pressure_kpa`, `gap`): its values would be taken for
/// absent or for a model's input.
pub fn in_another_unit(column: &str) -> Option<&'static str> {
    use unit::Dimension::{Force, Length, Pressure};
    let is_unit = |text: &str| {
        unit::unit(text).is_some_and(|(quantity, _)| matches!(quantity, Pressure | Length | Force))
    };
    let mut known = ["pressure_mpa", "gap_mm", "measured_force_n"].into_iter().chain(marker_columns());
    let stem = |name: &str| {
        let lower = name.to_ascii_lowercase();
        let cut = lower.rsplit_once('_').filter(|(_, unit)| is_unit(unit)).map(|(stem, _)| stem.to_owned());
        cut.unwrap_or(lower)
    };
    known.find(|known| *known != column && stem(known) == stem(column))
}

impl Columns {
    fn find(table: &Table, names: &InputNames) -> Result<Self, Vec<Diagnostic>> {
        let header = table.header();
        let place = |name: &str| header.iter().position(|column| column == name);
        let needed = (["t_s"].into_iter().chain(names.iter()))
            .chain(names.has_no_input().then_some("pressure_mpa"))
            .filter_map(|name| table.column(name).err());
        let in_another_unit = header.iter().filter_map(|column| {
            let expected = in_another_unit(column).filter(|_| !names.iter().any(|name| name == column))?;
            let expected = format!("the column `{expected}`; convert its values and name it so");
            Some(Diagnostic::new("header", expected, format!("`{column}`")))
        });
        let problems: Vec<Diagnostic> = needed.chain(in_another_unit).collect();
        match (place("t_s"), problems.is_empty()) {
            (Some(t_s), true) => Ok(Self {
                t_s,
                pressure_mpa: place("pressure_mpa"),
                gap_mm: place("gap_mm"),
                measured_force_n: place("measured_force_n"),
                markers: marker_columns().map(place).collect(),
                inputs: names.iter().filter_map(place).collect(),
                names: names.clone(),
            }),
            _ => Err(problems),
        }
    }

    fn sample(&self, row: &TableRow<'_>, before_s: f64) -> Result<SensorSample, Diagnostic> {
        let optional = |place: Option<usize>| place.map_or(Ok(f64::NAN), |place| row.any_number(place));
        // A marker that was not seen, or an angle that was not found, leaves its cells empty.
        let or_nan =
            |place: usize| if row.text(place).is_empty() { Ok(f64::NAN) } else { row.any_number(place) };
        let mut sample = SensorSample {
            t_trace_s: row.any_number(self.t_s)?,
            pressure_mpa: optional(self.pressure_mpa)?,
            gap_mm: optional(self.gap_mm)?,
            measured_force_n: optional(self.measured_force_n)?,
            ..self.names.sample()
        };
        for (slot, column) in (MARKERS..).zip(&self.markers) {
            let Some(place) = *column else { continue };
            if let Some(value) = value_mut(&mut sample, slot) {
                *value = or_nan(place)?;
            }
            sample.marker_values = 3 * ((slot - MARKERS) as u32 / 3) + 3;
        }
        for (index, (value, place)) in sample.inputs.iter_mut().zip(&self.inputs).enumerate() {
            *value = if self.names.is_optional(index) { or_nan(*place)? } else { row.any_number(*place)? };
        }
        if !sample.t_trace_s.is_finite() || sample.t_trace_s < before_s {
            return Err(row.diagnostic(
                self.t_s,
                &format!("a finite time, not before {before_s} s, that of the row above"),
            ));
        }
        Ok(sample)
    }
}

/// Largest accepted file: a day at 200 Hz is 430 MB, and that belongs into a recording.
const MAX_BYTES: u64 = 1 << 29;
