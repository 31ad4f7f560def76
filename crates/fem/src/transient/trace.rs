//! Traces: inputs over time, `t_s,pressure_mpa` with further inputs.

use crate::actuator::{Actuator, Setting};
use crate::cases::{MAX_MM, VOLUME};
use crate::config::{Load, MAX_CAVITIES, MAX_MPA};
use formats::table::Table;
use formats::trace::{self, Cell};
use formats::{Diagnostic, FormatError, collect};
use std::path::Path;

/// Keys of gravity, the loads other than pressure and gap that may change in time.
const GRAVITY: [&str; 3] = ["loads.gravity_mm_s2.0", "loads.gravity_mm_s2.1", "loads.gravity_mm_s2.2"];

/// Begin of the keys of further cavities' pressures.
const CAVITY: &str = "pressure_mpa.";

/// Least time between two rows (s).
const MIN_INTERVAL_S: f64 = 1.0e-6;

/// Interval (s) from which two rows count as a gap in the data.
const LONG_S: f64 = 1.0;

/// Inputs of an instant.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TraceRow {
    /// Time (s).
    pub t_s: f64,
    /// Cavity pressure (MPa).
    pub pressure_mpa: f64,
    /// Distance of the obstacle from the undeformed base (mm); `None` without an obstacle.
    pub gap_mm: Option<f64>,
    /// Gravitational acceleration (mm/s2).
    pub gravity_mm_s2: [f64; 3],
    /// Pressures of further cavities, in the order of their names, minus those of the first row (MPa).
    pub cavities_change_mpa: [f64; MAX_CAVITIES],
}

/// Inputs over time, linear between the rows, those of the first and last row outside.
#[derive(Clone, Debug, PartialEq)]
pub struct Trace {
    /// Quantities of the actuator that have their own column, constant in time.
    pub settings: Vec<Setting>,
    /// All columns of inputs.
    inputs: trace::TraceTable,
    /// Columns of a row.
    columns: Columns,
    /// Gravity of an actuator without columns of it (mm/s2).
    gravity_mm_s2: [f64; 3],
}

/// Positions of a row's values among the inputs.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Columns {
    pressure: Option<usize>,
    gap: Option<usize>,
    gravity: [Option<usize>; 3],
    cavities: [Option<usize>; MAX_CAVITIES],
}

impl Trace {
    /// Reads a trace of an actuator.
    ///
    /// Columns `t_s` and `pressure_mpa`; `gap_mm`, and dotted keys of numbers in `actuator.toml`, if given. Gravity and the pressures
    /// of further cavities may change in time, other quantities may not. Results of an earlier transient are ignored, so that its
    /// series is a trace.
    ///
    /// # Errors
    /// All errors in it: I/O, missing or unknown columns, times that do not rise, values out of range.
    pub fn read(path: &Path, actuator: &Actuator) -> Result<Self, FormatError> {
        let table = Table::read(path, true)?;
        Self::of_table(&table, actuator)
            .map_err(|diagnostics| FormatError::Content { path: path.into(), diagnostics })
    }

    /// [`Trace::read`] from memory.
    ///
    /// # Errors
    /// All errors; never empty.
    pub fn parse(text: &str, actuator: &Actuator) -> Result<Self, Vec<Diagnostic>> {
        let table = Table::parse(text, true).map_err(|diagnostic| vec![diagnostic])?;
        Self::of_table(&table, actuator)
    }

    fn of_table(table: &Table, actuator: &Actuator) -> Result<Self, Vec<Diagnostic>> {
        table.columns(["pressure_mpa"])?;
        let mut diagnostics = Vec::new();
        let is_quantity = |name: &&String| *name != VOLUME && !trace::SERIES_COLUMNS.contains(&name.as_str());
        for name in table.header().iter().filter(is_quantity) {
            collect(actuator.quantity(name), &mut diagnostics);
        }
        if !diagnostics.is_empty() {
            return Err(diagnostics);
        }
        let inputs = trace::TraceTable::of_table(table, &refused)?;
        let column = |name: &str| inputs.position(name);
        let mut cavities = [None; MAX_CAVITIES];
        for (cavity, name) in cavities.iter_mut().zip(actuator.pressure_mpa.keys()) {
            *cavity = column(&format!("{CAVITY}{name}"));
        }
        let (pressure, gap, gravity) = (column("pressure_mpa"), column("gap_mm"), GRAVITY.map(column));
        let changing =
            [pressure, gap, column(VOLUME)].into_iter().chain(gravity).flatten().collect::<Vec<_>>();
        let first = inputs.rows.iter().take(1).flat_map(|(_, values)| inputs.names.iter().zip(values));
        let constant = first.enumerate().filter(|(column, _)| !changing.contains(column));
        let settings = constant.map(|(_, (name, value))| (name.clone(), *value)).collect();
        let columns = Columns { pressure, gap, gravity, cavities };
        Ok(Self { settings, inputs, columns, gravity_mm_s2: actuator.loads.gravity_mm_s2 })
    }

