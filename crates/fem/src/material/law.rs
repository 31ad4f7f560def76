//! Hyperelastic laws: constants, energies, checks.

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Isochoric energy of the modified first invariant `I` (3 when undeformed) or of the isochoric principal stretches `l_i`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "law", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Hyperelastic {
    /// `W = -mu J_m / 2 ln(1 - (I - 3) / J_m)`: stiffens without bound as `I - 3` approaches `J_m` (Gent 1996).
    Gent {
        /// Initial shear modulus (MPa).
        mu_mpa: f64,
        /// Limit of `I - 3`.
        jm: f64,
    },
    /// `W = c10 (I - 3) + c01 (I2 - 3)`; the initial shear modulus is `2 (c10 + c01)`.
    MooneyRivlin {
        /// Constant of the first invariant (MPa).
        c10_mpa: f64,
        /// Constant of the second invariant (MPa).
        c01_mpa: f64,
    },
    /// `W = mu / 2 (I - 3)`.
    NeoHookean {
        /// Shear modulus (MPa).
        mu_mpa: f64,
    },
    /// `W = sum_k mu_k / alpha_k (l1^alpha_k + l2^alpha_k + l3^alpha_k - 3)`; the initial shear modulus is `sum_k mu_k alpha_k / 2`.
    Ogden {
        /// Factor of the first term (MPa).
        mu1_mpa: f64,
        /// Exponent of the first term.
        alpha1: f64,
        /// Factor of the second term (MPa); 0 without one.
        #[serde(default, skip_serializing_if = "is_zero")]
        mu2_mpa: f64,
        /// Exponent of the second term; 0 without one.
        #[serde(default, skip_serializing_if = "is_zero")]
        alpha2: f64,
        /// Factor of the third term (MPa); 0 without one.
        #[serde(default, skip_serializing_if = "is_zero")]
        mu3_mpa: f64,
        /// Exponent of the third term; 0 without one.
        #[serde(default, skip_serializing_if = "is_zero")]
        alpha3: f64,
    },
    /// `W = c10 (I - 3) + c20 (I - 3)^2 + c30 (I - 3)^3`; the initial shear modulus is `2 c10`.
    Yeoh {
        /// First constant (MPa).
        c10_mpa: f64,
        /// Second constant (MPa).
        c20_mpa: f64,
        /// Third constant (MPa).
        c30_mpa: f64,
    },
}

#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

/// Energy (MPa) and its first two derivatives with respect to the invariant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Energy {
    /// `W`.
    pub(crate) w: f64,
    /// `dW/dI`.
    pub(crate) d1: f64,
    /// `d2W/dI2`.
    pub(crate) d2: f64,
}

/// Term `mu / alpha (l1^alpha + l2^alpha + l3^alpha - 3)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Power {
    /// `mu` (MPa).
    pub(crate) mu_mpa: f64,
    /// `alpha`.
    pub(crate) alpha: f64,
}

/// Arguments of the energy.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Dependence {
    /// The first invariant.
    Invariant(Energy),
    /// The principal stretches; absent terms have `mu = 0`.
    Stretches([Power; 3]),
}

/// Fraction of the Gent limit beyond which a trial state is invalid: the stress is unbounded at the limit.
const GENT_FRACTION: f64 = 0.95;

impl Hyperelastic {
    /// Energy at the invariant `i1`, or the terms of a sum of powers; `None` beyond the law's limit (Gent locking).
    #[inline]
    pub(crate) fn at(&self, i1: f64) -> Option<Dependence> {
        let e = i1 - 3.0;
        let power = |mu_mpa, alpha| Power { mu_mpa, alpha };
        let energy = match *self {
            Self::Gent { mu_mpa, jm } => {
                let left = 1.0 - e / jm;
                if left < 1.0 - GENT_FRACTION {
                    return None;
                }
                let d1 = 0.5 * mu_mpa / left;
                Energy { w: -0.5 * mu_mpa * jm * left.ln(), d1, d2: d1 / (jm * left) }
            }
            Self::NeoHookean { mu_mpa } => Energy { w: 0.5 * mu_mpa * e, d1: 0.5 * mu_mpa, d2: 0.0 },
            Self::Yeoh { c10_mpa, c20_mpa, c30_mpa } => Energy {
                w: e * (c10_mpa + e * (c20_mpa + e * c30_mpa)),
                d1: c10_mpa + e * (2.0 * c20_mpa + 3.0 * e * c30_mpa),
                d2: 2.0 * c20_mpa + 6.0 * e * c30_mpa,
            },
            Self::MooneyRivlin { c10_mpa, c01_mpa } => {
                let terms = [power(2.0 * c10_mpa, 2.0), power(-2.0 * c01_mpa, -2.0), power(0.0, 0.0)];
                return Some(Dependence::Stretches(terms));
            }
            Self::Ogden { mu1_mpa, alpha1, mu2_mpa, alpha2, mu3_mpa, alpha3 } => {
                let terms = [power(mu1_mpa, alpha1), power(mu2_mpa, alpha2), power(mu3_mpa, alpha3)];
                return Some(Dependence::Stretches(terms));
            }
        };
        Some(Dependence::Invariant(energy))
    }

