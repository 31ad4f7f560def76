//! Membranes on named surfaces: isotropic, reinforced by fibres, or both.

use super::law::{MaterialError, at_least_zero, positive};
use serde::{Deserialize, Serialize};

/// A membrane without bending stiffness and weight.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Film {
    /// Direction of the angle 0, projected on the surface.
    #[serde(default = "along_x")]
    pub axis: [f64; 3],
    /// Linear elastic film.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub isotropic: Option<Isotropic>,
    /// Families of parallel fibres.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub fibres: Vec<Fibres>,
}

/// A linear elastic film.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Isotropic {
    /// Young's modulus (MPa).
    pub youngs_mpa: f64,
    /// Poisson's ratio.
    pub poisson: f64,
    /// Thickness (mm).
    pub thickness_mm: f64,
}

/// Parallel fibres that carry tension only.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fibres {
    /// Angle from the film's axis, anticlockwise seen from outside (degrees).
    pub angle_deg: f64,
    /// Distance between neighbouring fibres (mm).
    pub spacing_mm: f64,
    /// Force per strain of one fibre, `E A` (N).
    pub stiffness_n: f64,
}

fn along_x() -> [f64; 3] {
    [1.0, 0.0, 0.0]
}

impl Isotropic {
    /// Plane-stress stiffness: the entries 11, 12 and 33 of the resultant-strain relation (N/mm).
    pub(crate) fn stiffness_n_per_mm(&self) -> [f64; 3] {
        let c11 = self.youngs_mpa * self.thickness_mm / (1.0 - self.poisson * self.poisson);
        [c11, c11 * self.poisson, 0.5 * c11 * (1.0 - self.poisson)]
    }

    pub(crate) fn check(&self, law: &'static str) -> Result<(), MaterialError> {
        positive(law, "youngs_mpa", self.youngs_mpa)?;
        positive(law, "thickness_mm", self.thickness_mm)?;
        if self.poisson > -1.0 && self.poisson < 0.5 {
            return Ok(());
        }
        let expected = "between -1 and 0.5";
        Err(MaterialError { law, name: "poisson", found: self.poisson, expected })
    }
}

impl Film {
    /// Checks that the constants are in range.
    ///
    /// # Errors
    /// [`MaterialError`] names the first constant out of range.
    pub(crate) fn check(&self) -> Result<(), MaterialError> {
        let error = |name, found, expected| Err(MaterialError { law: "film", name, found, expected });
        let length = self.axis.iter().map(|v| v * v).sum::<f64>();
        if !(length.is_finite() && length > 0.0) {
            return error("axis", length.sqrt(), "a direction with finite components, not all 0");
        }
        if self.isotropic.is_none() && self.fibres.is_empty() {
            return error("fibres", 0.0, "at least one family of fibres, or isotropic");
        }
        if let Some(isotropic) = &self.isotropic {
            isotropic.check("film")?;
        }
        for fibres in &self.fibres {
            if !fibres.angle_deg.is_finite() {
                return error("angle_deg", fibres.angle_deg, "a finite angle");
            }
            positive("film", "spacing_mm", fibres.spacing_mm)?;
            at_least_zero("film", "stiffness_n", fibres.stiffness_n)?;
        }
        Ok(())
    }
}
