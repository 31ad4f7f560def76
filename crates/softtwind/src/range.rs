//! Parsers of numeric arguments with their ranges.

/// Largest duration of an argument, in s: a year.
pub const MAX_SECONDS: f64 = 31_536_000.0;

/// Parses a finite number from `low` to `high`.
pub fn number(low: f64, high: f64) -> impl Fn(&str) -> Result<f64, String> + Clone + Send + Sync {
    move |text| {
        let value = text.parse::<f64>().ok().filter(|value| (low..=high).contains(value));
        value.ok_or_else(|| format!("expected a number from {low} to {high}"))
    }
}

/// Parses a duration in s.
///
/// # Errors
/// Not a number from 0.001 to [`MAX_SECONDS`].
pub fn seconds(text: &str) -> Result<f64, String> {
    number(0.001, MAX_SECONDS)(text)
}
