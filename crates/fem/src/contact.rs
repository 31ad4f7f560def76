//! Frictionless contact by penalty: the base against a rigid body below it, chamber walls against each other.

use crate::algebra::{Mat3, Vec3, axpy, cross, dot, norm, outer, scale, sub};
use crate::element::tri6;
use formats::mesh_file::{TRI_FACETS, Tri6};
use rom::snapshots::Footprint;
use serde::{Deserialize, Serialize};

/// Energy, force and stiffness of a penalty of unit stiffness at an overlap.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Penalty {
    /// Energy per stiffness (mm2).
    pub(crate) energy: f64,
    /// Force per stiffness (mm).
    pub(crate) force: f64,
    /// Tangent per stiffness.
    pub(crate) stiffness: f64,
}

/// A linear penalty on the overlap `d`, rounded by a parabola over `-w <= d <= w` so that its tangent is continuous.
#[inline]
pub(crate) fn penalty(d: f64, w: f64) -> Penalty {
    if d <= -w {
        Penalty { energy: 0.0, force: 0.0, stiffness: 0.0 }
    } else if d >= w {
        Penalty { energy: 0.5 * d * d + w * w / 6.0, force: d, stiffness: 1.0 }
    } else {
        let t = d + w;
        Penalty { energy: t * t * t / (12.0 * w), force: t * t / (4.0 * w), stiffness: t / (2.0 * w) }
    }
}

// ---- rigid bodies below the base ----

// Rigid bodies below the base: a penalty at the base's surface nodes against the plane `y = -gap` (plate, block), or against
// a sphere or cylinder whose highest point lies in it, by the signed distance.

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
    /// Sphere or cylinder.
    pub form: RoundShape,
    /// Radius (mm).
    pub radius_mm: f64,
    /// x and z (mm) of its highest point, which lies in the plane `y = -gap`; of a cylinder x counts.
    pub centre_mm: [f64; 2],
}

/// Shapes of a round body.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RoundShape {
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
        for (k, row) in
            turning.iter_mut().enumerate().filter(|(k, _)| *k < 2 || round.form == RoundShape::Sphere)
        {
            row[k] += 1.0 / distance;
        }
        Some(Touch { penalty: penalty(overlap, self.smoothing_mm), normal, turning })
    }

    /// From the centre of a round body, or the axis of a cylinder, to a point.
    fn arm(&self, round: &Round, p: Vec3) -> Vec3 {
        let [x, z] = round.centre_mm;
        let arm = sub(p, [x, -self.gap_mm - round.radius_mm, z]);
        if round.form == RoundShape::Cylinder { [arm[0], arm[1], 0.0] } else { arm }
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

// ---- walls that face each other across a slot ----

// Contact of the walls that face each other across a slot.
//
// Each quadrature point of the lower wall is paired once with the point opposite it on the upper wall of the
// undeformed slot (small sliding: neighbouring chambers deform alike, so opposite points stay opposite), and the
// overlap is measured along the mean normal of both deformed walls. The pair forces act along that normal, equal and
// opposite. Their tangent at a fixed normal is symmetric with a fixed pattern; the rotation of the normal couples all nodes
// of both walls, but only through the normal's two components ([`Turning`]).

/// Barycentric slack that accepts a point on an edge shared by two triangles.
const EDGE_SLACK: f64 = 1.0e-6;

/// Two opposite points of a slot.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pair {
    /// Nodes of the lower triangle, then of the upper one.
    pub(crate) nodes: [u32; 12],
    /// Weights of those nodes in the overlap: `d = n . sum(coefficient x)`.
    pub(crate) coefficients: [f64; 12],
    /// Undeformed area of the pair (mm2).
    pub(crate) area_mm2: f64,
    /// Position of the lower triangle in its wall, and the fraction of its area.
    lower: (usize, f64),
}

