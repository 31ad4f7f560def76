//! Training range of a regime over scaled inputs. Pressure and gap: the convex hull of the samples, an interval or a
//! polygon. With parameters: that hull over pressure and gap, the sampled range of every parameter, and a distance to the
//! nearest sample. The convex hull over many inputs is no use: in six dimensions it holds next to nothing of a
//! Latin hypercube's box, although the samples fill it.

use crate::inputs::{Point, square_distance};
use serde::{Deserialize, Serialize};
use std::fmt::{self, Display};

/// Position of a state with respect to the training range.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DomainStatus {
    /// Within the hull.
    Inside,
    /// Outside by at most [`TrainingRange::NEAR`] of the sampled range: also an extrapolation, without half-widths.
    Near,
    /// Further out: extrapolation.
    Outside,
}

impl DomainStatus {
    /// Number in states, fields, answers and FMUs.
    pub fn number(self) -> u32 {
        match self {
            Self::Inside => 0,
            Self::Near => 1,
            Self::Outside => 2,
        }
    }
}

impl Display for DomainStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Inside => "inside",
            Self::Near => "near",
            Self::Outside => "outside",
        })
    }
}

/// Training range over scaled inputs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum TrainingRange {
    /// One input: `[min, max]`.
    Interval([f64; 2]),
    /// Two inputs: hull vertices, counter-clockwise.
    Hull(Vec<[f64; 2]>),
    /// Training range with parameters: pressure (and gap) within the corners, every further input in [0, 1], and the nearest sample not
    /// farther than `reach`.
    Product {
        /// Leading inputs that the corners bound: 1 or 2.
        operating: usize,
        /// Number of inputs.
        dimensions: usize,
        /// Corners over the leading inputs, counter-clockwise; the second column is 0 where there is one.
        corners: Vec<[f64; 2]>,
        /// Largest distance of a sample from its nearest neighbour.
        reach: f64,
        /// `samples x dimensions`.
        samples: Vec<f64>,
    },
}

/// Rounding error within which a point lies in a hull.
const ROUNDING: f64 = 1e-9;

impl TrainingRange {
    /// Scaled distance up to which a state outside counts as near.
    pub const NEAR: f64 = 0.05;
    /// Scaled distance up to which questions and designs are answered. The answers outside have no half-widths.
    pub const ASKED: f64 = 0.25;
    /// Scaled distance from which on a model has no numbers at all: the state is farther outside than the samples are wide.
    pub const ANSWERED: f64 = 1.0;

    /// Training range of samples. The first `operating` inputs are pressure and gap; if neither varies, the first
    /// parameter replaces them. `O(n log n)`, with parameters `O(n^2)`.
    pub fn of_points(operating: usize, dimensions: usize, points: &[Point]) -> Self {
        let operating = operating.max(1);
        match dimensions {
            _ if operating < dimensions => Self::product(operating, dimensions, points),
            0 | 1 => {
                let ends = |e: [f64; 2], p: &Point| [e[0].min(p[0]), e[1].max(p[0])];
                Self::Interval(points.iter().fold([f64::INFINITY, f64::NEG_INFINITY], ends))
            }
            _ => Self::Hull(polygon(points.iter().map(|p| [p[0], p[1]]).collect())),
        }
    }

    fn product(operating: usize, dimensions: usize, points: &[Point]) -> Self {
        let leading = |p: &Point| [p[0], if operating > 1 { p[1] } else { 0.0 }];
        let nearest = |i: usize| {
            let others = points.iter().enumerate().filter(|(j, _)| *j != i);
            others.map(|(_, other)| square_distance(&points[i], other)).fold(f64::INFINITY, f64::min)
        };
        let reach = (0..points.len()).map(nearest).filter(|d| d.is_finite()).fold(0.0, f64::max).sqrt();
        Self::Product {
            operating,
            dimensions,
            corners: polygon(points.iter().map(leading).collect()),
            reach,
            samples: points.iter().flat_map(|p| p[..dimensions].to_vec()).collect(),
        }
    }

    /// True if the lengths fit a regime with this number of inputs.
    pub fn fits(&self, inputs: usize) -> bool {
        match self {
            Self::Product { operating, dimensions, corners, samples, .. } => {
                let shape = *operating >= 1 && operating < dimensions && samples.len() % dimensions == 0;
                *dimensions == inputs && shape && !corners.is_empty() && !samples.is_empty()
            }
            _ => self.dimensions() == inputs,
        }
    }

