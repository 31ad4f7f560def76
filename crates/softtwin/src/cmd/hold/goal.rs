//! Targets over time.

use crate::failure::{configuration, usage};
use control::law::Target;
use formats::table::Table;
use formats::trace::around;
use std::path::Path;
use wire::layout::{TARGET_VALUES_MAX, target_kind};

/// Straight lines between points of time in s and value, at least one; a single point is a step.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Goal {
    points: Vec<[f64; 2]>,
}

impl Goal {
    pub(super) fn step(value: f64) -> Self {
        Self { points: vec![[0.0, value]] }
    }

    /// Reads a table with `t_s` and one of `columns`; returns that one.
    pub(super) fn read(path: &Path, columns: &[&'static str]) -> anyhow::Result<(&'static str, Self)> {
        let place =
            |error: formats::Diagnostic| configuration(anyhow::anyhow!("{}: {error}", path.display()));
        let table = Table::read(path, true).map_err(configuration)?;
        let has = |name: &&&'static str| table.header().iter().any(|column| column == **name);
        let found: Vec<&&'static str> = columns.iter().filter(has).collect();
        let [name] = found[..] else {
            let expected = columns.join(", ");
            return Err(usage(format!("--trace {}: expected t_s and one of {expected}", path.display())));
        };
        let (time, value) = (table.column("t_s").map_err(place)?, table.column(name).map_err(place)?);
        let row = |row: formats::table::TableRow<'_>| Ok([row.number(time)?, row.number(value)?]);
        let points: Result<Vec<[f64; 2]>, _> = table.rows().map(row).collect();
        let points = points.map_err(place)?;
        if points.is_empty() || points.windows(2).any(|pair| pair[1][0] <= pair[0][0]) {
            let found = "times that do not increase, or no row";
            return Err(usage(format!("--trace {}: expected increasing t_s, found {found}", path.display())));
        }
        Ok((name, Self { points }))
    }

    /// Takes a target of the bus at the time `now_s`; a ramp begins at the present one.
    ///
    /// # Errors
    /// A sentence on what of it is not valid.
    pub(super) fn of_sample(sample: &wire::Target, now_s: f64, present: f64) -> Result<Self, String> {
        let values = sample.values.get(..sample.value_count as usize).unwrap_or_default();
        let is_speed = |value: f64| value > 0.0 && value.is_finite();
        if values.is_empty() || values.iter().any(|value| !value.is_finite()) {
            return Err(format!(
                "expected 1 to {TARGET_VALUES_MAX} finite values, found {}",
                sample.value_count
            ));
        }
        let last = values[values.len() - 1];
        let points = match sample.target_kind {
            target_kind::STEP if values.len() == 1 => vec![[now_s, last]],
            target_kind::RAMP if values.len() == 1 && is_speed(sample.rate_per_s) => {
                let end_s = now_s + (last - present).abs() / sample.rate_per_s;
                if end_s > now_s { vec![[now_s, present], [end_s, last]] } else { vec![[now_s, last]] }
            }
            target_kind::SERIES if is_speed(sample.interval_s) => {
                let point =
                    |(index, value): (usize, &f64)| [now_s + index as f64 * sample.interval_s, *value];
                values.iter().enumerate().map(point).collect()
            }
            _ => {
                return Err(
                    "expected a step, a ramp with a rate above 0, or a series with an interval above 0"
                        .into(),
                );
            }
        };
        Ok(Self { points })
    }

    /// Target at a time since the beginning.
    pub(super) fn at(&self, t_s: f64) -> Target {
        let ([[from_s, from], [to_s, to]], part) = around(&self.points, |point| point[0], t_s);
        let rate = if to_s > from_s { (to - from) / (to_s - from_s) } else { 0.0 };
        Target { value: from + part * (to - from), rate }
    }

    /// End of a series, s.
    pub(super) fn end_s(&self) -> Option<f64> {
        self.points.last().filter(|_| self.points.len() > 1).map(|point| point[0])
    }

    pub(super) fn values(&self) -> impl Iterator<Item = f64> {
        self.points.iter().map(|point| point[1])
    }

    /// The last value.
    pub(super) fn last(&self) -> f64 {
        self.points.last().map_or(f64::NAN, |point| point[1])
    }
}
