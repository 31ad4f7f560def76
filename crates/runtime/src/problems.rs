//! Errors in a configuration, all of them at once.

use std::fmt::Display;

/// Lowest and highest rate of a scene, Hz: every key that is a rate keeps to it.
pub const RATE_HZ: [f64; 2] = [1e-3, 20_000.0];
/// Shortest and longest duration of a scene, s: a microsecond to a year.
const DURATION_S: [f64; 2] = [1e-6, 31_536_000.0];

/// Errors in a part of a configuration: each has the key, what is expected and what was found.
#[derive(Debug)]
pub struct Problems<'a> {
    list: &'a mut Vec<String>,
    place: String,
}

impl<'a> Problems<'a> {
    /// Adds to `list`; `place` is the key of the part.
    pub fn new(list: &'a mut Vec<String>, place: impl Into<String>) -> Self {
        Self { list, place: place.into() }
    }

    /// The part of this one with that key.
    pub fn part(&mut self, key: impl Display) -> Problems<'_> {
        let place = if self.place.is_empty() { key.to_string() } else { format!("{}.{key}", self.place) };
        Problems { list: self.list, place }
    }

    /// Number of errors so far, of all parts.
    pub fn count(&self) -> usize {
        self.list.len()
    }

    /// An error of the part itself.
    pub fn add(&mut self, error: impl Display) {
        self.list.push(format!("{}: {error}", self.place));
    }

    /// Errors of the part that begin with their keys.
    pub fn extend(&mut self, errors: impl IntoIterator<Item = String>) {
        self.list.extend(errors.into_iter().map(|error| format!("{}.{error}", self.place)));
    }

    /// An error unless the value of a key fits.
    pub fn expect(&mut self, fits: bool, key: &str, expected: &str, found: impl Display) {
        if !fits {
            self.part(key).add(format_args!("expected {expected}, found {found}"));
        }
    }

    /// An error unless a number is in a range.
    pub fn range(&mut self, key: &str, value: f64, [min, max]: [f64; 2]) {
        self.expect((min..=max).contains(&value), key, &format!("{min} to {max}"), value);
    }

    /// An error unless a rate in Hz is one that a loop can keep and a person can wait for.
    pub fn rate_hz(&mut self, key: &str, value: f64) {
        self.range(key, value, RATE_HZ);
    }

    /// An error unless a duration in s is one that a clock in ns can tell from none, and at most a year.
    pub fn seconds(&mut self, key: &str, value: f64) {
        self.range(key, value, DURATION_S);
    }

    /// As [`Self::seconds`], in ms.
    pub fn milliseconds(&mut self, key: &str, value: f64) {
        self.range(key, value, DURATION_S.map(|end_s| 1e3 * end_s));
    }

    /// An error unless a number is finite.
    pub fn finite(&mut self, key: &str, value: f64) {
        self.expect(value.is_finite(), key, "a finite number", value);
    }

    /// An error unless a number is finite and not below 0.
    pub fn at_least_0(&mut self, key: &str, value: f64) {
        self.expect(value.is_finite() && value >= 0.0, key, "0 or more", value);
    }

    /// An error unless a number is finite and above 0.
    pub fn above_0(&mut self, key: &str, value: f64) {
        self.expect(value.is_finite() && value > 0.0, key, "a finite number above 0", value);
    }
}
