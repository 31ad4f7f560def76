//! Definitions of observables, as a training configuration has them.

use crate::model::Model;
use crate::probe::{MeshPoint, PointError};
use serde::{Deserialize, Serialize};

/// Most points of one observable.
pub(super) const MAX_POINTS: usize = 32;
/// Axis of an angle that is not given: a finger that bends down, towards `-y`, has a positive angle.
pub(super) const DOWNWARDS: [f64; 3] = [0.0, 0.0, -1.0];

/// Quantity that is computed of the points.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ObservableKind {
    /// Angle from the first section to the last, degrees; two points for each section.
    SectionAngle,
    /// Angle of the line between two points, degrees.
    ChordAngle,
    /// Curvature of the circle through three points, 1/mm.
    Curvature,
    /// Length of the line through the points, mm.
    Length,
    /// Coordinate of a point along the axis, mm.
    Position,
    /// Volume of the closed chambers on whose walls the points lie, of all without points, mm3.
    Volume,
}

impl ObservableKind {
    /// End of the name: the unit.
    pub const fn suffix(self) -> &'static str {
        self.suffix_and_unit().0
    }

    /// The unit.
    pub const fn unit(self) -> &'static str {
        self.suffix_and_unit().1
    }

    const fn suffix_and_unit(self) -> (&'static str, &'static str) {
        match self {
            Self::SectionAngle | Self::ChordAngle => ("_deg", "deg"),
            Self::Curvature => ("_per_mm", "1/mm"),
            Self::Length | Self::Position => ("_mm", "mm"),
            Self::Volume => ("_mm3", "mm3"),
        }
    }

    pub(super) fn takes(self, points: usize) -> bool {
        match self {
            Self::SectionAngle => points >= 4 && points.is_multiple_of(2),
            Self::ChordAngle => points == 2,
            Self::Curvature => points == 3,
            Self::Length => points >= 2,
            Self::Position => points == 1,
            Self::Volume => true,
        }
    }

    pub(super) const fn expected(self) -> &'static str {
        match self {
            Self::SectionAngle => "two points for each section, at least two sections",
            Self::ChordAngle => "two points",
            Self::Curvature => "three points",
            Self::Length => "at least two points",
            Self::Position => "one point",
            Self::Volume => "points on the walls of chambers",
        }
    }
}

/// A point of a definition.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum PointSpec {
    /// Undeformed coordinates, mm.
    At([f64; 3]),
    /// A node.
    Node(u32),
    /// Mean of a node set.
    Set(String),
}

/// Definition of an observable in a training configuration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Definition {
    /// Quantity that is computed of the points.
    pub kind: ObservableKind,
    /// Points that it is computed of; how many, the kind says.
    pub points: Vec<PointSpec>,
    /// Axis of an angle or a curvature (left out: `[0, 0, -1]`), direction of a position.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub axis: Option<[f64; 3]>,
}

impl PointSpec {
    pub(super) fn on(&self, model: &Model) -> Result<MeshPoint, PointError> {
        match self {
            Self::At(at_mm) => MeshPoint::at(model, *at_mm),
            Self::Node(node) => MeshPoint::node(model, *node),
            Self::Set(name) => MeshPoint::of_set(model, name),
        }
    }
}
