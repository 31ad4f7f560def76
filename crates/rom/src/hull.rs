//! Where a regime was trained: the convex hull of its samples over scaled inputs. An interval for one input, a polygon for
//! two, the corners themselves for more.

use crate::inputs::Point;
use crate::simplex::{Rows, distance_to_hull};
use serde::{Deserialize, Serialize};

/// Where a state lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DomainStatus {
    /// Within the hull.
    Inside,
    /// Outside by at most [`Domain::NEAR`] of the sampled range.
    Near,
    /// Further out: extrapolation.
    Outside,
}

/// Convex domain over scaled inputs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Domain {
    /// One input: `[min, max]`.
    Interval([f64; 2]),
    /// Two inputs: hull vertices, counter-clockwise.
    Hull(Vec<[f64; 2]>),
    /// More inputs: hull vertices in no order, `vertices x dimensions`.
    Vertices {
        /// Number of inputs.
        dimensions: usize,
        /// All inputs of a vertex together.
        values: Vec<f64>,
    },
}

/// A point this close to a hull lies in it, as far as rounding lets tell.
const ROUNDING: f64 = 1e-9;

impl Domain {
    /// Scaled distance up to which a state outside counts as near.
    pub const NEAR: f64 = 0.05;

    /// The convex hull of points. `O(n log n)` for two inputs, `n` distances of `O(n)` each for more.
    pub(crate) fn of_points(dimensions: usize, points: &[Point]) -> Self {
        match dimensions {
            0 | 1 => {
                let ends = |e: [f64; 2], p: &Point| [e[0].min(p[0]), e[1].max(p[0])];
                Self::Interval(points.iter().fold([f64::INFINITY, f64::NEG_INFINITY], ends))
            }
            2 => Self::Hull(polygon(points.iter().map(|p| [p[0], p[1]]).collect())),
            _ => {
                let mut kept = points.to_vec();
                let mut at = 0;
                while at < kept.len() {
                    let point = kept.swap_remove(at);
                    if distance_to_hull(&kept, &point) > ROUNDING {
                        kept.push(point);
                        let last = kept.len() - 1;
                        kept.swap(at, last);
                        at += 1;
                    }
                }
                Self::Vertices {
                    dimensions,
                    values: kept.iter().flat_map(|p| p[..dimensions].to_vec()).collect(),
                }
            }
        }
    }

    /// Number of inputs.
    pub fn dimensions(&self) -> usize {
        match self {
            Self::Interval(_) => 1,
            Self::Hull(_) => 2,
            Self::Vertices { dimensions, .. } => *dimensions,
        }
    }

    /// Number of corners (or ends).
    pub fn vertex_count(&self) -> usize {
        match self {
            Self::Interval(_) => 2,
            Self::Hull(vertices) => vertices.len(),
            Self::Vertices { dimensions, values } => values.len() / dimensions,
        }
    }

    /// Distance to the domain over scaled inputs: 0 inside. `O(vertices)`, no allocation.
    pub(crate) fn distance(&self, x: &Point) -> f64 {
        match self {
            Self::Interval([min, max]) => (min - x[0]).max(x[0] - max).max(0.0),
            Self::Hull(vertices) => polygon_distance(vertices, [x[0], x[1]]),
            Self::Vertices { dimensions, values } => {
                distance_to_hull(&Rows { values, dimensions: *dimensions }, x)
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

    /// Whether a point is one of the corners (or ends).
    pub(crate) fn has_vertex(&self, x: &Point) -> bool {
        match self {
            Self::Interval(ends) => ends.contains(&x[0]),
            Self::Hull(vertices) => vertices.contains(&[x[0], x[1]]),
            Self::Vertices { dimensions, values } => {
                values.chunks_exact(*dimensions).any(|v| v == &x[..*dimensions])
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