    /// Inputs at a time (s).
    pub fn at(&self, t_s: f64) -> TraceRow {
        let Columns { pressure, gap, gravity, cavities } = self.columns;
        let values = self.inputs.at(t_s);
        let first = &self.inputs.rows[0].1;
        let value = |at: Option<usize>| at.map(|at| values[at]);
        TraceRow {
            t_s,
            pressure_mpa: value(pressure).unwrap_or_default(),
            gap_mm: value(gap).filter(|gap| gap.is_finite()),
            gravity_mm_s2: std::array::from_fn(|i| value(gravity[i]).unwrap_or(self.gravity_mm_s2[i])),
            cavities_change_mpa: cavities.map(|at| at.map_or(0.0, |at| values[at] - first[at])),
        }
    }

    /// Times of the rows (s), at least two.
    fn times_s(&self) -> impl Iterator<Item = f64> {
        self.inputs.rows.iter().map(|(t_s, _)| *t_s)
    }

    /// Times of the first and last row (s).
    pub fn ends_s(&self) -> [f64; 2] {
        let rows = &self.inputs.rows;
        [rows[0].0, rows[rows.len() - 1].0]
    }

    /// Positions and names of the inputs that the columns of a series do not have.
    pub(super) fn further(&self) -> impl Iterator<Item = (usize, &str)> {
        let named = self.inputs.names.iter().map(String::as_str).enumerate();
        named.filter(|(_, name)| *name != VOLUME && !trace::SERIES_COLUMNS.contains(name))
    }

    /// All inputs at a time (s).
    pub(super) fn inputs_at(&self, t_s: f64) -> Vec<f64> {
        self.inputs.at(t_s)
    }

    /// Loads of an actuator at a time (s).
    pub fn load(&self, actuator: &Actuator, t_s: f64) -> Load {
        let row = self.at(t_s);
        let TraceRow { gravity_mm_s2, cavities_change_mpa, .. } = row;
        Load { gravity_mm_s2, cavities_change_mpa, ..actuator.load(row.pressure_mpa, row.gap_mm) }
    }

    /// Times of a series: those of the rows and of `further`, and between them equal parts of at most `largest_s`.
    pub fn instants(&self, further: &[f64], largest_s: f64) -> Vec<f64> {
        let mut fixed: Vec<f64> = self.times_s().chain(further.iter().copied()).collect();
        fixed.sort_by(f64::total_cmp);
        fixed.dedup_by(|b, a| *b - *a < MIN_INTERVAL_S);
        let mut instants = Vec::new();
        for pair in fixed.windows(2) {
            let length = pair[1] - pair[0];
            let parts = (length / largest_s * (1.0 - 1.0e-9)).ceil().max(1.0);
            instants.extend((0..parts as u64).map(|k| pair[0] + length * (k as f64 / parts)));
        }
        instants.extend(fixed.last());
        instants
    }

    /// Begins (s) and lengths (s) of the intervals without a row that are longer than 1 s.
    pub fn long_intervals(&self) -> Vec<(f64, f64)> {
        let intervals = self.times_s().zip(self.times_s().skip(1)).map(|(from, to)| (from, to - from));
        intervals.filter(|(_, length)| *length > LONG_S).collect()
    }
}

/// Expected value of a cell, if it is not valid.
fn refused(Cell { name, value, first }: Cell<'_>) -> Option<&'static str> {
    let same = |first: f64| first.is_finite() == value.is_finite();
    match name {
        name if (name == "pressure_mpa" || name.starts_with(CAVITY)) && !(0.0..=MAX_MPA).contains(&value) => {
            Some("a pressure of 0 to 10 MPa")
        }
        "gap_mm" if value.is_finite() && !(value > 0.0 && value <= MAX_MM) => {
            Some("a gap above 0 mm (the obstacle is outside the body), or nothing")
        }
        "gap_mm" if !first.is_none_or(same) => {
            Some("a gap in every row or in none: an obstacle neither appears nor vanishes")
        }
        "pressure_mpa" | "gap_mm" | VOLUME => None,
        name if GRAVITY.contains(&name)
            || name.starts_with(CAVITY)
            || first.is_none_or(|first| first == value) =>
        {
            None
        }
        _ => Some("the value of the first row: only pressures, gap and gravity change in time"),
    }
}
