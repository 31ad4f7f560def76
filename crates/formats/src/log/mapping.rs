//! Mapping of a log's columns to quantities, and the log as quantities.

use super::Log;
use super::clock;
use super::{LogColumn, Recording};
use crate::error::{Diagnostic, FormatError, collect};
use crate::file;
use crate::table::TableForm;
use crate::unit::{self, Dimension};
use rom::snapshots::{AXES, marker_axis};
use rom::statistics::{ends, median, range};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Content of `log.toml`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mapping {
    /// What the tables leave open.
    #[serde(default)]
    pub table: TableForm,
    /// Time of the rows.
    pub time: TimeColumn,
    /// Inputs of a model.
    #[serde(default)]
    pub input: Vec<Channel>,
    #[serde(default)]
    pub output: Vec<Channel>,
    /// Frame of markers in the model's frame; applied to outputs `NAME_x_mm`, `NAME_y_mm`, `NAME_z_mm`.
    pub frame: Option<Frame>,
    /// Further files of a run, with their clocks.
    #[serde(default)]
    pub file: Vec<Further>,
}

/// A further file of a run (`run.csv+camera.csv`).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Further {
    /// Time of its rows.
    pub time: TimeColumn,
    /// Added to its times, s; default: estimated by correlation.
    pub offset_s: Option<f64>,
    /// Inputs of a model.
    #[serde(default)]
    pub input: Vec<Channel>,
    #[serde(default)]
    pub output: Vec<Channel>,
}

/// Column by number, counted from 1, or by its heading.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Column {
    /// Number, counted from 1.
    Number(usize),
    /// Heading, whole, in any case.
    Heading(String),
}

/// Time of the rows: a column with a unit (ISO 8601 and clocks: `s`) or, of frames that are counted, a rate; or a rate alone.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TimeColumn {
    pub column: Option<Column>,
    /// `s`, `ms`, `us`, `ns`, `min`, `h`, `d`.
    pub unit: Option<String>,
    /// Rows per second of a log without time, or counts of the column per second.
    pub rate_hz: Option<f64>,
}

/// One column as a quantity: `sign (slope v + offset)` in `unit`, converted to the unit at the end of the name.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Channel {
    /// Name with its unit (`pressure_mpa`, `tip_x_mm`, `angle_deg`).
    pub name: String,
    pub column: Column,
    /// Unit of the column, or of `slope v + offset` for counts and volts; `px` with `mm_per_px`.
    pub unit: String,
    /// 1 or -1.
    #[serde(default = "one")]
    pub sign: f64,
    /// Factor on the column's numbers.
    #[serde(default = "one")]
    pub slope: f64,
    /// Added after the factor, in `unit`.
    #[serde(default)]
    pub offset: f64,
    /// The mean over the first seconds is subtracted.
    #[serde(default)]
    pub zero_s: f64,
    /// Size of a pixel, mm.
    pub mm_per_px: Option<f64>,
    /// Column with the confidence of a tracked position, 0 to 1; a value with less than [`LEAST_CONFIDENCE`] is missing.
    pub confidence: Option<Column>,
}

fn one() -> f64 {
    1.0
}

/// Rigid transform `x = rotation x' + origin_mm` from the camera's frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Frame {
    /// Rows of the rotation matrix.
    pub rotation: [[f64; 3]; 3],
    /// Origin of the camera's frame in the model's frame, mm.
    pub origin_mm: [f64; 3],
}

/// Numbers that a setting of a mapping may have: rows per second, seconds, slopes, sizes of a pixel, and offsets in either direction. Beyond
/// them is a wrong unit or a slip of the pen, and times of 0 or infinity follow.
const RATE_HZ: [f64; 2] = [1e-6, 1e9];
const ZERO_S: [f64; 2] = [0.0, 86_400.0];
const OFFSET_S: [f64; 2] = [-1e9, 1e9];
const SLOPE: [f64; 2] = [1e-15, 1e15];
const OFFSET: [f64; 2] = [-1e12, 1e12];
const MM_PER_PX: [f64; 2] = [1e-6, 1e3];
const ORIGIN_MM: [f64; 2] = [-1e6, 1e6];
/// Longest name, in bytes.
const LONGEST_NAME: usize = 64;