    /// Name of the law.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Gent { .. } => "Gent",
            Self::MooneyRivlin { .. } => "Mooney-Rivlin",
            Self::NeoHookean { .. } => "neo-Hookean",
            Self::Ogden { .. } => "Ogden",
            Self::Yeoh { .. } => "Yeoh",
        }
    }

    /// Name of the law in files: `yeoh`.
    pub fn key(&self) -> String {
        self.name().to_lowercase()
    }

    /// The law with its energy multiplied by a factor.
    pub(super) fn multiplied(mut self, factor: f64) -> Self {
        match &mut self {
            Self::Gent { mu_mpa, .. } | Self::NeoHookean { mu_mpa } => *mu_mpa *= factor,
            Self::MooneyRivlin { c10_mpa, c01_mpa } => {
                *c10_mpa *= factor;
                *c01_mpa *= factor;
            }
            Self::Ogden { mu1_mpa: a, mu2_mpa: b, mu3_mpa: c, .. }
            | Self::Yeoh { c10_mpa: a, c20_mpa: b, c30_mpa: c } => {
                [a, b, c].into_iter().for_each(|constant| *constant *= factor);
            }
        }
        self
    }

    /// Initial shear modulus (MPa).
    pub fn shear_modulus_mpa(&self) -> f64 {
        match *self {
            Self::Gent { mu_mpa, .. } | Self::NeoHookean { mu_mpa } => mu_mpa,
            Self::MooneyRivlin { c10_mpa, c01_mpa } => 2.0 * (c10_mpa + c01_mpa),
            Self::Ogden { mu1_mpa, alpha1, mu2_mpa, alpha2, mu3_mpa, alpha3 } => {
                0.5 * (mu1_mpa * alpha1 + mu2_mpa * alpha2 + mu3_mpa * alpha3)
            }
            Self::Yeoh { c10_mpa, .. } => 2.0 * c10_mpa,
        }
    }

    /// True if the signs of the constants alone make the law stable at every stretch.
    pub(crate) fn is_always_stable(&self) -> bool {
        match *self {
            Self::Gent { .. } | Self::NeoHookean { .. } => true,
            Self::MooneyRivlin { c10_mpa, c01_mpa } => c10_mpa >= 0.0 && c01_mpa >= 0.0,
            Self::Ogden { mu1_mpa, alpha1, mu2_mpa, alpha2, mu3_mpa, alpha3 } => {
                mu1_mpa * alpha1 >= 0.0 && mu2_mpa * alpha2 >= 0.0 && mu3_mpa * alpha3 >= 0.0
            }
            Self::Yeoh { c20_mpa, c30_mpa, .. } => c20_mpa >= 0.0 && c30_mpa >= 0.0,
        }
    }

    /// Constants by the names of the file.
    pub fn constants(&self) -> Vec<(&'static str, f64)> {
        match *self {
            Self::Gent { mu_mpa, jm } => vec![("mu_mpa", mu_mpa), ("jm", jm)],
            Self::MooneyRivlin { c10_mpa, c01_mpa } => vec![("c10_mpa", c10_mpa), ("c01_mpa", c01_mpa)],
            Self::NeoHookean { mu_mpa } => vec![("mu_mpa", mu_mpa)],
            Self::Ogden { mu1_mpa, alpha1, mu2_mpa, alpha2, mu3_mpa, alpha3 } => {
                let mut all = vec![("mu1_mpa", mu1_mpa), ("alpha1", alpha1)];
                if mu2_mpa != 0.0 {
                    all.extend([("mu2_mpa", mu2_mpa), ("alpha2", alpha2)]);
                }
                if mu3_mpa != 0.0 {
                    all.extend([("mu3_mpa", mu3_mpa), ("alpha3", alpha3)]);
                }
                all
            }
            Self::Yeoh { c10_mpa, c20_mpa, c30_mpa } => {
                vec![("c10_mpa", c10_mpa), ("c20_mpa", c20_mpa), ("c30_mpa", c30_mpa)]
            }
        }
    }

    /// The law with `change` added to the constant at `index` of [`Self::constants`].
    pub(super) fn with(mut self, index: usize, change: f64) -> Self {
        let slots: [Option<&mut f64>; 6] = match &mut self {
            Self::Gent { mu_mpa, jm } => [Some(mu_mpa), Some(jm), None, None, None, None],
            Self::MooneyRivlin { c10_mpa, c01_mpa } => [Some(c10_mpa), Some(c01_mpa), None, None, None, None],
            Self::NeoHookean { mu_mpa } => [Some(mu_mpa), None, None, None, None, None],
            Self::Ogden { mu1_mpa, alpha1, mu2_mpa, alpha2, mu3_mpa, alpha3 } => {
                [mu1_mpa, alpha1, mu2_mpa, alpha2, mu3_mpa, alpha3].map(Some)
            }
            Self::Yeoh { c10_mpa, c20_mpa, c30_mpa } => {
                [Some(c10_mpa), Some(c20_mpa), Some(c30_mpa), None, None, None]
            }
        };
        if let Some(slot) = slots.into_iter().nth(index).flatten() {
            *slot += change;
        }
        self
    }

    /// Checks the constants by themselves.
    pub(super) fn check(&self) -> Result<(), MaterialError> {
        let law = self.name();
        if let Some((name, found)) = self.constants().into_iter().find(|(_, value)| !value.is_finite()) {
            return Err(MaterialError { law, name, found, expected: "a finite number" });
        }
        match *self {
            Self::Gent { mu_mpa, jm } => {
                positive(law, "mu_mpa", mu_mpa)?;
                positive(law, "jm", jm)
            }
            Self::NeoHookean { mu_mpa } => positive(law, "mu_mpa", mu_mpa),
            Self::Yeoh { c10_mpa, .. } => positive(law, "c10_mpa", c10_mpa),
            Self::MooneyRivlin { .. } => positive(law, "2 (c10_mpa + c01_mpa)", self.shear_modulus_mpa()),
            Self::Ogden { mu1_mpa, alpha1, mu2_mpa, alpha2, mu3_mpa, alpha3 } => {
                for (name, mu_mpa, alpha) in
                    [("alpha1", mu1_mpa, alpha1), ("alpha2", mu2_mpa, alpha2), ("alpha3", mu3_mpa, alpha3)]
                {
                    if mu_mpa != 0.0 && alpha == 0.0 {
                        return Err(MaterialError {
                            law,
                            name,
                            found: alpha,
                            expected: "another number than 0",
                        });
                    }
                }
                positive(law, "sum of mu alpha / 2", self.shear_modulus_mpa())
            }
        }
    }
}

/// Material constant outside the range in which the law is valid.
#[derive(Clone, Debug, Error, PartialEq)]
#[error("{law}: {name} = {found}, expected {expected}; correct the material's constants")]
pub struct MaterialError {
    /// The law the constant belongs to.
    pub law: &'static str,
    /// Name of the constant.
    pub name: &'static str,
    /// Value found.
    pub found: f64,
    /// Accepted values.
    pub expected: &'static str,
}

pub(crate) fn positive(law: &'static str, name: &'static str, found: f64) -> Result<(), MaterialError> {
    if found.is_finite() && found > 0.0 {
        return Ok(());
    }
    Err(MaterialError { law, name, found, expected: "a finite number above 0" })
}

pub(crate) fn at_least_zero(law: &'static str, name: &'static str, found: f64) -> Result<(), MaterialError> {
    if found.is_finite() && found >= 0.0 {
        return Ok(());
    }
    Err(MaterialError { law, name, found, expected: "a finite number, 0 or more" })
}
