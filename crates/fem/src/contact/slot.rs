//! Contact of the walls that face each other across a slot.
//!
//! Quadrature points of the lower wall look along the slot's mean normal for the upper wall. Pairing and normal are
//! those of the current shape and are held while force and tangent are formed, so that the pair force is central
//! (action = reaction, no moment) and the tangent symmetric.

use super::{Penalty, penalty};
use crate::algebra::{Vec3, add, axpy, cross, dot, norm, scale, sub};
use crate::element::tri6;
use crate::mesh::Tri6;

/// Margin on nodal extents within which a curved wall may still touch (mm).
const SEARCH_MARGIN_MM: f64 = 0.2;

/// Barycentric slack that accepts a point on an edge shared by two triangles.
const EDGE_SLACK: f64 = 1.0e-6;

/// The two oriented walls of one slot with the quadrature of the lower one.
#[derive(Clone, Debug)]
pub struct SlotWalls {
    lower: Vec<Tri6>,
    upper: Vec<Tri6>,
    /// Undeformed area of each lower triangle (mm2).
    areas_mm2: Vec<f64>,
}

/// One touching quadrature point.
#[derive(Clone, Copy, Debug)]
pub struct SlotContact {
    /// Nodes of the lower triangle, then of the upper one.
    pub nodes: [u32; 12],
    /// Weights of those nodes in the overlap: `d = n . sum(coefficient x)`.
    pub coefficients: [f64; 12],
    /// Unit normal, from the lower wall to the upper one.
    pub normal: Vec3,
    /// Undeformed area of the point (mm2).
    pub area_mm2: f64,
    /// Penalty terms at the overlap.
    pub penalty: Penalty,
}

/// A wall's nodes seen along the normal: two in-plane coordinates and the height.
struct View {
    axes: [Vec3; 3],
}

impl View {
    fn new(normal: Vec3) -> Self {
        let helper = if normal[1].abs() < 0.9 { [0.0, 1.0, 0.0] } else { [1.0, 0.0, 0.0] };
        let first = cross(helper, normal);
        let first = scale(1.0 / norm(first), first);
        Self { axes: [first, cross(normal, first), normal] }
    }

    fn of(&self, p: Vec3) -> Vec3 {
        self.axes.map(|axis| dot(axis, p))
    }
}

fn area_vector(triangles: &[Tri6], x: &[Vec3]) -> Vec3 {
    let mut sum = [0.0; 3];
    for t in triangles {
        for [a, b, c] in super::super::element::cavity::FACETS {
            let [a, b, c] = [a, b, c].map(|k| x[t[k] as usize]);
            axpy(0.5, cross(sub(b, a), sub(c, a)), &mut sum);
        }
    }
    sum
}

fn interpolate(nodes: &[Vec3; 6], weights: &[f64; 6]) -> Vec3 {
    let mut p = [0.0; 3];
    for (x, w) in nodes.iter().zip(weights) {
        axpy(*w, *x, &mut p);
    }
    p
}

/// Reference coordinates at which a triangle seen along the normal covers the point, if it does.
fn cover(seen: &[Vec3; 6], point: Vec3) -> Option<(f64, f64)> {
    let (mut r, mut s) = (1.0 / 3.0, 1.0 / 3.0);
    for _ in 0..8 {
        let (n, d) = (tri6::shape(r, s), tri6::derivatives(r, s));
        let at = interpolate(seen, &n);
        let (e0, e1) = (point[0] - at[0], point[1] - at[1]);
        let mut j = [[0.0; 2]; 2];
        for (x, d) in seen.iter().zip(&d) {
            for i in 0..2 {
                j[i][0] += x[i] * d[0];
                j[i][1] += x[i] * d[1];
            }
        }
        let det = j[0][0] * j[1][1] - j[0][1] * j[1][0];
        let (dr, ds) = ((j[1][1] * e0 - j[0][1] * e1) / det, (j[0][0] * e1 - j[1][0] * e0) / det);
        r += dr;
        s += ds;
        if !(r.is_finite() && s.is_finite() && r.abs() < 4.0 && s.abs() < 4.0) {
            return None;
        }
        if dr.abs() + ds.abs() < 1.0e-12 {
            break;
        }
    }
    (r >= -EDGE_SLACK && s >= -EDGE_SLACK && r + s <= 1.0 + EDGE_SLACK).then_some((r, s))
}