fn within(place: impl std::fmt::Display, value: f64, [low, high]: [f64; 2]) -> Result<(), Diagnostic> {
    if (low..=high).contains(&value) {
        return Ok(());
    }
    Err(Diagnostic::new(place, format!("a number from {low:e} to {high:e}"), value))
}

/// A name becomes a column, a variable and a topic: letters, digits, `_`, `-` and `.` within.
fn check_name(name: &str) -> Result<(), Diagnostic> {
    let is_plain = |c: char| c.is_alphanumeric() || "_-.".contains(c);
    if !name.starts_with('.') && name.len() <= LONGEST_NAME && name.chars().all(is_plain) {
        return Ok(());
    }
    let expected = format!("at most {LONGEST_NAME} letters, digits, `_`, `-` and `.`");
    Err(Diagnostic::new("name", expected, format!("{name:?}")))
}

/// Smallest confidence of a tracked position (the trackers' default).
const LEAST_CONFIDENCE: f64 = 0.6;
/// Largest deviation of a rotation matrix from orthonormal.
const RIGID: f64 = 1e-4;
/// Step back in time that is sorted, as a multiple of the median step; a larger one is another run.
const MAX_STEP_BACK: f64 = 20.0;
/// Share of the rows at one extreme value from which a column counts as saturated, and the fewest in a row.
const SATURATED_SHARE: f64 = 0.02;
const SATURATED_RUN: usize = 8;
/// Pressures of soft actuators, MPa; ranges of lengths, mm.
const PLAUSIBLE_MPA: [f64; 2] = [1e-4, 2.0];
const PLAUSIBLE_MM: [f64; 2] = [0.05, 5000.0];
/// Median steps that a marker jumps at least to the zeros of a lost one; times the usual run of equal positions from which it is held; and the part
/// of an input's range by which that moves meanwhile.
const JUMP: f64 = 10.0;
const HELD_RUNS: f64 = 4.0;
const INPUT_MOVES: f64 = 0.02;
/// Gap in time that is remarked, median steps.
const LONG_GAP: f64 = 1000.0;
/// Share of the stamps that step back from which the column is no time.
const UNORDERED: f64 = 1.0 / 3.0;

impl Mapping {
    /// Reads `log.toml`.
    ///
    /// # Errors
    /// I/O error; all errors in the content.
    pub fn read(path: &Path) -> Result<Self, FormatError> {
        let mapping: Self = file::read_toml(path, "[time], [[input]], [[output]] with name, column, unit")?;
        let mut errors = Vec::new();
        let _ = collect(mapping.table.check(), &mut errors);
        let further = mapping.file.iter().flat_map(|file| file.input.iter().chain(&file.output));
        let channels: Vec<&Channel> = mapping.input.iter().chain(&mapping.output).chain(further).collect();
        for channel in &channels {
            let _ = collect(channel.factor(), &mut errors);
        }
        let names: Vec<&String> = channels.iter().map(|c| &c.name).collect();
        if let Some(at) = (0..names.len()).find(|at| names[..*at].contains(&names[*at])) {
            errors.push(Diagnostic::new("name", "each name once", format!("`{}` twice", names[at])));
        }
        for time in std::iter::once(&mapping.time).chain(mapping.file.iter().map(|file| &file.time)) {
            let _ = collect(time.factor(), &mut errors);
        }
        for (index, file) in mapping.file.iter().enumerate() {
            let offset_s = file.offset_s.unwrap_or(0.0);
            let _ = collect(within(format!("file[{index}].offset_s"), offset_s, OFFSET_S), &mut errors);
        }
        for origin_mm in mapping.frame.iter().flat_map(|frame| frame.origin_mm) {
            let _ = collect(within("frame.origin_mm", origin_mm, ORIGIN_MM), &mut errors);
        }
        if let Some(frame) = mapping.frame.as_ref().filter(|frame| !frame.is_rigid()) {
            let expected = "rows of a rotation matrix (orthonormal, determinant 1)";
            errors.push(Diagnostic::new("frame.rotation", expected, format!("{:?}", frame.rotation)));
        }
        FormatError::check(mapping, path, errors)
    }