/// The two oriented walls of one slot and their pairs of points.
#[derive(Clone, Debug)]
pub(crate) struct SlotWalls {
    lower: Vec<Tri6>,
    upper: Vec<Tri6>,
    pairs: Vec<Pair>,
}

/// One touching pair.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SlotContact<'a> {
    pub(crate) pair: &'a Pair,
    /// Unit normal, from the lower wall to the upper one.
    pub(crate) normal: Vec3,
    /// Penalty terms at the overlap.
    pub(crate) penalty: Penalty,
}

/// Part of a slot's tangent from the rotation of its normal: `force . turn^T`, of rank two.
#[derive(Clone, Debug)]
pub(crate) struct Turning {
    /// Node, and the internal force (N) on it for a unit turn of the normal along each of two directions; a node may
    /// occur several times.
    pub(crate) force: Vec<(u32, [Vec3; 2])>,
    /// Node, and the turn along each direction for a unit displacement of it (1/mm); a node may occur several times.
    pub(crate) turn: Vec<(u32, [Vec3; 2])>,
}

/// Two in-plane coordinates and the height of points seen along a normal.
struct View([Vec3; 3]);

impl View {
    fn new(normal: Vec3) -> Self {
        let helper = if normal[1].abs() < 0.9 { [0.0, 1.0, 0.0] } else { [1.0, 0.0, 0.0] };
        let first = cross(helper, normal);
        let first = scale(1.0 / norm(first), first);
        Self([first, cross(normal, first), normal])
    }

    fn of(&self, t: &Tri6, x: &[Vec3]) -> [Vec3; 6] {
        t.map(|n| self.0.map(|axis| dot(axis, x[n as usize])))
    }
}

fn area_vector(triangles: &[Tri6], x: &[Vec3]) -> Vec3 {
    let mut sum = [0.0; 3];
    for t in triangles {
        for facet in TRI_FACETS {
            let [a, b, c] = facet.map(|k| x[t[k] as usize]);
            axpy(0.5, cross(sub(b, a), sub(c, a)), &mut sum);
        }
    }
    sum
}

fn mean_normal(lower: &[Tri6], upper: &[Tri6], x: &[Vec3]) -> Vec3 {
    let facing = sub(area_vector(lower, x), area_vector(upper, x));
    scale(1.0 / norm(facing), facing)
}

fn interpolate(nodes: &[Vec3; 6], weights: &[f64; 6]) -> Vec3 {
    let mut p = [0.0; 3];
    for (x, w) in nodes.iter().zip(weights) {
        axpy(*w, *x, &mut p);
    }
    p
}

/// Shape values of the triangle, seen along the normal, at the point it covers; `None` where it does not.
fn cover(seen: &[Vec3; 6], point: Vec3) -> Option<[f64; 6]> {
    let [a, b, c] = [seen[0], seen[1], seen[2]];
    let (e1, e2, d) = (sub(b, a), sub(c, a), sub(point, a));
    let det = e1[0] * e2[1] - e1[1] * e2[0];
    let r = (d[0] * e2[1] - d[1] * e2[0]) / det;
    let s = (e1[0] * d[1] - e1[1] * d[0]) / det;
    let inside = r >= -EDGE_SLACK && s >= -EDGE_SLACK && r + s <= 1.0 + EDGE_SLACK;
    inside.then(|| tri6::shape(r, s))
}

