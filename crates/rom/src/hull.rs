//! Where a regime was trained: an interval or the convex hull of its samples, over scaled inputs.

use serde::{Deserialize, Serialize};

/// Where a query lies.
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
}

impl Domain {
    /// Scaled distance up to which an outside query counts as near.
    pub const NEAR: f64 = 0.05;

    /// Distance to the domain over scaled inputs: 0 inside. `O(vertices)`.
    pub fn distance(&self, x: [f64; 2]) -> f64 {
        match self {
            Self::Interval([min, max]) => (min - x[0]).max(x[0] - max).max(0.0),
            Self::Hull(vertices) => hull_distance(vertices, x),
        }
    }

    /// DomainStatus for a distance. A rounding error's breadth outside is inside.
    pub fn status(distance: f64) -> DomainStatus {
        match distance {
            d if d <= 1e-9 => DomainStatus::Inside,
            d if d <= Self::NEAR => DomainStatus::Near,
            _ => DomainStatus::Outside,
        }
    }

    /// Whether a point is one of the corners (or ends).
    pub fn has_vertex(&self, x: [f64; 2]) -> bool {
        match self {
            Self::Interval(ends) => ends.contains(&x[0]),
            Self::Hull(vertices) => vertices.contains(&x),
        }
    }

    /// Convex hull of points by Andrew's monotone chain. `O(n log n)`; collinear points collapse to a segment.
    pub fn hull_of(points: &[[f64; 2]]) -> Self {
        let mut sorted = points.to_vec();
        sorted.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
        sorted.dedup();
        if sorted.len() < 3 {
            return Self::Hull(sorted);
        }
        let mut hull = half_hull(sorted.iter());
        let mut upper = half_hull(sorted.iter().rev());
        hull.pop();
        upper.pop();
        hull.append(&mut upper);
        Self::Hull(hull)
    }
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

fn hull_distance(vertices: &[[f64; 2]], x: [f64; 2]) -> f64 {
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
