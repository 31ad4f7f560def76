//! Parsers of numeric arguments with their ranges.

/// Largest pressure of an argument, MPa: only wrong units exceed it.
pub const MAX_PRESSURE_MPA: f64 = 100.0;
/// Largest gap of an argument, in mm.
pub const MAX_GAP_MM: f64 = 10_000.0;
/// Largest number of cases solved at the same time; each takes about 1 GB.
pub const MAX_THREADS: usize = 256;
/// Largest duration of an argument, in s: a year.
pub const MAX_SECONDS: f64 = 31_536_000.0;

/// Parses a finite number from `low` to `high`.
pub fn number(low: f64, high: f64) -> impl Fn(&str) -> Result<f64, String> + Clone + Send + Sync {
    move |text| {
        let value = text.parse::<f64>().ok().filter(|value| (low..=high).contains(value));
        value.ok_or_else(|| format!("expected a number from {low} to {high}"))
    }
}

/// Parses an integer from `low` to `high`.
pub fn count(low: usize, high: usize) -> impl Fn(&str) -> Result<usize, String> + Clone + Send + Sync {
    move |text| {
        let value = text.parse::<usize>().ok().filter(|value| (low..=high).contains(value));
        value.ok_or_else(|| format!("expected an integer from {low} to {high}"))
    }
}

/// Parses a pressure in MPa.
///
/// # Errors
/// Not a number from 0 to [`MAX_PRESSURE_MPA`].
pub fn pressure_mpa(text: &str) -> Result<f64, String> {
    number(0.0, MAX_PRESSURE_MPA)(text)
}

/// Parses a gap in mm.
///
/// # Errors
/// Not a number from minus to plus [`MAX_GAP_MM`].
pub fn gap_mm(text: &str) -> Result<f64, String> {
    number(-MAX_GAP_MM, MAX_GAP_MM)(text)
}

/// Parses a number of threads.
///
/// # Errors
/// Not an integer from 1 to [`MAX_THREADS`].
pub fn threads(text: &str) -> Result<usize, String> {
    count(1, MAX_THREADS)(text)
}

/// Parses a duration in s.
///
/// # Errors
/// Not a number from 0.001 to [`MAX_SECONDS`].
pub fn seconds(text: &str) -> Result<f64, String> {
    number(0.001, MAX_SECONDS)(text)
}