impl SlotWalls {
    /// Walls from oriented triangles (normals out of the solid) at undeformed positions `x`.
    #[must_use]
    pub fn new(lower: Vec<Tri6>, upper: Vec<Tri6>, x: &[Vec3]) -> Self {
        let areas_mm2 = lower.iter().map(|t| norm(area_vector(std::slice::from_ref(t), x))).collect();
        Self { lower, upper, areas_mm2 }
    }

    /// Node groups that may couple: each lower triangle with the upper ones opposite it.
    ///
    /// Walls slide by less than 1.5 times the slot's width; couplings beyond are dropped from the tangent, not from the force.
    pub fn couplings<'a>(&'a self, x: &'a [Vec3]) -> impl Iterator<Item = [u32; 12]> + 'a {
        let centre = |wall: &[Tri6]| {
            let count = 6.0 * wall.len() as f64;
            wall.iter().flatten().fold([0.0; 3], |sum, n| add(sum, scale(1.0 / count, x[*n as usize])))
        };
        let reach = 1.5 * norm(sub(centre(&self.upper), centre(&self.lower)));
        self.lower.iter().flat_map(move |a| {
            self.upper.iter().filter(move |b| boxes_within(a, b, x, reach)).map(|b| join(a, b))
        })
    }

    /// Nodes of both walls.
    pub fn nodes(&self) -> impl Iterator<Item = u32> + '_ {
        self.lower.iter().chain(&self.upper).flatten().copied()
    }

    /// Touching points at deformed positions `x`.
    #[must_use]
    pub fn contacts(&self, x: &[Vec3], smoothing_mm: f64) -> Vec<SlotContact> {
        let facing = sub(area_vector(&self.lower, x), area_vector(&self.upper, x));
        let normal = scale(1.0 / norm(facing), facing);
        let view = View::new(normal);
        let height = |t: &Tri6| t.map(|n| dot(normal, x[n as usize]));
        let low = self.lower.iter().flat_map(height).fold(f64::NEG_INFINITY, f64::max);
        let high = self.upper.iter().flat_map(height).fold(f64::INFINITY, f64::min);
        if high - low > SEARCH_MARGIN_MM {
            return Vec::new();
        }
        let upper: Vec<[Vec3; 6]> = self.upper.iter().map(|t| t.map(|n| view.of(x[n as usize]))).collect();
        let mut found = Vec::new();
        for (t, area) in self.lower.iter().zip(&self.areas_mm2) {
            let nodes = t.map(|n| view.of(x[n as usize]));
            for [r, s, w] in tri6::SIX_POINTS {
                let weights = tri6::shape(r, s);
                let point = interpolate(&nodes, &weights);
                if let Some((hit, other)) = nearest(&upper, point) {
                    let overlap = point[2] - interpolate(&upper[hit], &other)[2];
                    let penalty = penalty(overlap, smoothing_mm);
                    if overlap > -smoothing_mm {
                        let mut coefficients = [0.0; 12];
                        for k in 0..6 {
                            coefficients[k] = weights[k];
                            coefficients[6 + k] = -other[k];
                        }
                        let nodes = join(t, &self.upper[hit]);
                        found.push(SlotContact { nodes, coefficients, normal, area_mm2: w * area, penalty });
                    }
                }
            }
        }
        found
    }
}

/// Whether the triangles' bounding boxes come within `reach` of each other along every axis.
fn boxes_within(a: &Tri6, b: &Tri6, x: &[Vec3], reach: f64) -> bool {
    let extent = |t: &Tri6, i: usize| {
        let values = t.iter().map(|n| x[*n as usize][i]);
        values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)))
    };
    (0..3).all(|i| {
        let ((low_a, high_a), (low_b, high_b)) = (extent(a, i), extent(b, i));
        low_a <= high_b + reach && low_b <= high_a + reach
    })
}

fn join(a: &Tri6, b: &Tri6) -> [u32; 12] {
    let mut nodes = [0; 12];
    nodes[..6].copy_from_slice(a);
    nodes[6..].copy_from_slice(b);
    nodes
}

/// The triangle that covers the point, with its shape values there.
fn nearest(triangles: &[[Vec3; 6]], point: Vec3) -> Option<(usize, [f64; 6])> {
    triangles.iter().enumerate().find_map(|(k, seen)| {
        let outside = (0..2).any(|i| {
            let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
            for p in seen {
                low = low.min(p[i]);
                high = high.max(p[i]);
            }
            point[i] < low - SEARCH_MARGIN_MM || point[i] > high + SEARCH_MARGIN_MM
        });
        if outside {
            return None;
        }
        cover(seen, point).map(|(r, s)| (k, tri6::shape(r, s)))
    })
}
