//! What can be checked of a body before anything is solved: extent, volume, closed hollows and the thinnest wall.
//!
//! All of it follows from the body's surface, whatever its cells are. A wall is measured by a ray from the middle of each facet into the
//! body, to the facet where it leaves. Cost: `n log n` in the facets.

use super::check::closed;
use crate::algebra::{Vec3, add, axpy, cross, dot, norm, scale, sub};
use formats::cells::{Block, surface};
use rom::parts::connected;
use serde::Serialize;

/// Cosine between a ray and the normal of the facet where it leaves, from which both sides face each other: at a corner they do not.
const FACING: f64 = 0.8;
/// Facets in a leaf of the tree of boxes.
const LEAF: usize = 8;

/// A hollow that is closed on all sides.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Hollow {
    /// Volume that it encloses (mm3).
    pub volume_mm3: f64,
    /// Centroid of that volume (mm).
    pub centre_mm: Vec3,
    /// Flat triangles of its walls.
    pub facets: usize,
}

/// The thinnest place of a body.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Wall {
    /// Thickness (mm).
    pub thickness_mm: f64,
    /// Point on its surface (mm).
    pub at_mm: Vec3,
}

/// Measures of a body.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Measures {
    /// Smallest coordinates (mm).
    pub low_mm: Vec3,
    /// Largest coordinates (mm).
    pub high_mm: Vec3,
    /// Volume of the solid between its flat facets (mm3); `None` where the surface is not closed, as of shells.
    pub volume_mm3: Option<f64>,
    /// Closed hollows, by their centre's x.
    pub hollows: Vec<Hollow>,
    /// `None` where the surface is not closed.
    pub thinnest_wall: Option<Wall>,
}

impl Measures {
    /// Measures a body of any cells.
    ///
    /// # Panics
    /// When a cell names a node beyond `points_mm`.
    #[must_use]
    pub fn of(points_mm: &[Vec3], blocks: &[Block]) -> Self {
        let skin = surface(points_mm, blocks);
        let places = || skin.iter().flatten().map(|n| points_mm[*n as usize]);
        let by = |pick: fn(f64, f64) -> f64, from: f64| {
            places().fold([from; 3], |to, x| [0, 1, 2].map(|k| pick(to[k], x[k])))
        };
        let (low_mm, high_mm) = (by(f64::min, f64::INFINITY), by(f64::max, f64::NEG_INFINITY));
        if skin.is_empty() || closed(skin.iter().copied()).is_err() {
            return Self { low_mm, high_mm, volume_mm3: None, hollows: Vec::new(), thinnest_wall: None };
        }
        let mut hollows = Vec::new();
        let mut volume_mm3 = 0.0;
        for shell in connected(&skin, points_mm.len()) {
            let (own_mm3, centre_mm) = enclosed(points_mm, &shell);
            volume_mm3 += own_mm3;
            // Normals leave the solid, so those of a hollow point into it.
            if own_mm3 < 0.0 {
                hollows.push(Hollow { volume_mm3: -own_mm3, centre_mm, facets: shell.len() });
            }
        }
        hollows.sort_by(|a, b| a.centre_mm[0].total_cmp(&b.centre_mm[0]));
        let thinnest_wall = Tree::new(points_mm, skin).thinnest_wall();
        Self { low_mm, high_mm, volume_mm3: Some(volume_mm3), hollows, thinnest_wall }
    }

    /// Extent along x, y and z (mm).
    #[must_use]
    pub fn extent_mm(&self) -> Vec3 {
        sub(self.high_mm, self.low_mm)
    }
}

/// Volume that triangles enclose, negative where they face inwards, and its centroid.
pub(crate) fn enclosed(points_mm: &[Vec3], triangles: &[[u32; 3]]) -> (f64, Vec3) {
    let point = |n: u32| points_mm[n as usize];
    // From a point nearby, so that a body far from the origin loses no digits.
    let origin = triangles.first().map_or([0.0; 3], |t| point(t[0]));
    let (mut volume, mut moment) = (0.0, [0.0; 3]);
    for triangle in triangles {
        let [a, b, c] = triangle.map(|n| sub(point(n), origin));
        let tetrahedron_mm3 = dot(a, cross(b, c)) / 6.0;
        volume += tetrahedron_mm3;
        axpy(0.25 * tetrahedron_mm3, add(add(a, b), c), &mut moment);
    }
    (volume, add(origin, scale(1.0 / volume, moment)))
}

/// Facets in a tree of boxes, for rays.
struct Tree {
    facets: Vec<[Vec3; 3]>,
    boxes: Vec<Node>,
}

/// A node of the tree: a leaf holds facets, an inner node two boxes, of which the first follows it.
struct Node {
    low: Vec3,
    high: Vec3,
    facets: std::ops::Range<usize>,
    second: Option<usize>,
}

