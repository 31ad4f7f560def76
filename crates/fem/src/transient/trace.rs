//! Traces: inputs over time, `t_s,pressure_mpa` with further inputs.

use crate::actuator::{Actuator, Setting};
use crate::cases::MAX_MM;
use crate::config::Load;
use crate::config::MAX_MPA;
use formats::table::{Row, Table};
use formats::{Diagnostic, FormatError, collect};
use std::path::Path;

/// Columns of the series that a transient writes.
pub const SERIES_COLUMNS: [&str; 8] = [
    "t_s",
    "pressure_mpa",
    "gap_mm",
    "lowest_y_mm",
    "tip_x_mm",
    "tip_y_mm",
    "contact_force_n",
    "max_stress_mpa",
];

/// Keys of gravity, the loads other than pressure and gap that may change in time.
const GRAVITY: [&str; 3] = ["loads.gravity_mm_s2.0", "loads.gravity_mm_s2.1", "loads.gravity_mm_s2.2"];

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
}

/// Inputs over time, linear between the rows.
#[derive(Clone, Debug, PartialEq)]
pub struct Trace {
    /// Rows in the order of time; at least two.
    pub rows: Vec<TraceRow>,
    /// Quantities of the actuator that have their own column, constant in time.
    pub settings: Vec<Setting>,
}

impl Trace {
    /// Reads a trace of an actuator.
    ///
    /// Columns `t_s` and `pressure_mpa`; `gap_mm`, and dotted keys of numbers in `actuator.toml`, if given. Gravity may change in
    /// time, other quantities may not. Results of an earlier transient are ignored, so that its series is a trace.
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
        let [time, pressure] = table.columns(["t_s", "pressure_mpa"])?;
        let gap = table.column("gap_mm").ok();
        let mut diagnostics = Vec::new();
        let mut quantities: Vec<(usize, &str)> = Vec::new();
        for (column, name) in table.header().iter().enumerate() {
            if !SERIES_COLUMNS.contains(&name.as_str()) {
                collect(actuator.quantity(name), &mut diagnostics);
                quantities.push((column, name));
            }
        }
        if !diagnostics.is_empty() {
            return Err(diagnostics);
        }
        let columns = Columns { time, pressure, gap, quantities };
        let mut rows: Vec<TraceRow> = Vec::new();
        let mut settings: Vec<Setting> = Vec::new();
        for row in table.rows() {
            let before = rows.last().copied();
            rows.extend(columns.row(&row, actuator, before, &mut settings, &mut diagnostics));
        }
        if rows.len() < 2 && diagnostics.is_empty() {
            diagnostics.push(Diagnostic::new("rows", "at least two instants", rows.len()));
        }
        if diagnostics.is_empty() { Ok(Self { rows, settings }) } else { Err(diagnostics) }
    }

    /// Inputs at a time (s), linear between the rows, those of the first and last row outside.
    #[must_use]
    pub fn at(&self, t_s: f64) -> TraceRow {
        let after = self.rows.partition_point(|row| row.t_s <= t_s);
        if after == 0 || after == self.rows.len() {
            return TraceRow { t_s, ..self.rows[after.saturating_sub(1)] };
        }
        let [a, b] = [self.rows[after - 1], self.rows[after]];
        let w = (t_s - a.t_s) / (b.t_s - a.t_s);
        let mix = |a: f64, b: f64| a + w * (b - a);
        TraceRow {
            t_s,
            pressure_mpa: mix(a.pressure_mpa, b.pressure_mpa),
            gap_mm: a.gap_mm.zip(b.gap_mm).map(|(a, b)| mix(a, b)),
            gravity_mm_s2: std::array::from_fn(|i| mix(a.gravity_mm_s2[i], b.gravity_mm_s2[i])),
        }
    }

    /// Loads of an actuator at a time (s).
    #[must_use]
    pub fn load(&self, actuator: &Actuator, t_s: f64) -> Load {
        let row = self.at(t_s);
        Load { gravity_mm_s2: row.gravity_mm_s2, ..actuator.load(row.pressure_mpa, row.gap_mm) }
    }

    /// Times of a series: those of the rows and of `further`, and between them equal parts of at most `largest_s`.
    #[must_use]
    pub fn instants(&self, further: &[f64], largest_s: f64) -> Vec<f64> {
        let mut fixed: Vec<f64> =
            self.rows.iter().map(|row| row.t_s).chain(further.iter().copied()).collect();
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
    #[must_use]
    pub fn long_intervals(&self) -> Vec<(f64, f64)> {
        let intervals = self.rows.windows(2).map(|pair| (pair[0].t_s, pair[1].t_s - pair[0].t_s));
        intervals.filter(|(_, length)| *length > LONG_S).collect()
    }
}

/// Places of the inputs in a table.
struct Columns<'a> {
    time: usize,
    pressure: usize,
    gap: Option<usize>,
    quantities: Vec<(usize, &'a str)>,
}

impl Columns<'_> {
    fn row(
        &self,
        row: &Row<'_>,
        actuator: &Actuator,
        before: Option<TraceRow>,
        settings: &mut Vec<Setting>,
        diagnostics: &mut Vec<Diagnostic>,
    ) -> Option<TraceRow> {
        let count = diagnostics.len();
        collect(row.check_width(false), diagnostics)?;
        let mut number = |column| collect(row.number(column), diagnostics).unwrap_or(f64::NAN);
        let (t_s, pressure_mpa) = (number(self.time), number(self.pressure));
        let mut gravity_mm_s2 = actuator.loads.gravity_mm_s2;
        let mut constant = Vec::new();
        for (column, name) in &self.quantities {
            let value = number(*column);
            match GRAVITY.iter().position(|key| key == name) {
                Some(axis) => gravity_mm_s2[axis] = value,
                None => constant.push((*column, ((*name).to_owned(), value))),
            }
        }
        let mut expect = |fits: bool, column: usize, expected: &str| {
            if !fits {
                diagnostics.push(row.diagnostic(column, expected));
            }
        };
        let later = before.is_none_or(|before| t_s.is_nan() || t_s - before.t_s >= MIN_INTERVAL_S);
        expect(later, self.time, "a time at least 1e-6 s after the row before");
        let fits = pressure_mpa.is_nan() || (0.0..=MAX_MPA).contains(&pressure_mpa);
        expect(fits, self.pressure, "a pressure of 0 to 10 MPa");
        let mut gap_mm = None;
        if let Some(column) = self.gap {
            let given = !row.text(column).is_empty();
            gap_mm = row.number(column).ok();
            let fits = gap_mm.is_some_and(|gap| gap > 0.0 && gap <= MAX_MM) || !given;
            expect(fits, column, "a gap above 0 mm (the obstacle is outside the body), or nothing");
            let same = before.is_none_or(|before| before.gap_mm.is_some() == given);
            expect(same, column, "a gap in every row or in none: an obstacle neither appears nor vanishes");
        }
        if before.is_none() {
            *settings = constant.into_iter().map(|(_, setting)| setting).collect();
        } else {
            for ((column, (_, value)), (_, first)) in constant.iter().zip(settings.iter()) {
                let expected = "the value of the first row: only pressure, gap and gravity change in time";
                expect(value.is_nan() || value == first, *column, expected);
            }
        }
        (diagnostics.len() == count).then_some(TraceRow { t_s, pressure_mpa, gap_mm, gravity_mm_s2 })
    }
}
