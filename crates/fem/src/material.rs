//! Constitutive laws: isochoric hyperelastic energies of the first invariant, and the linear elastic sheet.
//!
//! The elastomer's energy per undeformed volume is `W(I) + p (J - 1) - p^2 / (2 K)` with `I = J^(-2/3) tr(F^T F)`
//! and one pressure `p` per element, so only `W`, `W'` and `W''` differ between laws.

use serde::{Deserialize, Serialize};
use thiserror::Error;

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

/// Isochoric energy as a function of the modified first invariant `I` (3 when undeformed).
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
    /// `W = mu / 2 (I - 3)`.
    NeoHookean {
        /// Shear modulus (MPa).
        mu_mpa: f64,
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

/// Fraction of the Gent limit beyond which a trial state is invalid: the stress is unbounded at the limit.
const GENT_FRACTION: f64 = 0.95;

impl Hyperelastic {
    /// Energy and derivatives at the invariant `i1`; `None` beyond the law's limit (Gent locking).
    #[inline]
    pub(crate) fn energy(&self, i1: f64) -> Option<Energy> {
        let e = i1 - 3.0;
        match *self {
            Self::Gent { mu_mpa, jm } => {
                let left = 1.0 - e / jm;
                if left < 1.0 - GENT_FRACTION {
                    return None;
                }
                let d1 = 0.5 * mu_mpa / left;
                Some(Energy { w: -0.5 * mu_mpa * jm * left.ln(), d1, d2: d1 / (jm * left) })
            }
            Self::NeoHookean { mu_mpa } => Some(Energy { w: 0.5 * mu_mpa * e, d1: 0.5 * mu_mpa, d2: 0.0 }),
            Self::Yeoh { c10_mpa, c20_mpa, c30_mpa } => Some(Energy {
                w: e * (c10_mpa + e * (c20_mpa + e * c30_mpa)),
                d1: c10_mpa + e * (2.0 * c20_mpa + 3.0 * e * c30_mpa),
                d2: 2.0 * c20_mpa + 6.0 * e * c30_mpa,
            }),
        }
    }

    /// Initial shear modulus (MPa).
    #[must_use]
    pub fn shear_modulus_mpa(&self) -> f64 {
        match *self {
            Self::Gent { mu_mpa, .. } | Self::NeoHookean { mu_mpa } => mu_mpa,
            Self::Yeoh { c10_mpa, .. } => 2.0 * c10_mpa,
        }
    }

    fn check(&self) -> Result<(), MaterialError> {
        match *self {
            Self::Gent { mu_mpa, jm } => {
                positive("Gent", "mu_mpa", mu_mpa)?;
                positive("Gent", "jm", jm)
            }
            Self::NeoHookean { mu_mpa } => positive("neo-Hookean", "mu_mpa", mu_mpa),
            Self::Yeoh { c10_mpa, c20_mpa, c30_mpa } => {
                positive("Yeoh", "c10_mpa", c10_mpa)?;
                // A negative c20 is common in fits; W' must stay positive for every stretch.
                let finite = c20_mpa.is_finite() && c30_mpa.is_finite();
                let rising = if c30_mpa > 0.0 {
                    c20_mpa >= 0.0 || c20_mpa * c20_mpa < 3.0 * c10_mpa * c30_mpa
                } else {
                    c30_mpa >= 0.0 && c20_mpa >= 0.0
                };
                if finite && rising {
                    return Ok(());
                }
                let expected = "constants with dW/dI > 0 at every stretch (c20^2 < 3 c10 c30 when c20 < 0)";
                Err(MaterialError { law: "Yeoh", name: "c20_mpa", found: c20_mpa, expected })
            }
        }
    }
}

/// Volume change that the bulk modulus resists.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum VolumeChange {
    /// Mean over each element: nearly incompressible rubber does not lock.
    #[default]
    Mean,
    /// Value at each Gauss point, as in the C3D10 of other programs: for compressible rubber; a large bulk modulus locks.
    Points,
}