impl Tree {
    fn new(points_mm: &[Vec3], skin: Vec<[u32; 3]>) -> Self {
        let facets = skin.into_iter().map(|t| t.map(|n| points_mm[n as usize])).collect();
        let mut tree = Self { facets, boxes: Vec::new() };
        tree.divide(0..tree.facets.len());
        tree
    }

    /// Makes the box of some facets and those below it. The depth is the logarithm of the facets.
    fn divide(&mut self, range: std::ops::Range<usize>) {
        let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for x in self.facets[range.clone()].iter().flatten() {
            low = [0, 1, 2].map(|k| f64::min(low[k], x[k]));
            high = [0, 1, 2].map(|k| f64::max(high[k], x[k]));
        }
        let own = self.boxes.len();
        self.boxes.push(Node { low, high, facets: range.clone(), second: None });
        if range.len() <= LEAF {
            return;
        }
        let size = sub(high, low);
        let axis = (0..3).fold(0, |best, k| if size[k] > size[best] { k } else { best });
        let middle = range.len() / 2;
        let level = |facet: &[Vec3; 3]| facet.iter().map(|x| x[axis]).sum::<f64>();
        self.facets[range.clone()].select_nth_unstable_by(middle, |a, b| level(a).total_cmp(&level(b)));
        let middle = range.start + middle;
        self.divide(range.start..middle);
        self.boxes[own].second = Some(self.boxes.len());
        self.divide(middle..range.end);
    }

    fn thinnest_wall(&self) -> Option<Wall> {
        let mut thinnest: Option<Wall> = None;
        for facet in &self.facets {
            let normal = normal(facet);
            let length = norm(normal);
            if length == 0.0 {
                continue;
            }
            let ray = scale(-1.0 / length, normal);
            let at_mm = scale(1.0 / 3.0, add(add(facet[0], facet[1]), facet[2]));
            let (distance, way_out) = self.hit(at_mm, ray);
            if distance < thinnest.map_or(f64::INFINITY, |wall| wall.thickness_mm) && way_out >= FACING {
                thinnest = Some(Wall { thickness_mm: distance, at_mm });
            }
        }
        thinnest
    }

    /// Distance to the nearest facet along a ray from the surface, and the cosine between the ray and the facet's normal.
    fn hit(&self, from: Vec3, ray: Vec3) -> (f64, f64) {
        // The ray begins on a facet, which it must not meet.
        let size = norm(sub(self.boxes[0].high, self.boxes[0].low));
        let mut nearest = (f64::INFINITY, 0.0);
        let mut open = vec![0];
        while let Some(at) = open.pop() {
            let Node { low, high, facets, second } = &self.boxes[at];
            if entry(*low, *high, from, ray) > nearest.0 {
                continue;
            }
            match second {
                Some(second) => open.extend([at + 1, *second]),
                None => {
                    for facet in &self.facets[facets.clone()] {
                        let found = meets(facet, from, ray).filter(|t| *t > 1.0e-9 * size);
                        if let Some(distance) = found.filter(|t| *t < nearest.0) {
                            let normal = normal(facet);
                            nearest = (distance, dot(ray, normal) / norm(normal));
                        }
                    }
                }
            }
        }
        nearest
    }
}

/// Normal of a facet, twice its area long.
fn normal([a, b, c]: &[Vec3; 3]) -> Vec3 {
    cross(sub(*b, *a), sub(*c, *a))
}

/// Distance at which a ray enters a box, infinite if it does not.
fn entry(low: Vec3, high: Vec3, from: Vec3, ray: Vec3) -> f64 {
    let (mut enters, mut leaves) = (0.0_f64, f64::INFINITY);
    for k in 0..3 {
        if ray[k] == 0.0 {
            if from[k] < low[k] || from[k] > high[k] {
                return f64::INFINITY;
            }
            continue;
        }
        let [a, b] = [low[k], high[k]].map(|end| (end - from[k]) / ray[k]);
        (enters, leaves) = (enters.max(a.min(b)), leaves.min(a.max(b)));
    }
    // Rounding must not lose a facet that lies in a side of its box.
    if enters <= leaves * (1.0 + 1.0e-12) + 1.0e-12 { enters } else { f64::INFINITY }
}

/// Distance along a ray to a facet (Möller and Trumbore).
fn meets([a, b, c]: &[Vec3; 3], from: Vec3, ray: Vec3) -> Option<f64> {
    let (first, second) = (sub(*b, *a), sub(*c, *a));
    let h = cross(ray, second);
    let determinant = dot(first, h);
    if determinant == 0.0 {
        return None;
    }
    let s = sub(from, *a);
    let u = dot(s, h) / determinant;
    let q = cross(s, first);
    let v = dot(ray, q) / determinant;
    // A ray through an edge meets at least one of its facets.
    let is_in = u >= -1.0e-9 && v >= -1.0e-9 && u + v <= 1.0 + 1.0e-9;
    is_in.then(|| dot(second, q) / determinant)
}