    /// Reads a run: one table, or as many joined by `+` as the mapping has files (`run/valve.csv+camera.csv`, both in `run`).
    ///
    /// # Errors
    /// As [`Log::read`] and [`Self::apply`]; a number of files that the mapping does not have; clocks that cannot be joined.
    pub fn read_run(&self, run: &Path) -> Result<Recording, FormatError> {
        let text = run.to_string_lossy();
        let is_joined = !self.file.is_empty() && !run.exists();
        let paths: Vec<PathBuf> = match is_joined {
            true => text
                .split('+')
                .enumerate()
                .map(|(index, part)| if index == 0 { part.into() } else { file::named_in(run, part) })
                .collect(),
            false => vec![run.to_owned()],
        };
        if paths.len() != 1 + self.file.len() {
            let expected = format!("{} files of the mapping, joined by `+`", 1 + self.file.len());
            return Err(FormatError::one(run, Diagnostic::new("recording", expected, paths.len())));
        }
        let first = self.apply(&Log::read(&paths[0], &self.table)?, &paths[0])?;
        let mut further = Vec::new();
        for (file, path) in self.file.iter().zip(&paths[1..]) {
            let mapping = Self {
                table: self.table.clone(),
                time: file.time.clone(),
                input: file.input.clone(),
                output: file.output.clone(),
                frame: self.frame.clone(),
                file: Vec::new(),
            };
            further.push((mapping.apply(&Log::read(path, &self.table)?, path)?, file.offset_s));
        }
        clock::join(first, further).map_err(|found| FormatError::one(run, found))
    }

    /// The log as quantities; `path` names it in errors. Further files are left out.
    ///
    /// # Errors
    /// Columns that the log does not have.
    pub fn apply(&self, log: &Log, path: &Path) -> Result<Recording, FormatError> {
        let mut errors = Vec::new();
        let mut remarks: Vec<String> = log.damaged.iter().map(ToString::to_string).take(5).collect();
        if log.damaged.len() > 5 {
            remarks.push(format!("{} damaged lines in all; they are left out", log.damaged.len()));
        }
        remarks.extend(log.remarks.iter().cloned());
        let stamps = collect(self.time.seconds(log), &mut errors).unwrap_or_default();
        remarks.extend(time_remarks(&stamps, &log.lines));
        let rows = collect(in_order(&stamps, &log.lines), &mut errors).unwrap_or_default();
        let time_s: Vec<f64> = rows.iter().map(|row| stamps[*row] - stamps[rows[0]]).collect();
        let lost = self.lost_markers(log, &rows, &mut remarks);
        let mut series = |channels: &[Channel]| -> Vec<LogColumn> {
            let quantity = |channel: &Channel| {
                let mut values = collect(channel.values(log, &rows, &time_s), &mut errors)?;
                if let Some((_, lost)) =
                    lost.iter().find(|(marker, _)| marker_of(&channel.name) == Some(marker.as_str()))
                {
                    lost.iter().for_each(|row| values[*row] = f64::NAN);
                }
                remarks.extend(unwrap(&channel.name, &mut values));
                remarks.extend(value_remarks(&channel.name, &values));
                Some(LogColumn { name: channel.name.clone(), values })
            };
            channels.iter().filter_map(quantity).collect()
        };
        let (mut inputs, mut outputs) = (series(&self.input), series(&self.output));
        clock::interleave(&time_s, &mut inputs, &mut outputs, &mut remarks);
        if let Some(frame) = &self.frame {
            let _ = collect(frame.apply(&mut outputs), &mut errors);
        }
        let start_s = rows.first().map_or(0.0, |row| stamps[*row]);
        FormatError::check(Recording { start_s, time_s, inputs, outputs, remarks }, path, errors)
    }
}

impl Mapping {
    /// By marker of the outputs, the places in `rows` at which it was lost.
    fn lost_markers(
        &self,
        log: &Log,
        rows: &[usize],
        remarks: &mut Vec<String>,
    ) -> Vec<(String, Vec<usize>)> {
        let columns = |channels: &mut dyn Iterator<Item = &Channel>| -> Vec<&[f64]> {
            channels.filter_map(|channel| channel.column.find(log, &channel.name).ok()).collect()
        };
        let inputs = columns(&mut self.input.iter());
        let markers: BTreeSet<&str> =
            self.output.iter().filter_map(|channel| marker_of(&channel.name)).collect();
        let mut all = Vec::new();
        for marker in markers {
            let own = self.output.iter().filter(|channel| marker_of(&channel.name) == Some(marker));
            let coordinates = columns(&mut own.into_iter());
            if coordinates.len() < 2 {
                continue;
            }
            let lost = lost_rows(&coordinates, &inputs, rows);
            if let Some(first) = lost.first() {
                remarks.push(format!(
                    "{marker}: lost in {} rows (all coordinates are 0 or repeat the last position while inputs move), which count as missing, \
                     the first in line {}",
                    lost.len(),
                    log.lines[rows[*first]]
                ));
                all.push((marker.to_owned(), lost));
            }
        }
        all
    }
}