impl SlotWalls {
    /// Pairs the walls, given as oriented triangles (normals out of the solid), at undeformed positions `x`.
    ///
    /// Points without an opposite point have no pair: the walls need not have the same outline. Walls are plane when
    /// undeformed, so their triangles are straight.
    pub(crate) fn new(lower: Vec<Tri6>, upper: Vec<Tri6>, x: &[Vec3]) -> Self {
        let view = View::new(mean_normal(&lower, &upper, x));
        let seen: Vec<[Vec3; 6]> = upper.iter().map(|t| view.of(t, x)).collect();
        let mut pairs = Vec::new();
        for (place, t) in lower.iter().enumerate() {
            let (nodes, area) = (view.of(t, x), norm(area_vector(std::slice::from_ref(t), x)));
            for [r, s, w] in tri6::SIX_POINTS {
                let weights = tri6::shape(r, s);
                let point = interpolate(&nodes, &weights);
                let opposite = seen.iter().zip(&upper).find_map(|(seen, t)| Some((t, cover(seen, point)?)));
                if let Some((other, others)) = opposite {
                    let node = |k: usize| if k < 6 { t[k] } else { other[k - 6] };
                    let coefficient = |k: usize| if k < 6 { weights[k] } else { -others[k - 6] };
                    pairs.push(Pair {
                        nodes: std::array::from_fn(node),
                        coefficients: std::array::from_fn(coefficient),
                        area_mm2: w * area,
                        lower: (place, w),
                    });
                }
            }
        }
        Self { lower, upper, pairs }
    }

    /// The same pairs on walls at other undeformed positions, with their areas there.
    pub(crate) fn moved(&self, x: &[Vec3]) -> Self {
        let mut walls = self.clone();
        for pair in &mut walls.pairs {
            let (place, fraction) = pair.lower;
            pair.area_mm2 = fraction * norm(area_vector(&self.lower[place..=place], x));
        }
        walls
    }

    /// Tangent part from the rotation of the normal at deformed positions `x`; `None` without contact.
    pub(crate) fn turning(&self, x: &[Vec3], smoothing_mm: f64, penalty_mpa_per_mm: f64) -> Option<Turning> {
        let View([first, second, normal]) = View::new(mean_normal(&self.lower, &self.upper, x));
        let mut force = Vec::new();
        for contact in self.contacts(x, smoothing_mm) {
            let pair = contact.pair;
            let stiffness = penalty_mpa_per_mm * pair.area_mm2;
            let mut apart = [0.0; 3];
            for (n, c) in pair.nodes.iter().zip(pair.coefficients) {
                axpy(c, x[*n as usize], &mut apart);
            }
            let along = [first, second].map(|t| {
                let mut f = scale(stiffness * contact.penalty.stiffness * dot(apart, t), normal);
                axpy(stiffness * contact.penalty.force, t, &mut f);
                f
            });
            force.extend(
                pair.nodes.iter().zip(pair.coefficients).map(|(n, c)| (*n, along.map(|f| scale(c, f)))),
            );
        }
        if force.is_empty() {
            return None;
        }
        let facing = sub(area_vector(&self.lower, x), area_vector(&self.upper, x));
        let mut turn = Vec::new();
        for (wall, side) in [(&self.lower, 0.5), (&self.upper, -0.5)] {
            let fraction = side / norm(facing);
            for t in wall {
                for facet in TRI_FACETS {
                    for k in 0..3 {
                        let [a, b, c] = [0, 1, 2].map(|i| t[facet[(k + i) % 3]]);
                        let opposite = sub(x[b as usize], x[c as usize]);
                        turn.push((a, [first, second].map(|t| scale(fraction, cross(opposite, t)))));
                    }
                }
            }
        }
        Some(Turning { force, turn })
    }

    /// All pairs: the node groups that may couple.
    pub(crate) fn pairs(&self) -> &[Pair] {
        &self.pairs
    }

    /// Touching pairs at deformed positions `x`. Cost: twelve products per pair.
    pub(crate) fn contacts<'a>(
        &'a self,
        x: &'a [Vec3],
        smoothing_mm: f64,
    ) -> impl Iterator<Item = SlotContact<'a>> {
        let normal = mean_normal(&self.lower, &self.upper, x);
        self.pairs.iter().filter_map(move |pair| {
            let along =
                pair.nodes.iter().zip(pair.coefficients).map(|(n, c)| c * dot(normal, x[*n as usize]));
            let overlap: f64 = along.sum();
            (overlap > -smoothing_mm).then(|| SlotContact {
                pair,
                normal,
                penalty: penalty(overlap, smoothing_mm),
            })
        })
    }
}
