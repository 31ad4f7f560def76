//! Results of checks.

use serde::Serialize;
use std::fmt::{self, Display};

/// How serious a finding is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum FindingLevel {
    /// As it should be.
    Good,
    /// Works, not as well as it could.
    Warning,
    /// Does not work.
    Bad,
}

/// The result of one check.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Finding {
    pub subject: String,
    /// How serious it is.
    pub level: FindingLevel,
    pub found: String,
    /// Remedy; empty if there is no problem.
    pub remedy: String,
}

impl Finding {
    /// All is well.
    pub fn good(subject: &str, found: impl Display) -> Self {
        Self::new(FindingLevel::Good, subject, found, "")
    }

    /// Not as good as it could be.
    pub fn warning(subject: &str, found: impl Display, remedy: impl Into<String>) -> Self {
        Self::new(FindingLevel::Warning, subject, found, remedy)
    }

    /// Does not work.
    pub fn bad(subject: &str, found: impl Display, remedy: impl Into<String>) -> Self {
        Self::new(FindingLevel::Bad, subject, found, remedy)
    }

    /// A missing wish: bad when the settings ask for it.
    pub fn missing(is_wanted: bool, subject: &str, found: impl Display, remedy: impl Into<String>) -> Self {
        let level = if is_wanted { FindingLevel::Bad } else { FindingLevel::Warning };
        Self::new(level, subject, found, remedy)
    }

    fn new(level: FindingLevel, subject: &str, found: impl Display, remedy: impl Into<String>) -> Self {
        Self { subject: subject.into(), level, found: found.to_string(), remedy: remedy.into() }
    }
}

impl Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let level = match self.level {
            FindingLevel::Good => "ok  ",
            FindingLevel::Warning => "warn",
            FindingLevel::Bad => "BAD ",
        };
        write!(f, "{level}  {}: {}", self.subject, self.found)?;
        if self.remedy.is_empty() { Ok(()) } else { write!(f, "\n      -> {}", self.remedy) }
    }
}

#[cfg(test)]
#[path = "../../../tests/unit/cmd_doctor_finding.rs"]
mod tests;
