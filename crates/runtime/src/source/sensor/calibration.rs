//! From what a device says to a value in its base unit: factor and offset, or a table of points; then the filter.

use super::filter::{Filter, FilterSpec};
use super::register::Quantity;
use crate::source::named::InputNames;
use crate::source::value::{FORCE, GAP, MARKERS, NAMED, PRESSURE, QUANTITIES};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// One value of a sensor as written in a scene file; `P` says where the device has it.
///
/// value = (raw x `scale` + `offset`), or `points` at raw, in `unit`; then filtered.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ValueSpec<P> {
    /// Where the device has it.
    pub from: P,
    /// Factor on the raw number.
    #[serde(default = "one")]
    pub scale: f64,
    /// Added after the factor, in `unit`.
    #[serde(default)]
    pub offset: f64,
    /// In place of factor and offset: raw numbers, rising, each with its value in `unit`; straight lines between them.
    #[serde(default)]
    pub points: Vec<[f64; 2]>,
    /// Unit of the result: Pa, kPa, MPa, mbar, bar, psi; um, mm, m; mN, N, gf, kgf. Default: MPa, mm or N; for a model input that
    /// is no pressure, length or force the unit at the end of its name, and no other.
    #[serde(default)]
    pub unit: Option<String>,
    /// Smoothing.
    #[serde(default)]
    pub filter: FilterSpec,
    /// Standard deviation of its noise, MPa, mm or N; default: that of the actuator's `sigma`.
    #[serde(default)]
    pub sigma: Option<f64>,
}

/// The values of a sensor by name: `pressure_mpa`, `gap_mm`, `force_n`, `marker1_x_mm`, ..., and measured model inputs.
pub type Values<P> = BTreeMap<String, ValueSpec<P>>;

fn one() -> f64 {
    1.0
}

/// What kind of quantity a value at a place of a reading is; `None` for an input that is no pressure, length or force.
fn quantity(slot: usize, name: &str) -> Option<Quantity> {
    match slot {
        PRESSURE => Some(Quantity::Pressure),
        FORCE => Some(Quantity::Force),
        GAP | MARKERS..NAMED => Some(Quantity::Gap), // lengths
        _ if name.contains("_per_") => None,
        _ => match name.rsplit_once('_')?.1 {
            "mpa" => Some(Quantity::Pressure),
            "mm" => Some(Quantity::Gap),
            "n" => Some(Quantity::Force),
            _ => None,
        },
    }
}

/// Size of `unit` in the unit of a value; `None` where it is no unit of it.
fn factor(quantity: Option<Quantity>, unit: Option<&str>) -> Option<f64> {
    match (quantity, unit) {
        (Some(quantity), unit) => quantity.factor(unit),
        (None, None) => Some(1.0),
        (None, Some(_)) => None,
    }
}

/// Everything that is wrong with the values of a sensor; `place` checks where the device has one.
pub(super) fn problems<P>(
    values: &Values<P>,
    inputs: &InputNames,
    key: &str,
    problems: &mut Vec<String>,
    mut place: impl FnMut(&P, &str, &mut Vec<String>),
) {
    if values.is_empty() {
        problems.push(format!("{key}: expected at least one value, such as pressure_mpa, found none"));
    }
    for (name, value) in values {
        let key = format!("{key}.{name}");
        let unit = value.unit.as_deref();
        match inputs.slot(name).map(|slot| quantity(slot, name)) {
            Some(Some(quantity)) => quantity.check_unit(&format!("{key}.unit"), unit, problems),
            Some(None) => {
                if let Some(unit) = unit {
                    problems.push(format!(
                        "{key}.unit: expected none, the value is in the unit of its name; found `{unit}`; use scale"
                    ));
                }
            }
            None => {
                let known = QUANTITIES.into_iter().chain(inputs.iter());
                let near = known.max_by(|a, b| similar(a, name).total_cmp(&similar(b, name)));
                let near = near.unwrap_or_default();
                problems.push(format!(
                    "{key}: expected pressure_mpa, gap_mm, force_n, marker1_x_mm to marker8_z_mm or an input that \
                     [actuator.inputs] calls measured, found `{name}`; did you mean `{near}`?"
                ));
            }
        }
        place(&value.from, &format!("{key}.from"), problems);
        value.problems(&key, problems);
    }
}

