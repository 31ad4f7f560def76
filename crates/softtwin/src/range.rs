//! Parsers of arguments: numbers with their ranges, pressures and lengths also with a unit.

use formats::unit::{Dimension, unit};
pub use softtwind::range::{number, seconds};

/// Largest pressure of an argument, MPa: only wrong units exceed it.
pub const MAX_PRESSURE_MPA: f64 = 100.0;
/// Largest gap of an argument, in mm.
pub const MAX_GAP_MM: f64 = 10_000.0;
/// Largest number of cases solved at the same time; each takes about 1 GB.
pub const MAX_THREADS: usize = 256;

/// Parses an integer from `low` to `high`.
pub fn count(low: usize, high: usize) -> impl Fn(&str) -> Result<usize, String> + Clone + Send + Sync {
    move |text| {
        let value = text.parse::<usize>().ok().filter(|value| (low..=high).contains(value));
        value.ok_or_else(|| format!("expected an integer from {low} to {high}"))
    }
}

/// Parses a pressure into MPa: `0.05` is in MPa, `50kPa`, `0.5bar` and `7psi` have their unit.
///
/// # Errors
/// Not a number from 0 to [`MAX_PRESSURE_MPA`], or not a unit of pressure.
pub fn pressure_mpa(text: &str) -> Result<f64, String> {
    with_unit(text, Dimension::Pressure, 0.0, MAX_PRESSURE_MPA)
        .ok_or_else(|| format!("expected a number from 0 to {MAX_PRESSURE_MPA} (MPa), or one with a unit, such as 50kPa, 0.5bar, 7psi"))
}

/// Parses a gap into mm: `40` is in mm, `4cm` and `40mm` have their unit.
///
/// # Errors
/// Not a number from minus to plus [`MAX_GAP_MM`], or not a unit of length.
pub fn gap_mm(text: &str) -> Result<f64, String> {
    with_unit(text, Dimension::Length, -MAX_GAP_MM, MAX_GAP_MM).ok_or_else(|| {
        format!(
            "expected a number from -{MAX_GAP_MM} to {MAX_GAP_MM} (mm), or one with a unit, such as 40mm, 4cm"
        )
    })
}

fn with_unit(text: &str, quantity: Dimension, low: f64, high: f64) -> Option<f64> {
    let digits = text.trim_end_matches(|c: char| !c.is_ascii_digit() && c != '.');
    let digits = if text.parse::<f64>().is_ok() { text } else { digits };
    let factor = match text[digits.len()..].trim() {
        "" => 1.0,
        spelling => unit(spelling).filter(|(found, _)| *found == quantity)?.1,
    };
    digits.trim().parse::<f64>().ok().map(|value| value * factor).filter(|value| (low..=high).contains(value))
}

/// Parses a number of threads.
///
/// # Errors
/// Not an integer from 1 to [`MAX_THREADS`].
pub fn threads(text: &str) -> Result<usize, String> {
    count(1, MAX_THREADS)(text)
}