    /// Number of inputs.
    pub fn dimensions(&self) -> usize {
        match self {
            Self::Interval(_) => 1,
            Self::Hull(_) => 2,
            Self::Product { dimensions, .. } => *dimensions,
        }
    }

    /// Number of corners (or ends) over pressure and gap.
    pub fn vertex_count(&self) -> usize {
        match self {
            Self::Interval(_) => 2,
            Self::Hull(corners) | Self::Product { corners, .. } => corners.len(),
        }
    }

    /// Distance to the training range over scaled inputs: 0 inside. `O(vertices)`, with parameters `O(samples)`; no allocation.
    pub fn distance(&self, x: &Point) -> f64 {
        match self {
            Self::Interval([min, max]) => (min - x[0]).max(x[0] - max).max(0.0),
            Self::Hull(vertices) => polygon_distance(vertices, [x[0], x[1]]),
            Self::Product { operating, dimensions, corners, reach, samples } => {
                let leading = [x[0], if *operating > 1 { x[1] } else { 0.0 }];
                let beyond = |v: &f64| (-v).max(v - 1.0).max(0.0);
                let ranges: f64 = x[*operating..*dimensions].iter().map(|v| beyond(v).powi(2)).sum();
                let bounds = (polygon_distance(corners, leading).powi(2) + ranges).sqrt();
                let square = |s: &[f64]| -> f64 { s.iter().zip(x).map(|(s, x)| (s - x) * (s - x)).sum() };
                let nearest = samples.chunks_exact(*dimensions).map(square).fold(f64::INFINITY, f64::min);
                if nearest.is_finite() { bounds.max(nearest.sqrt() - reach) } else { f64::INFINITY }
            }
        }
    }

    /// Status for a distance. A rounding error's breadth outside is inside.
    pub fn status(distance: f64) -> DomainStatus {
        match distance {
            d if d <= ROUNDING => DomainStatus::Inside,
            d if d <= Self::NEAR => DomainStatus::Near,
            _ => DomainStatus::Outside,
        }
    }

    /// True if a point is one of the corners (or ends), or at an end of a parameter's range.
    pub fn has_vertex(&self, x: &Point) -> bool {
        match self {
            Self::Interval(ends) => ends.contains(&x[0]),
            Self::Hull(vertices) => vertices.contains(&[x[0], x[1]]),
            Self::Product { operating, dimensions, corners, .. } => {
                let corner = corners.contains(&[x[0], if *operating > 1 { x[1] } else { 0.0 }]);
                corner || x[*operating..*dimensions].iter().any(|v| *v <= 0.0 || *v >= 1.0)
            }
        }
    }
}

/// Corners of the convex hull by Andrew's monotone chain; collinear points collapse to a segment.
fn polygon(mut points: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    points.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    points.dedup();
    if points.len() < 3 {
        return points;
    }
    let mut hull = half_hull(points.iter());
    let mut upper = half_hull(points.iter().rev());
    hull.pop();
    upper.pop();
    hull.append(&mut upper);
    hull
}

fn half_hull<'a>(points: impl Iterator<Item = &'a [f64; 2]>) -> Vec<[f64; 2]> {
    let mut chain: Vec<[f64; 2]> = Vec::new();
    for p in points {
        while chain.len() >= 2 && cross(chain[chain.len() - 2], chain[chain.len() - 1], *p) <= 0.0 {
            chain.pop();
        }
        chain.push(*p);
    }
    chain
}

/// Twice the signed area of the triangle a, b, c: positive when counter-clockwise.
fn cross(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

fn polygon_distance(vertices: &[[f64; 2]], x: [f64; 2]) -> f64 {
    let edges = || (0..vertices.len()).map(|i| (vertices[i], vertices[(i + 1) % vertices.len()]));
    if vertices.len() > 2 && edges().all(|(a, b)| cross(a, b, x) >= 0.0) {
        return 0.0;
    }
    edges().map(|(a, b)| segment_distance(a, b, x)).fold(f64::INFINITY, f64::min)
}

fn segment_distance(a: [f64; 2], b: [f64; 2], x: [f64; 2]) -> f64 {
    let (d, v) = ([b[0] - a[0], b[1] - a[1]], [x[0] - a[0], x[1] - a[1]]);
    let length2 = d[0] * d[0] + d[1] * d[1];
    let t = if length2 > 0.0 { ((v[0] * d[0] + v[1] * d[1]) / length2).clamp(0.0, 1.0) } else { 0.0 };
    (v[0] - t * d[0]).hypot(v[1] - t * d[1])
}
