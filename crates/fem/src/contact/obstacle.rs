//! Rigid bodies below the base: a penalty at the base's surface nodes against the plane `y = -gap` (plate, block), or against
//! a sphere or cylinder whose highest point lies in it, by the signed distance.

use rom::snapshots::Footprint;
use serde::{Deserialize, Serialize};

use super::penalty::{Penalty, penalty};
use crate::algebra::{Mat3, Vec3, axpy, norm, outer, scale, sub};

/// Obstacle below the base.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Obstacle {
    /// Nothing: free bending.
    #[default]
    None,
    /// The plate, its top face at `y = -gap_mm`; or the round body, with its highest point there.
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

    /// True if both are the same body, at any distance.
    pub(crate) fn same_body(self, other: Self) -> bool {
        std::mem::discriminant(&self) == std::mem::discriminant(&other)
    }
}

/// Round body instead of the plate.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Round {
    /// Its form.
    pub form: Form,
    /// Radius (mm).
    pub radius_mm: f64,
    /// x and z (mm) of its highest point, which lies in the plane `y = -gap`; of a cylinder x counts.
    pub centre_mm: [f64; 2],
}

/// Forms of a round body.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Form {
    /// A sphere.
    Sphere,
    /// A cylinder along z, across the actuator.
    Cylinder,
}

/// Surface of a rigid body: a plane, or the part of a round body within its extent.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Face {
    /// Extent of the body.
    pub(crate) footprint: Footprint,
    /// Round form; `None`: a plane.
    pub(crate) round: Option<Round>,
    /// Distance from the undeformed base (mm).
    pub(crate) gap_mm: f64,
    /// Width over which the penalty is rounded (mm).
    pub(crate) smoothing_mm: f64,
}

/// Contact terms of a node at a surface of unit stiffness.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Touch {
    /// Terms along the normal.
    pub(crate) penalty: Penalty,
    /// Unit normal, out of the obstacle.
    pub(crate) normal: Vec3,
    /// Derivative of the normal with respect to the node's position (1/mm): the surface's curvature, 0 for a plane.
    pub(crate) turning: Mat3,
}

impl Touch {
    /// Force on the node per stiffness (mm).
    pub(crate) fn force(&self) -> Vec3 {
        scale(self.penalty.force, self.normal)
    }

    /// Tangent per stiffness: minus the derivative of the force with respect to the node's position.
    pub(crate) fn tangent(&self) -> Mat3 {
        let mut block = outer(self.penalty.stiffness, self.normal, self.normal);
        block.iter_mut().zip(self.turning).for_each(|(row, turning)| axpy(-self.penalty.force, turning, row));
        block
    }

    /// Force on the obstacle along y per stiffness (mm), as measured by a load cell below it.
    pub(crate) fn vertical(&self) -> f64 {
        self.penalty.force * self.normal[1]
    }
}

impl Face {
    /// Contact terms of a node at deformed position `p`; `None` if it does not touch.
    #[inline]
    pub(crate) fn touch(&self, p: Vec3) -> Option<Touch> {
        let Some(round) = self.round else {
            let overlap = -self.gap_mm - p[1];
            let touches = overlap > -self.smoothing_mm && self.covers(p);
            return touches.then(|| Touch {
                penalty: penalty(overlap, self.smoothing_mm),
                normal: [0.0, 1.0, 0.0],
                turning: [[0.0; 3]; 3],
            });
        };
        let arm = self.arm(&round, p);
        let distance = norm(arm);
        let overlap = round.radius_mm - distance;
        // The normal is undefined at the centre, which no solution comes near.
        if overlap <= -self.smoothing_mm || !self.covers(p) || distance <= 0.0 {
            return None;
        }
        let normal = scale(1.0 / distance, arm);
        let mut turning = outer(-1.0 / distance, normal, normal);
        for (k, row) in turning.iter_mut().enumerate().filter(|(k, _)| *k < 2 || round.form == Form::Sphere) {
            row[k] += 1.0 / distance;
        }
        Some(Touch { penalty: penalty(overlap, self.smoothing_mm), normal, turning })
    }

    /// From the centre of a round body, or the axis of a cylinder, to a point.
    fn arm(&self, round: &Round, p: Vec3) -> Vec3 {
        let [x, z] = round.centre_mm;
        let arm = sub(p, [x, -self.gap_mm - round.radius_mm, z]);
        if round.form == Form::Cylinder { [arm[0], arm[1], 0.0] } else { arm }
    }

    /// Depth of a deformed point behind the face (mm); 0 or less in front of it or outside its extent. Below its middle a round
    /// body continues straight down, so that points under it are behind it.
    pub(crate) fn depth_mm(&self, p: Vec3) -> f64 {
        if !self.covers(p) {
            return 0.0;
        }
        let Some(round) = self.round else { return -self.gap_mm - p[1] };
        let [x, y, z] = self.arm(&round, p);
        round.radius_mm - norm([x, y.max(0.0), z])
    }

    /// True if a deformed point lies within the body's extent, above or below its surface.
    fn covers(&self, p: Vec3) -> bool {
        let inside = |v: f64, [low, high]: [f64; 2]| v >= low && v <= high;
        inside(p[0], self.footprint.x_mm) && inside(p[2], self.footprint.z_mm)
    }
}