impl Column {
    fn find<'a>(&self, log: &'a Log, what: &str) -> Result<&'a [f64], Diagnostic> {
        let at = match self {
            Self::Number(number) => number.checked_sub(1),
            Self::Heading(name) => {
                let whole = |heading: &str| heading.to_lowercase() == name.to_lowercase();
                let without_unit =
                    |heading: &str| whole(heading.split(['(', '[']).next().unwrap_or("").trim());
                let find = |named: &dyn Fn(&str) -> bool| -> Vec<usize> {
                    (0..log.headings.len()).filter(|at| named(&log.headings[*at])).collect()
                };
                let found = Some(find(&whole)).filter(|found| !found.is_empty());
                match found.unwrap_or_else(|| find(&without_unit))[..] {
                    [] => None,
                    [at] => Some(at),
                    ref several => {
                        let numbers: Vec<String> = several.iter().map(|at| (at + 1).to_string()).collect();
                        let found = format!("columns {} with the heading `{name}`", numbers.join(", "));
                        return Err(Diagnostic::new(what, "a heading of one column, or its number", found));
                    }
                }
            }
        };
        if let Some(doubt) = at.and_then(|at| log.doubts.get(at)?.as_ref()) {
            return Err(Diagnostic::new(what, "a column that can be read in one way", doubt));
        }
        let found = at.and_then(|at| log.columns.get(at)).map(Vec::as_slice);
        found.ok_or_else(|| {
            let found = format!("{} columns with the headings {:?}", log.columns.len(), log.headings);
            let wanted = match self {
                Self::Number(number) => format!("column {number}, counted from 1"),
                Self::Heading(name) => format!("a column `{name}`"),
            };
            Diagnostic::new(what, wanted, found)
        })
    }
}

impl TimeColumn {
    fn factor(&self) -> Result<f64, Diagnostic> {
        match (&self.column, &self.unit, self.rate_hz) {
            (Some(_), unit, None) => {
                let spelling = unit.as_deref().unwrap_or("s");
                let found = unit::unit(spelling).filter(|(quantity, _)| *quantity == Dimension::Time);
                let wrong = || {
                    Diagnostic::new(
                        "time.unit",
                        format!("one of {}", unit::known_of(Dimension::Time)),
                        format!("`{spelling}`"),
                    )
                };
                found.map(|(_, factor)| factor).ok_or_else(wrong)
            }
            (_, None, Some(rate_hz)) => within("time.rate_hz", rate_hz, RATE_HZ).map(|()| 1.0 / rate_hz),
            _ => Err(Diagnostic::new(
                "time",
                "column with unit or rate_hz > 0, or rate_hz alone",
                "neither or both units",
            )),
        }
    }

    fn seconds(&self, log: &Log) -> Result<Vec<f64>, Diagnostic> {
        let factor = self.factor()?;
        let Some(column) = &self.column else {
            return Ok((0..log.rows()).map(|row| factor * row as f64).collect());
        };
        let values = column.find(log, "time.column")?;
        Ok(values.iter().map(|v| factor * v).collect())
    }
}

