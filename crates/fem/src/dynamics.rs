//! Constants of motion: damping and relaxation.

use crate::material::MaterialError;
use serde::{Deserialize, Serialize};

/// Damping in proportion to the stiffness, and relaxation of the elastomer's deviatoric stress.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Dynamics {
    /// Damping force per rate of the internal force (s).
    #[serde(default = "default_beta_s")]
    pub beta_s: f64,
    /// Prony series of the deviatoric stress, `G(t) = G0 (1 - sum w_i (1 - exp(-t / tau_i)))`. The elastomer's law is the
    /// long-term one, `G(infinity) = G0 (1 - sum w_i)`, which static states have.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub prony: Vec<PronyTerm>,
}

/// Term of a Prony series.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PronyTerm {
    /// Part `w_i` of the instantaneous stiffness that relaxes.
    pub weight: f64,
    /// Relaxation time `tau_i` (s).
    pub time_s: f64,
}

fn default_beta_s() -> f64 {
    0.002
}

impl Default for Dynamics {
    fn default() -> Self {
        Self { beta_s: default_beta_s(), prony: Vec::new() }
    }
}

/// Largest damping (s), beyond that of any elastomer.
const MAX_BETA_S: f64 = 1.0;

impl Dynamics {
    /// Terms as ratio `w_i / (1 - sum w)` of the long-term stiffness, and time (s).
    pub fn ratios(&self) -> Vec<(f64, f64)> {
        let rest = 1.0 - self.prony.iter().map(|term| term.weight).sum::<f64>();
        self.prony.iter().map(|term| (term.weight / rest, term.time_s)).collect()
    }

    /// Checks that damping and series are in range.
    ///
    /// # Errors
    /// [`MaterialError`] names the first constant out of range.
    pub(crate) fn check(&self) -> Result<(), MaterialError> {
        let wrong = |name, found, expected| Err(MaterialError { law: "dynamics", name, found, expected });
        if !(0.0..=MAX_BETA_S).contains(&self.beta_s) {
            return wrong("beta_s", self.beta_s, "0 to 1 s");
        }
        for term in &self.prony {
            if !(term.weight > 0.0 && term.weight < 1.0) {
                return wrong("prony.weight", term.weight, "above 0 and below 1");
            }
            if !(term.time_s > 0.0 && term.time_s.is_finite()) {
                return wrong("prony.time_s", term.time_s, "a finite time above 0 s");
            }
        }
        let sum: f64 = self.prony.iter().map(|term| term.weight).sum();
        if sum < 1.0 {
            return Ok(());
        }
        wrong("prony", sum, "weights with a sum below 1: the long-term stiffness is above 0")
    }
}
