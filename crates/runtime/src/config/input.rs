//! Sources of the values of a model's inputs other than pressure and gap.

use crate::problems::Problems;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use wire::layout::{PARAMETERS_MAX, pack_slot};

/// Inputs by name (`load_n`, `"elastomer.law.mu_mpa"`).
pub type InputSpecs = BTreeMap<String, InputFrom>;

/// The word `"measured"`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Measured {
    /// `"measured"`.
    Measured,
}

/// Where the value of an input comes from.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum InputFrom {
    /// `thickness_mm = 7.3`: given in the scene.
    Given(f64),
    /// `load_n = "measured"`: every reading has it, any value can occur.
    Measured(Measured),
    /// `load_n = { min = 0.0, max = 4.0, sigma = 0.05 }`: measured, within a range.
    Within(WithinSpec),
}

/// A measured input with what is known of its values.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct WithinSpec {
    /// Smallest value that can occur.
    pub min: f64,
    /// Largest value that can occur.
    pub max: f64,
    /// Standard deviation of the noise of a reading, for the estimation; a sensor's own goes before it.
    pub sigma: Option<f64>,
}

impl Default for WithinSpec {
    fn default() -> Self {
        Self { min: f64::NEG_INFINITY, max: f64::INFINITY, sigma: None }
    }
}

impl InputFrom {
    /// The value that the scene gives, if it does.
    pub fn given(self) -> Option<f64> {
        match self {
            Self::Given(value) => Some(value),
            Self::Measured(_) | Self::Within(_) => None,
        }
    }

    /// Range and noise of a measured input; `None` for a given one.
    pub fn measured(self) -> Option<WithinSpec> {
        match self {
            Self::Given(_) => None,
            Self::Measured(_) => Some(WithinSpec::default()),
            Self::Within(within) => Some(within),
        }
    }
}

/// All errors in the inputs of an actuator; `is_estimated` is true for estimated ones.
pub(super) fn problems<'a>(
    inputs: &InputSpecs,
    is_estimated: impl Fn(&str) -> bool,
    observables: impl Iterator<Item = &'a String>,
    problems: &mut Problems,
) {
    let mut ends = BTreeSet::new();
    let mut is_new = |name: &str| ends.insert(pack_slot(name));
    for (name, from) in inputs {
        let key = format!("inputs.\"{name}\"");
        let mut expect = |fits: bool, expected: &str, found: String| {
            problems.expect(fits, &key, expected, found);
        };
        if let Some(value) = from.given() {
            expect(value.is_finite(), "a number", value.to_string());
        }
        let Some(WithinSpec { min, max, sigma }) = from.measured() else { continue };
        expect(min < max, "min below max", format!("{min} .. {max}"));
        let sigma = sigma.unwrap_or(1.0);
        expect(sigma.is_finite() && sigma > 0.0, "a sigma above 0", sigma.to_string());
        let own = ["pressure_mpa", "gap_mm"].contains(&name.as_str());
        expect(!own, "an input other than pressure and gap", name.clone());
        expect(!is_estimated(name), "an input that is either measured or estimated", "both".into());
        expect(is_new(name), "measured inputs that differ in their last 31 letters", "two alike".into());
    }
    for name in observables {
        let expected = "a name that differs from those of measured inputs in its last 31 letters";
        problems.expect(is_new(name), &format!("observables.{name}"), expected, "two alike");
    }
    let (count, expected) = (ends.len(), format!("at most {PARAMETERS_MAX} measured"));
    problems.expect(count <= PARAMETERS_MAX, "inputs, observables", &expected, count);
}

#[cfg(test)]
#[path = "../../tests/unit/config_input.rs"]
mod tests;