impl Channel {
    /// Factor from the column's unit to that of the name.
    fn factor(&self) -> Result<f64, Diagnostic> {
        let place = |key: &str| format!("{}: {key}", self.name);
        if self.sign.abs() != 1.0 {
            return Err(Diagnostic::new(place("sign"), "1 or -1", self.sign));
        }
        check_name(&self.name)?;
        within(place("slope"), self.slope.abs(), SLOPE)?;
        within(place("offset"), self.offset, OFFSET)?;
        within(place("zero_s"), self.zero_s, ZERO_S)?;
        if let Some(size) = self.mm_per_px {
            within(place("mm_per_px"), size, MM_PER_PX)?;
        }
        let suffix = match self.name.ends_with("_per_mm") {
            true => "per_mm",
            false => self.name.rsplit('_').next().unwrap_or_default(),
        };
        let to = unit::unit(suffix).ok_or_else(|| {
            let expected = format!("a unit at the end (pressure_mpa); one of {}", unit::known());
            Diagnostic::new("name", expected, format!("`{}`", self.name))
        })?;
        let from = match (self.unit.as_str(), self.mm_per_px) {
            ("px", Some(size)) if size > 0.0 => (Dimension::Length, size),
            ("px", _) => return Err(Diagnostic::new(place("mm_per_px"), "size of a pixel, mm", "none")),
            (spelling, _) => unit::unit(spelling).ok_or_else(|| {
                Diagnostic::new(
                    place("unit"),
                    format!("one of {}, px", unit::known()),
                    format!("`{spelling}`"),
                )
            })?,
        };
        if from.0 != to.0 {
            let expected = format!("a unit of {:?}, as the name ends with `{suffix}`", to.0);
            return Err(Diagnostic::new(place("unit"), expected, format!("`{}`", self.unit)));
        }
        Ok(from.1 / to.1)
    }

    /// Values of the rows in order of time.
    fn values(&self, log: &Log, rows: &[usize], time_s: &[f64]) -> Result<Vec<f64>, Diagnostic> {
        let factor = self.factor()?;
        let column = self.column.find(log, &self.name)?;
        let value = |row: &usize| factor * self.sign * (self.slope * column[*row] + self.offset);
        let mut values: Vec<f64> = rows.iter().map(value).collect();
        if let Some(confidence) = &self.confidence {
            let confidence = confidence.find(log, &self.name)?;
            let is_lost = |row: &usize| confidence[*row].is_nan() || confidence[*row] < LEAST_CONFIDENCE;
            values.iter_mut().zip(rows).filter(|(_, row)| is_lost(row)).for_each(|(v, _)| *v = f64::NAN);
        }
        if self.zero_s > 0.0 {
            let early = values.iter().zip(time_s).filter(|(v, t)| v.is_finite() && **t <= self.zero_s);
            let (sum, count) = early.fold((0.0, 0.0), |(sum, n), (v, _)| (sum + v, n + 1.0));
            if count == 0.0 {
                let expected = format!("a value in the first {} s", self.zero_s);
                return Err(Diagnostic::new(&self.name, expected, "none"));
            }
            values.iter_mut().for_each(|v| *v -= sum / count);
        }
        Ok(values)
    }
}

impl Frame {
    fn is_rigid(&self) -> bool {
        let r = &self.rotation;
        let dot = |a: usize, b: usize| (0..3).map(|k| r[a][k] * r[b][k]).sum::<f64>();
        let minor = |a: usize, b: usize| r[1][a] * r[2][b] - r[1][b] * r[2][a];
        let determinant = r[0][0] * minor(1, 2) - r[0][1] * minor(0, 2) + r[0][2] * minor(0, 1);
        let pairs = (0..3).flat_map(|a| (0..3).map(move |b| (a, b)));
        let is_orthonormal =
            pairs.map(|(a, b)| dot(a, b) - f64::from(u8::from(a == b))).all(|d| d.abs() < RIGID);
        is_orthonormal && determinant > 0.0
    }

    /// Moves the markers. A camera's plane has two of the three coordinates: the rotation must then stay in that plane.
    fn apply(&self, outputs: &mut [LogColumn]) -> Result<(), Diagnostic> {
        let markers: BTreeSet<String> =
            outputs.iter().filter_map(|series| marker_of(&series.name)).map(str::to_owned).collect();
        for marker in markers {
            let place = |axis: &&str| outputs.iter().position(|s| s.name == format!("{marker}_{axis}_mm"));
            let places: Vec<Option<usize>> = AXES.iter().map(place).collect();
            let mixes = |to: usize, from: usize| {
                (places[to].is_none() != places[from].is_none()) && self.rotation[to][from].abs() > RIGID
            };
            if (0..3).any(|to| (0..3).any(|from| mixes(to, from))) {
                let expected =
                    format!("{marker}_x_mm, {marker}_y_mm and {marker}_z_mm, as its rotation mixes them");
                return Err(Diagnostic::new("frame", expected, "a coordinate less"));
            }
            for row in 0..outputs.first().map_or(0, |series| series.values.len()) {
                let from: Vec<f64> =
                    places.iter().map(|place| place.map_or(0.0, |at| outputs[at].values[row])).collect();
                for (axis, at) in places.iter().enumerate().filter_map(|(axis, at)| Some((axis, (*at)?))) {
                    let along: f64 = self.rotation[axis].iter().zip(&from).map(|(r, v)| r * v).sum();
                    outputs[at].values[row] = along + self.origin_mm[axis];
                }
            }
        }
        Ok(())
    }
}

