//! From values to drawing coordinates: range, logarithm, tick labels.

use std::ops::Range;

/// An axis: its label says quantity and unit.
#[derive(Default)]
pub struct Axis {
    /// `pressure [MPa]`.
    pub label: String,
    /// Logarithmic, base 10; values that are not positive are left out.
    pub log: bool,
    /// Names at 0, 1, 2, ... instead of numbers.
    pub names: Vec<String>,
}

impl From<&str> for Axis {
    fn from(label: &str) -> Self {
        Self::linear(label)
    }
}

impl Axis {
    /// A linear axis.
    pub fn linear(label: &str) -> Self {
        Self { label: label.into(), ..Self::default() }
    }

    /// A logarithmic axis.
    pub fn log(label: &str) -> Self {
        Self { label: label.into(), log: true, ..Self::default() }
    }

    /// An axis of names.
    pub fn names(label: &str, names: Vec<String>) -> Self {
        Self { names, ..Self::linear(label) }
    }

    /// Drawing coordinate of a value; `None` if the axis cannot show it.
    pub(super) fn place(&self, value: f64) -> Option<f64> {
        let placed = if self.log { value.log10() } else { value };
        placed.is_finite().then_some(placed)
    }

    /// Range of the drawing coordinates with a margin; whole decades on a logarithmic axis.
    pub(super) fn range(&self, values: impl Iterator<Item = f64>) -> Range<f64> {
        if !self.names.is_empty() {
            return -0.5..self.names.len() as f64 - 0.5;
        }
        let placed = values.filter_map(|v| self.place(v));
        let (min, max) = placed.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
        if min > max {
            return 0.0..1.0;
        }
        if self.log {
            return min.floor()..max.ceil().max(min.floor() + 1.0);
        }
        // A constant gets room that its labels can tell apart.
        let margin = if max > min { 0.04 * (max - min) } else { 0.05 * max.abs() }.max(1e-12);
        // An axis of quantities that start at 0 starts at 0.
        let low = if min >= 0.0 && min < 0.3 * max { 0.0 } else { min - margin };
        low..max + margin
    }

    /// How many labels to ask for.
    pub(super) fn labels(&self, range: &Range<f64>) -> usize {
        match () {
            () if !self.names.is_empty() => self.names.len() * 2,
            () if self.log => ((range.end - range.start) as usize + 1).min(12),
            () => 6,
        }
    }

    /// Step between names that are written without touching each other, for an axis length and the widest name, in pixels.
    pub(super) fn stride(&self, length: u32, widest: u32) -> usize {
        (self.names.len() as u32 * widest).div_ceil(length.max(1)).max(1) as usize
    }

    /// Label of a drawing coordinate; empty where none belongs.
    pub(super) fn text(&self, placed: f64, stride: usize) -> String {
        let whole = (placed - placed.round()).abs() < 1e-6;
        match () {
            () if !self.names.is_empty() => {
                let index = placed.round().max(0.0) as usize;
                let name = self.names.get(index).filter(|_| whole && index.is_multiple_of(stride));
                name.cloned().unwrap_or_default()
            }
            () if self.log && whole => power(placed.round() as i32),
            () if self.log => String::new(),
            () => number(placed),
        }
    }
}

/// A power of ten: in full where that is short.
fn power(exponent: i32) -> String {
    match exponent {
        0..=4 => format!("{}", 10_i64.pow(exponent.unsigned_abs())),
        -3..=-1 => format!("{}", 10_f64.powi(exponent)),
        _ => format!("1e{exponent}"),
    }
}

/// A number with as many digits as it needs.
pub(super) fn number(value: f64) -> String {
    if value.abs() >= 1e5 || (value != 0.0 && value.abs() < 1e-4) {
        return format!("{value:.1e}");
    }
    let text = format!("{value:.4}");
    let short = text.trim_end_matches('0').trim_end_matches('.');
    if short == "-0" { "0".into() } else { short.into() }
}

#[cfg(test)]
#[path = "../../tests/unit/chart_axis.rs"]
mod tests;
