//! Rigid plate and block below the base: a penalty at the base's surface nodes against the plane `y = -gap`.

use serde::{Deserialize, Serialize};

use super::{Penalty, penalty};
use crate::algebra::Vec3;

/// Extent of a rigid body's near face in the plane `y = -gap` (mm, actuator frame).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Footprint {
    /// Lower and upper x.
    pub x_mm: [f64; 2],
    /// Lower and upper z.
    pub z_mm: [f64; 2],
}

impl Footprint {
    /// Whether a deformed point lies above or below the face.
    #[must_use]
    pub fn covers(&self, p: Vec3) -> bool {
        let inside = |v: f64, [low, high]: [f64; 2]| v >= low && v <= high;
        inside(p[0], self.x_mm) && inside(p[2], self.z_mm)
    }
}

/// What the base may touch.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Obstacle {
    /// Nothing: free bending.
    #[default]
    None,
    /// The plate, its top face at `y = -gap_mm`.
    Plate {
        /// Distance from the underside of the undeformed base (mm).
        gap_mm: f64,
    },
    /// The block, its near face at `y = -gap_mm`.
    Block {
        /// Distance from the underside of the undeformed base (mm).
        gap_mm: f64,
    },
}

impl Obstacle {
    /// Distance from the undeformed base, if there is an obstacle (mm).
    #[must_use]
    pub fn gap_mm(self) -> Option<f64> {
        match self {
            Self::None => None,
            Self::Plate { gap_mm } | Self::Block { gap_mm } => Some(gap_mm),
        }
    }

    /// The same obstacle at another distance.
    #[must_use]
    pub fn at(self, gap_mm: f64) -> Self {
        match self {
            Self::None => Self::None,
            Self::Plate { .. } => Self::Plate { gap_mm },
            Self::Block { .. } => Self::Block { gap_mm },
        }
    }

    /// Whether two loads meet the same body, wherever it stands.
    #[must_use]
    pub fn same_body(self, other: Self) -> bool {
        std::mem::discriminant(&self) == std::mem::discriminant(&other)
    }
}

/// A rigid face at a position, as the nodes see it.
#[derive(Clone, Copy, Debug)]
pub struct Face {
    /// Extent of the face.
    pub footprint: Footprint,
    /// Distance from the undeformed base (mm).
    pub gap_mm: f64,
    /// Width over which the penalty is rounded (mm).
    pub smoothing_mm: f64,
}

impl Face {
    /// Penalty terms of a node at deformed position `p`; `None` where it does not touch.
    #[inline]
    #[must_use]
    pub fn touch(&self, p: Vec3) -> Option<Penalty> {
        let overlap = -self.gap_mm - p[1];
        if overlap <= -self.smoothing_mm || !self.footprint.covers(p) {
            return None;
        }
        Some(penalty(overlap, self.smoothing_mm))
    }
}