fn marker_of(name: &str) -> Option<&str> {
    marker_axis(name).map(|(marker, _)| marker)
}

/// Rows in which the position of a marker is no measurement: cameras write a marker that they do not see as 0, 0, 0 or repeat its last position.
///
/// Zeros count where the position jumps to them, repeated positions where they are longer than the marker's other ones (a camera that is slower
/// than the table repeats each position) and the inputs move meanwhile.
fn lost_rows(coordinates: &[&[f64]], inputs: &[&[f64]], rows: &[usize]) -> Vec<usize> {
    let is_same = |a: usize, b: usize| coordinates.iter().all(|values| values[a] == values[b]);
    let distance = |a: usize, b: usize| {
        coordinates.iter().map(|values| (values[a] - values[b]).powi(2)).sum::<f64>().sqrt()
    };
    let size = |row: usize| coordinates.iter().map(|values| values[row].powi(2)).sum::<f64>().sqrt();
    let moved = |run: &[usize]| {
        inputs.iter().any(|values| {
            let of_run = range(run.iter().map(|row| values[*row]));
            of_run > INPUT_MOVES * range(values.iter())
        })
    };
    let runs: Vec<&[usize]> = rows.chunk_by(|a, b| is_same(*a, *b)).collect();
    let usual = median(runs.iter().map(|run| run.len() as f64)).unwrap_or(1.0);
    let step = median(rows.windows(2).map(|pair| distance(pair[0], pair[1])).filter(|d| *d > 0.0));
    let jump = JUMP * step.unwrap_or(f64::INFINITY);
    let mut lost = Vec::new();
    let mut before = 0;
    for run in &runs {
        let behind = before + run.len();
        let beside = [before.checked_sub(1), Some(behind)];
        let mut beside = beside.into_iter().flatten().filter_map(|at| rows.get(at));
        let is_zero = size(run[0]) == 0.0 && beside.any(|row| size(*row) > jump);
        let is_held = run.len() >= SATURATED_RUN && run.len() as f64 > HELD_RUNS * usual && moved(run);
        if is_zero || is_held {
            // The first of repeated positions was measured.
            lost.extend(before + usize::from(!is_zero)..behind);
        }
        before = behind;
    }
    lost
}

/// Continues an angle that is written as -180 to 180 or 0 to 360 degrees beyond its ends; returns the remark.
fn unwrap(name: &str, values: &mut [f64]) -> Option<String> {
    let turn = match name.rsplit('_').next() {
        Some("deg") => 360.0,
        Some("rad") => std::f64::consts::TAU,
        _ => return None,
    };
    let finite: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
    let steps = || finite.windows(2).map(|pair| (pair[1] - pair[0]).abs() / turn);
    let wraps = steps().filter(|step| *step > 0.75).count();
    if wraps == 0 {
        return None;
    }
    if steps().any(|step| (0.25..=0.75).contains(&step)) {
        return Some(format!(
            "{name}: {wraps} steps of nearly a full turn, left as they are because other steps are large too"
        ));
    }
    let (mut turns, mut last) = (0.0, f64::NAN);
    for value in values.iter_mut().filter(|value| value.is_finite()) {
        let step = *value - last;
        last = *value;
        if step.abs() > 0.75 * turn {
            turns -= step.signum();
        }
        *value += turns * turn;
    }
    Some(format!(
        "{name}: {wraps} steps of nearly a full turn; the angle is continued beyond them by turns of {turn:.5}"
    ))
}