/// How many characters two names have in common at their beginning, by their length.
fn similar(a: &str, b: &str) -> f64 {
    let same = a.chars().zip(b.chars()).take_while(|(a, b)| a == b).count();
    same as f64 / a.len().max(b.len()).max(1) as f64
}

impl<P> ValueSpec<P> {
    fn problems(&self, key: &str, problems: &mut Vec<String>) {
        if !(self.scale.is_finite() && self.scale != 0.0) {
            problems
                .push(format!("{key}.scale: expected a finite number other than 0, found {}", self.scale));
        }
        if !self.offset.is_finite() {
            problems.push(format!("{key}.offset: expected a finite number, found {}", self.offset));
        }
        if !self.points.is_empty() {
            let finite = self.points.iter().flatten().all(|number| number.is_finite());
            let rising = self.points.windows(2).all(|pair| matches!(pair, [a, b] if a[0] < b[0]));
            if self.points.len() < 2 || !finite || !rising {
                problems.push(format!(
                    "{key}.points: expected at least two pairs [raw, value] of finite numbers, raw rising, found {:?}",
                    self.points
                ));
            }
            if self.scale != 1.0 || self.offset != 0.0 {
                problems.push(format!(
                    "{key}.points: expected either points or scale and offset, found both; put the points' own scale into them"
                ));
            }
        }
        if let Some(sigma) = self.sigma.filter(|sigma| !(sigma.is_finite() && *sigma > 0.0)) {
            problems.push(format!("{key}.sigma: expected a number above 0, found {sigma}"));
        }
        self.filter.problems(&format!("{key}.filter"), problems);
    }

    /// What makes a value of the raw number; `None` for a name or a unit that is none.
    pub(super) fn channel(&self, name: &str, inputs: &InputNames) -> Option<Channel> {
        let slot = inputs.slot(name)?;
        let factor = factor(quantity(slot, name), self.unit.as_deref())?;
        let calibration =
            Calibration { scale: self.scale, offset: self.offset, points: self.points.clone(), factor };
        Some(Channel { slot, calibration, filter: Filter::new(self.filter) })
    }
}

/// Raw numbers to base units.
#[derive(Debug, Clone)]
pub(super) struct Calibration {
    pub(super) scale: f64,
    pub(super) offset: f64,
    pub(super) points: Vec<[f64; 2]>,
    /// Size of the unit in the base unit.
    pub(super) factor: f64,
}

impl Calibration {
    /// The value in its base unit; `None` outside the table. What is not finite stays so.
    pub(super) fn apply(&self, raw: f64) -> Option<f64> {
        if !raw.is_finite() {
            return Some(raw);
        }
        if self.points.is_empty() {
            return Some((raw * self.scale + self.offset) * self.factor);
        }
        let between = self.points.windows(2).find_map(|pair| match pair {
            [[x0, y0], [x1, y1]] if (*x0..=*x1).contains(&raw) => {
                Some(y0 + (y1 - y0) * (raw - x0) / (x1 - x0))
            }
            _ => None,
        });
        between.map(|value| value * self.factor)
    }
}

/// One value of a sensor on its way from the device to the reading.
#[derive(Debug)]
pub(super) struct Channel {
    /// Its place in the reading.
    pub(super) slot: usize,
    pub(super) calibration: Calibration,
    pub(super) filter: Filter,
}

impl Channel {
    /// In base units already, or made so by one factor; not filtered.
    pub(super) fn plain(slot: usize, factor: f64) -> Self {
        let calibration = Calibration { scale: 1.0, offset: 0.0, points: Vec::new(), factor };
        Self { slot, calibration, filter: Filter::Off }
    }
}

#[cfg(test)]
#[path = "../../../tests/unit/source_sensor_calibration.rs"]
mod tests;
