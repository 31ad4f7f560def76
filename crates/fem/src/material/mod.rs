//! Constitutive laws: isochoric hyperelastic energies, and the linear elastic sheet.
//!
//! The elastomer's energy per undeformed volume is `W + p (J - 1) - p^2 / (2 K)` with one pressure `p` per element. `W` is a function of
//! `I = J^(-2/3) tr(F^T F)`, or a sum of powers of the principal stretches of `J^(-1/3) F`.

mod columns;
mod file;
mod film;
pub mod fit;
mod law;
mod least_squares;
mod principal;
mod report;
pub mod silicone;
mod specimen;
mod tension;

pub use columns::{
    CurveOrigin, DeformationQuantity, LawName, LoadQuantity, LoadingBranch, TestColumn, TestDescription,
    TestKind, read_list,
};
pub use file::{FitRecord, MaterialFile, TestRecord, material_text};
pub use film::{Fibres, Film, Isotropic};
pub(crate) use law::{Dependence, Power, at_least_zero, positive};
pub use law::{Hyperelastic, MaterialError};
pub(crate) use principal::{Principal, is_stable_invariant};
pub use report::FitReport;
pub use specimen::{FitError, FittedSpecimens, Specimen};
pub use tension::Deformation;
pub(crate) use tension::{invariant as bar_invariant, stretch_at as bar_stretch};

use serde::{Deserialize, Serialize};

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
    /// Stretches of a bar in tension or compression between which the law was fitted; required of a law that is not stable everywhere.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stretch_range: Option<[f64; 2]>,
    /// Interval of the initial shear modulus (MPa) of constants that were not measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shear_interval_mpa: Option<[f64; 2]>,
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

    /// The elastomer with its isochoric energy multiplied by a factor.
    pub(crate) fn stiffened(&self, factor: f64) -> Self {
        Self { law: self.law.multiplied(factor), ..*self }
    }

    /// Checks that the formulation is valid for the constants.
    ///
    /// # Errors
    /// [`MaterialError`] names the first constant out of range.
    pub(crate) fn check(&self) -> Result<(), MaterialError> {
        // Below ten shear moduli the constants are hardly those of a rubber.
        self.check_bulk(10.0, "at least 10 times the shear modulus")?;
        self.check_solid()
    }

    fn check_bulk(&self, times: f64, expected: &'static str) -> Result<(), MaterialError> {
        if self.bulk_mpa.is_finite() && self.bulk_mpa >= times * self.law.shear_modulus_mpa() {
            return Ok(());
        }
        Err(MaterialError { law: "elastomer", name: "bulk_mpa", found: self.bulk_mpa, expected })
    }

    /// Checks the constants of any solid, also of one that is stiff and compressible.
    ///
    /// # Errors
    /// [`MaterialError`] names the first constant out of range.
    pub(crate) fn check_solid(&self) -> Result<(), MaterialError> {
        self.law.check()?;
        self.check_stability()?;
        if let Some([low, high]) = self.shear_interval_mpa {
            let shear = self.law.shear_modulus_mpa();
            if !(low > 0.0 && low <= shear && high >= shear && high.is_finite()) {
                let expected = "[low, high] in MPa around the initial shear modulus";
                return Err(MaterialError {
                    law: "elastomer",
                    name: "shear_interval_mpa",
                    found: shear,
                    expected,
                });
            }
        }
        // Poisson's ratio is 0 at two thirds of the shear modulus.
        self.check_bulk(2.0 / 3.0, "at least two thirds of the shear modulus: Poisson's ratio of 0 or more")?;
        at_least_zero("elastomer", "density_t_per_mm3", self.density_t_per_mm3)
    }
}

impl Elastomer {
    /// Checks that the law is stable over its range, or everywhere without one.
    fn check_stability(&self) -> Result<(), MaterialError> {
        let error =
            |name, found, expected| Err(MaterialError { law: self.law.name(), name, found, expected });
        let Some([low, high]) = self.stretch_range else {
            return match self.law.stable_to() {
                Some(stretch) => error("stretch_range", stretch, LIMITED),
                None => Ok(()),
            };
        };
        if !(low > 0.0 && low <= 1.0 && high >= 1.0 && high.is_finite()) {
            return error(
                "stretch_range",
                if low > 0.0 && low <= 1.0 { high } else { low },
                "[low, high] around 1",
            );
        }
        let needed = tension::invariant(low).max(tension::invariant(high));
        match self.law.stable_to() {
            Some(stretch) if tension::invariant(stretch) < needed => error("stretch_range", stretch, STABLE),
            _ => Ok(()),
        }
    }
}

const LIMITED: &str = "a range that ends at the stretch found, from which on the law is unstable, or constants that are stable everywhere";
const STABLE: &str = "a range within the stretch found, from which on the law is unstable";

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

    /// The sheet without its bending stiffness.
    pub(crate) fn membrane(&self) -> Isotropic {
        let Self { youngs_mpa, poisson, thickness_mm, .. } = *self;
        Isotropic { youngs_mpa, poisson, thickness_mm }
    }

    /// Checks that the constants are in range.
    ///
    /// # Errors
    /// [`MaterialError`] names the first constant out of range.
    pub(crate) fn check(&self) -> Result<(), MaterialError> {
        positive("sheet", "bending_penalty", self.bending_penalty)?;
        self.membrane().check("sheet")
    }
}