/// Rows with a stamp, in order of time.
fn in_order(stamps: &[f64], lines: &[usize]) -> Result<Vec<usize>, Diagnostic> {
    let mut rows: Vec<usize> = (0..stamps.len()).filter(|row| stamps[*row].is_finite()).collect();
    let steps: Vec<f64> = rows.windows(2).map(|pair| stamps[pair[1]] - stamps[pair[0]]).collect();
    let sizes = steps.iter().map(|step| step.abs()).filter(|size| *size > 0.0);
    let limit = MAX_STEP_BACK * median(sizes).unwrap_or(0.0);
    if rows.is_empty() {
        return Err(Diagnostic::new(
            "time",
            "a column with times",
            "none in any row; is it a column of words?",
        ));
    }
    let back = steps.iter().filter(|step| **step < 0.0).count();
    if back as f64 > UNORDERED * steps.len() as f64 {
        let found = format!("{back} of {} stamps before the one above", steps.len());
        return Err(Diagnostic::new("time", "a column that rises; name another one in [time]", found));
    }
    if let Some(at) = steps.iter().position(|step| *step < -limit) {
        let found = format!("a step back by {:.3} s in line {}", -steps[at], lines[rows[at + 1]]);
        return Err(Diagnostic::new(
            "time",
            "one run per file; cut the file there, or correct the column",
            found,
        ));
    }
    rows.sort_by(|a, b| stamps[*a].total_cmp(&stamps[*b]));
    Ok(rows)
}

fn time_remarks(time_s: &[f64], lines: &[usize]) -> Vec<String> {
    let mut remarks = Vec::new();
    let mut report = |what: &str, is_so: &dyn Fn(f64) -> bool| {
        let found: Vec<usize> =
            (1..time_s.len()).filter(|row| is_so(time_s[*row] - time_s[row - 1])).collect();
        if let Some(first) = found.first() {
            remarks.push(format!("time: {} {what}, the first in line {}", found.len(), lines[*first]));
        }
    };
    report("repeated stamps", &|step| step == 0.0);
    report("stamps before the one above (sorted)", &|step| step < 0.0);
    report("missing stamps (left out)", &|step: f64| step.is_nan());
    let median = median(time_s.windows(2).map(|pair| pair[1] - pair[0]).filter(|step| *step > 0.0));
    let long = LONG_GAP * median.unwrap_or(f64::INFINITY);
    report("gaps of more than 1000 median steps", &|step| step > long);
    remarks
}

fn value_remarks(name: &str, values: &[f64]) -> Vec<String> {
    let mut remarks = Vec::new();
    let finite: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
    let missing = values.len() - finite.len();
    let longest = |is_so: &dyn Fn(f64) -> bool| {
        let count = |(run, most): (usize, usize), v: &f64| {
            let run = if is_so(*v) { run + 1 } else { 0 };
            (run, most.max(run))
        };
        values.iter().fold((0, 0), count).1
    };
    if missing > 0 {
        let run = longest(&|v| !v.is_finite());
        remarks.push(format!("{name}: {missing} of {} values missing, at most {run} in a row", values.len()));
    }
    let [low, high] = ends(&finite);
    if finite.is_empty() || high == low {
        remarks.push(format!("{name}: constant"));
        return remarks;
    }
    let (limits, unit, size) = match name.rsplit('_').next() {
        Some("mpa") => (PLAUSIBLE_MPA, "MPa", high.abs().max(low.abs())),
        Some("mm") => (PLAUSIBLE_MM, "mm", high - low),
        _ => ([0.0, f64::INFINITY], "", 1.0),
    };
    if !(limits[0]..=limits[1]).contains(&size) {
        remarks.push(format!("{name}: {size:.3e} {unit} at most; is its unit in the mapping right?"));
    }
    // A command holds other values for at least 50 % of that time.
    let others = values.chunk_by(|a, b| a == b).filter(|run| run[0] != high && run[0] != low);
    let held = others.map(<[f64]>::len).max().unwrap_or(0);
    for (what, extreme) in [("largest", high), ("smallest", low)] {
        let share = finite.iter().filter(|v| **v == extreme).count() as f64 / finite.len() as f64;
        // A gauge at rest repeats a value too; a flat top ends in both directions with motion.
        if share >= SATURATED_SHARE
            && longest(&|v| v == extreme) >= SATURATED_RUN.max(2 * held)
            && !(what == "smallest" && extreme == 0.0)
        {
            remarks.push(format!(
                "{name}: saturated? {:.0} % of the values are the {what}, {extreme}",
                100.0 * share
            ));
        }
    }
    if name.ends_with("_mpa") && low < -0.02 * (high - low) {
        remarks.push(format!("{name}: negative down to {low:.4} MPa: a vacuum, or a zero that is off"));
    }
    remarks
}
