//! Rigid plate and block below the base: a penalty at the base's surface nodes against the plane `y = -gap`.

use rom::snapshots::Footprint;
use serde::{Deserialize, Serialize};

use super::penalty::{Penalty, penalty};
use crate::algebra::Vec3;

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
    pub(crate) fn at(self, gap_mm: f64) -> Self {
        match self {
            Self::None => Self::None,
            Self::Plate { .. } => Self::Plate { gap_mm },
            Self::Block { .. } => Self::Block { gap_mm },
        }
    }

    /// Whether both are the same body, at any distance.
    pub(crate) fn same_body(self, other: Self) -> bool {
        std::mem::discriminant(&self) == std::mem::discriminant(&other)
    }
}

/// A rigid face at a position, as the nodes see it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Face {
    /// Extent of the face.
    pub(crate) footprint: Footprint,
    /// Distance from the undeformed base (mm).
    pub(crate) gap_mm: f64,
    /// Width over which the penalty is rounded (mm).
    pub(crate) smoothing_mm: f64,
}

impl Face {
    /// Penalty terms of a node at deformed position `p`; `None` where it does not touch.
    #[inline]
    pub(crate) fn touch(&self, p: Vec3) -> Option<Penalty> {
        let overlap = -self.gap_mm - p[1];
        if overlap <= -self.smoothing_mm || !self.covers(p) {
            return None;
        }
        Some(penalty(overlap, self.smoothing_mm))
    }

    /// Whether a deformed point lies above or below the face.
    fn covers(&self, p: Vec3) -> bool {
        let inside = |v: f64, [low, high]: [f64; 2]| v >= low && v <= high;
        inside(p[0], self.footprint.x_mm) && inside(p[2], self.footprint.z_mm)
    }
}
