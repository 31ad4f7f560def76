//! Homogeneous tests of an incompressible elastomer in closed form.

use super::law::Hyperelastic;
use crate::algebra::Vec3;
use serde::{Deserialize, Serialize};

/// Deformation of a test with one measured stretch; tension above 1, compression below.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Deformation {
    /// Bar: stretches `l`, `l^-1/2`, `l^-1/2`.
    Uniaxial,
    /// Wide strip (pure shear): `l`, 1, `1 / l`.
    Planar,
    /// Equibiaxial: `l`, `l`, `l^-2`.
    Biaxial,
}

impl Deformation {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Uniaxial, Self::Planar, Self::Biaxial];

    /// Squared stretches; the last direction is free of stress.
    fn squared(self, stretch: f64) -> Vec3 {
        let x = stretch * stretch;
        match self {
            Self::Uniaxial => [x, 1.0 / stretch, 1.0 / stretch],
            Self::Planar => [x, 1.0, 1.0 / x],
            Self::Biaxial => [x, x, 1.0 / (x * x)],
        }
    }

    /// First invariant at a stretch.
    #[must_use]
    pub fn invariant(self, stretch: f64) -> f64 {
        self.squared(stretch).iter().sum()
    }

    /// Name in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Uniaxial => "uniaxial",
            Self::Planar => "planar",
            Self::Biaxial => "biaxial",
        }
    }
}

impl Hyperelastic {
    /// Nominal stress (MPa) at a stretch; `None` beyond the law's limit.
    pub fn nominal_stress_mpa(&self, deformation: Deformation, stretch: f64) -> Option<f64> {
        let t = self.principal(deformation.squared(stretch))?.t;
        Some((t[0] - t[2]) / stretch)
    }
}

/// First invariant of a bar.
pub(crate) fn invariant(stretch: f64) -> f64 {
    Deformation::Uniaxial.invariant(stretch)
}

/// Stretch of a bar in tension with this first invariant; infinite if the invariant is.
pub(crate) fn stretch_at(i1: f64) -> f64 {
    // Newton's method on l^3 - I l + 2 = 0 from above its largest root, where the cubic is convex and rises.
    if !i1.is_finite() {
        return f64::INFINITY;
    }
    let mut stretch = i1.sqrt();
    for _ in 0..60 {
        let slope = 3.0 * stretch * stretch - i1;
        if slope <= 0.0 {
            break;
        }
        stretch -= (stretch * (stretch * stretch - i1) + 2.0) / slope;
    }
    stretch.max(1.0)
}
