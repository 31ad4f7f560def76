//! Medians of measured values.

/// As [`rom::statistics::median`]; NaN of nothing.
pub fn median(values: impl Iterator<Item = f64>) -> f64 {
    rom::statistics::median(values).unwrap_or(f64::NAN)
}