impl VolumeChange {
    fn is_mean(&self) -> bool {
        *self == Self::Mean
    }
}

/// A nearly incompressible elastomer.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Elastomer {
    /// Isochoric energy.
    pub law: Hyperelastic,
    /// Bulk modulus `K` (MPa); 2000 for rubber.
    pub bulk_mpa: f64,
    /// Mass density (t/mm3).
    pub density_t_per_mm3: f64,
    /// Volume change that the bulk modulus resists; default: the mean over each element.
    #[serde(default, skip_serializing_if = "VolumeChange::is_mean")]
    pub volume_change: VolumeChange,
}

impl Elastomer {
    /// Bulk modulus of the element pressure (MPa); 0 if each Gauss point has its own pressure.
    pub(crate) fn element_bulk_mpa(&self) -> f64 {
        if self.volume_change.is_mean() { self.bulk_mpa } else { 0.0 }
    }

    /// Bulk modulus of the pressure at each Gauss point (MPa); 0 if the element has one pressure.
    pub(crate) fn point_bulk_mpa(&self) -> f64 {
        self.bulk_mpa - self.element_bulk_mpa()
    }

    /// Checks that the formulation is valid for the constants.
    ///
    /// # Errors
    /// [`MaterialError`] names the first constant out of range.
    pub(crate) fn check(&self) -> Result<(), MaterialError> {
        self.law.check()?;
        // Below ten shear moduli the split into W(I) and pressure no longer describes a rubber.
        if !(self.bulk_mpa.is_finite() && self.bulk_mpa >= 10.0 * self.law.shear_modulus_mpa()) {
            let expected = "at least 10 times the shear modulus";
            return Err(MaterialError { law: "elastomer", name: "bulk_mpa", found: self.bulk_mpa, expected });
        }
        at_least_zero("elastomer", "density_t_per_mm3", self.density_t_per_mm3)
    }
}

/// The strain-limiting sheet: a linear elastic plate, weightless as in the authors' model.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SheetMaterial {
    /// Young's modulus (MPa).
    pub youngs_mpa: f64,
    /// Poisson's ratio.
    pub poisson: f64,
    /// Thickness (mm).
    pub thickness_mm: f64,
    /// Interior-penalty factor `eta` of the plate bending across element edges (5 is stable on quadratic triangles).
    pub bending_penalty: f64,
}

impl SheetMaterial {
    /// Bending stiffness `D = E t^3 / (12 (1 - nu^2))` (N mm).
    pub(crate) fn bending_stiffness_n_mm(&self) -> f64 {
        self.youngs_mpa * self.thickness_mm.powi(3) / (12.0 * (1.0 - self.poisson * self.poisson))
    }

    /// Plane-stress membrane stiffness: the entries 11, 12 and 33 of the resultant-strain relation (N/mm).
    pub(crate) fn membrane_stiffness_n_per_mm(&self) -> [f64; 3] {
        let c11 = self.youngs_mpa * self.thickness_mm / (1.0 - self.poisson * self.poisson);
        [c11, c11 * self.poisson, 0.5 * c11 * (1.0 - self.poisson)]
    }

    /// Checks that the constants are in range.
    ///
    /// # Errors
    /// [`MaterialError`] names the first constant out of range.
    pub(crate) fn check(&self) -> Result<(), MaterialError> {
        positive("sheet", "youngs_mpa", self.youngs_mpa)?;
        positive("sheet", "thickness_mm", self.thickness_mm)?;
        positive("sheet", "bending_penalty", self.bending_penalty)?;
        if self.poisson > -1.0 && self.poisson < 0.5 {
            return Ok(());
        }
        let expected = "between -1 and 0.5";
        Err(MaterialError { law: "sheet", name: "poisson", found: self.poisson, expected })
    }
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
