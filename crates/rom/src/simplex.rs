//! Distance of a point to the convex hull of others in any number of dimensions, without allocation.
//!
//! Wolfe's algorithm (1976): the point of the hull that is nearest to the origin is a convex combination of at most
//! `d + 1` affinely independent vertices. From one vertex on, the vertex farthest in the direction of the origin is added,
//! and those whose weight would become negative are dropped, until no vertex lies nearer.

use crate::inputs::{MAX_INPUTS, Point};

/// Vertices of the largest simplex, and one that is about to be dropped.
const CORNERS: usize = MAX_INPUTS + 2;
/// A vertex must lie nearer by this share of the sizes involved to be worth a step.
const TOLERANCE: f64 = 1e-13;
/// A nearest point with a square below this is the point itself.
const ZERO: f64 = 1e-24;
/// Steps before the nearest point so far is taken as it is: its distance is an upper bound.
const STEPS: usize = 500;

/// Points by index, entries beyond their dimensions 0.
pub(crate) trait Points {
    /// How many there are.
    fn count(&self) -> usize;
    /// The point at an index.
    fn point(&self, index: usize) -> Point;
}

impl Points for Vec<Point> {
    fn count(&self) -> usize {
        self.len()
    }
    fn point(&self, index: usize) -> Point {
        self[index]
    }
}

/// Points stored as `points x dimensions`.
pub(crate) struct Rows<'a> {
    pub values: &'a [f64],
    pub dimensions: usize,
}

impl Points for Rows<'_> {
    fn count(&self) -> usize {
        self.values.len() / self.dimensions
    }
    fn point(&self, index: usize) -> Point {
        let mut point = Point::default();
        let row = &self.values[index * self.dimensions..(index + 1) * self.dimensions];
        point.iter_mut().zip(row).for_each(|(p, v)| *p = *v);
        point
    }
}

fn dot(a: &Point, b: &Point) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Vertices relative to the point asked about, each with its weight in the nearest point.
#[derive(Default)]
struct Simplex {
    count: usize,
    corners: [Point; CORNERS],
    weights: [f64; CORNERS],
}

impl Simplex {
    fn push(&mut self, corner: Point, weight: f64) {
        (self.corners[self.count], self.weights[self.count]) = (corner, weight);
        self.count += 1;
    }

    fn remove(&mut self, at: usize) {
        self.count -= 1;
        self.corners.swap(at, self.count);
        self.weights.swap(at, self.count);
    }

    /// Drops the corner of the smallest weight, where one of them adds no direction.
    fn remove_lightest(&mut self) {
        let lightest = (0..self.count).min_by(|a, b| self.weights[*a].total_cmp(&self.weights[*b]));
        self.remove(lightest.unwrap_or(0));
        let sum: f64 = self.weights[..self.count].iter().sum();
        self.weights.iter_mut().for_each(|w| *w /= sum);
    }

    fn nearest(&self) -> Point {
        let mut sum = Point::default();
        for (corner, weight) in self.corners.iter().zip(&self.weights).take(self.count) {
            sum.iter_mut().zip(corner).for_each(|(s, c)| *s += weight * c);
        }
        sum
    }

    /// Weights of the point nearest to the origin in the affine hull of the corners: `G w = mu 1`, `sum w = 1`, with
    /// `G_ij = 1 + c_i . c_j`. None when the corners are affinely dependent.
    fn affine_weights(&self) -> Option<[f64; CORNERS]> {
        let n = self.count;
        let mut rows = [[0.0; CORNERS + 1]; CORNERS];
        for (row, corner) in rows.iter_mut().zip(&self.corners).take(n) {
            for (entry, other) in row.iter_mut().zip(&self.corners).take(n) {
                *entry = 1.0 + dot(corner, other);
            }
            row[CORNERS] = 1.0;
        }
        for k in 0..n {
            let pivot = (k..n).max_by(|a, b| rows[*a][k].abs().total_cmp(&rows[*b][k].abs()))?;
            rows.swap(k, pivot);
            let top = rows[k];
            if top[k].abs() < 1e-14 {
                return None;
            }
            for (_, row) in rows.iter_mut().enumerate().take(n).filter(|(i, _)| *i != k) {
                let factor = row[k] / top[k];
                row.iter_mut().zip(&top).for_each(|(r, t)| *r -= factor * t);
            }
        }
        let mut weights = [0.0; CORNERS];
        (0..n).for_each(|i| weights[i] = rows[i][CORNERS] / rows[i][i]);
        let sum: f64 = weights.iter().sum();
        Some(weights.map(|w| w / sum))
    }

    /// Moves to the nearest point of the simplex' hull and drops corners that it does not need.
    fn settle(&mut self) {
        while self.count > 1 {
            let Some(wanted) = self.affine_weights() else {
                self.remove_lightest();
                continue;
            };
            if wanted[..self.count].iter().all(|w| *w > 0.0) {
                self.weights = wanted;
                return;
            }
            let share = |i: usize| self.weights[i] / (self.weights[i] - wanted[i]);
            let negative = (0..self.count).filter(|i| wanted[*i] <= 0.0);
            let Some(first) = negative.min_by(|a, b| share(*a).total_cmp(&share(*b))) else { return };
            let step = share(first).clamp(0.0, 1.0);
            for (weight, wanted) in self.weights.iter_mut().zip(wanted).take(self.count) {
                *weight += step * (wanted - *weight);
            }
            self.remove(first);
        }
        self.weights[0] = 1.0;
    }
}

/// Distance of `x` to the convex hull of `points`; infinite without points or when `x` is not finite.
pub(crate) fn distance_to_hull(points: &impl Points, x: &Point) -> f64 {
    if points.count() == 0 || x.iter().any(|v| !v.is_finite()) {
        return f64::INFINITY;
    }
    let relative = |index: usize| {
        let mut p = points.point(index);
        p.iter_mut().zip(x).for_each(|(p, x)| *p -= x);
        p
    };
    let mut simplex = Simplex::default();
    simplex.push(relative(0), 1.0);
    let mut nearest = simplex.nearest();
    for _ in 0..STEPS {
        let along = |index: usize| dot(&relative(index), &nearest);
        let found = (0..points.count()).map(|i| (along(i), i)).min_by(|a, b| a.0.total_cmp(&b.0));
        let Some((least, index)) = found else { break };
        let square = dot(&nearest, &nearest);
        let corner = relative(index);
        let known = simplex.corners[..simplex.count].contains(&corner);
        let noise = TOLERANCE * (square * dot(&corner, &corner)).sqrt();
        if known || square <= ZERO || square - least <= noise || simplex.count == CORNERS {
            break;
        }
        simplex.push(corner, 0.0);
        simplex.settle();
        nearest = simplex.nearest();
    }
    dot(&nearest, &nearest).sqrt()
}
