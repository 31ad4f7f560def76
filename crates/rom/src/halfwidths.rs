//! Half-widths of the answers: split-conformal, from leave-one-out residuals or, where there are any, from the errors of states that
//! no training saw (`train::calibration`).
//!
//! The half-width of a whole regime is the `ceil((n + 1) c)`-th smallest of the `n` cases' worst-node residuals:
//! exchangeable states err by less with probability at least `c`. It says the same everywhere. The local one follows the
//! error over the inputs: `s(x)` is the mean of the cases' residuals `e_j`, weighted by `1 / (|x - x_j|^2 + h^2)^2`; the
//! ratios `e_i / s_i(x_i)`, with `s_i` the mean without case `i`, have a conformal quantile `q`, and the half-width at `x` is
//! `q s(x)`. Leave-one-out removes a neighbour from every case and so over-states the error a little.

use crate::inputs::{Point, square_distance};
use crate::kernel::around::Around;
use crate::unseen::{self, Unseen};
use serde::{Deserialize, Serialize};

/// Conformal half-widths: the stated share of untouched states errs by less, at their worst node.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct HalfWidths {
    /// Share promised (0.9).
    pub coverage: f64,
    /// Displacement (coordinates included) in mm.
    pub displacement_mm: f64,
    /// Stress in MPa.
    pub stress_mpa: f64,
    /// Contact force in N.
    pub force_n: f64,
}

/// Errors of a case: displacement in mm, stress in MPa, force in N.
pub type Errors = [f64; 3];

impl HalfWidths {
    /// For a share `coverage`, the same everywhere, from the errors of all cases: those on the hull stand for the untouched
    /// states that lie near the edge.
    pub fn of_all(errors: &[Errors], coverage: f64) -> Self {
        Self::new(coverage, [0, 1, 2].map(|k| quantile(errors.iter().map(|e| e[k]).collect(), coverage)))
    }

    fn new(coverage: f64, [displacement_mm, stress_mpa, force_n]: Errors) -> Self {
        Self { coverage, displacement_mm, stress_mpa, force_n }
    }
}

/// Scaled distance within which neighbours count alike: the sharpest of those tried by leave-one-out.
pub(crate) const SMOOTHING: f64 = 0.05;
/// No local mean is below this share of the median error.
const MIN_SHARE: f64 = 0.3;

/// Half-widths that follow the error over the inputs of a regime.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LocalHalfWidths {
    /// Share promised.
    pub coverage: f64,
    /// `dimensions x cases`: scaled inputs of the training cases, or of places among the unseen states.
    pub inputs: Vec<f64>,
    /// By displacement (mm), stress (MPa) and force (N): the cases' leave-one-out errors, or the unseen states' around these places.
    pub errors: [Vec<f64>; 3],
    /// Smallest local mean of each.
    pub least: [f64; 3],
    /// Half-width over local mean of each.
    pub factors: [f64; 3],
}

impl LocalHalfWidths {
    /// Before its factors are set.
    fn without_factors(dimensions: usize, points: &[Point], errors: &[Errors], coverage: f64) -> Self {
        let of = |k: usize| -> Vec<f64> { errors.iter().map(|e| e[k]).collect() };
        Self {
            coverage,
            inputs: (0..dimensions).flat_map(|i| points.iter().map(move |x| x[i])).collect(),
            errors: [of(0), of(1), of(2)],
            least: [0, 1, 2].map(|k| (MIN_SHARE * quantile(of(k), 0.5)).max(f64::MIN_POSITIVE)),
            factors: [1.0; 3],
        }
    }

    /// Calibrates on the errors of the cases at these scaled inputs. Cost `O(cases^2)`.
    pub fn calibrate(dimensions: usize, points: &[Point], errors: &[Errors], coverage: f64) -> Self {
        let mut local = Self::without_factors(dimensions, points, errors, coverage);
        let means: Vec<Errors> = (0..points.len()).map(|i| mean_of_others(points, errors, i)).collect();
        let ratios =
            |k: usize| errors.iter().zip(&means).map(|(e, m)| e[k] / m[k].max(local.least[k])).collect();
        local.factors = [0, 1, 2].map(|k| quantile(ratios(k), coverage));
        local
    }

    /// Calibrates on the errors of states at these scaled inputs that no training saw ([`unseen`](crate::unseen)). Cost `O(states)`.
    pub fn of_unseen(dimensions: usize, points: &[Point], errors: &[Errors], coverage: f64) -> Self {
        let places = unseen::places(points);
        let of_places: Vec<Point> = places.iter().map(|place| points[*place]).collect();
        let mut local = Self::without_factors(dimensions, points, errors, coverage);
        local.inputs = (0..dimensions).flat_map(|i| of_places.iter().map(move |x| x[i])).collect();
        for k in 0..3 {
            let (errors, least) = (&local.errors[k], local.least[k]);
            let scale = Unseen { points, places: &places, errors, least, coverage }.scale();
            (local.factors[k], local.errors[k]) = (scale.factor, scale.at_places);
        }
        local
    }

    /// Whether the lengths fit a regime of so many inputs.
    pub(crate) fn fits(&self, dimensions: usize) -> bool {
        let cases = self.errors[0].len();
        cases > 0 && self.inputs.len() == cases * dimensions && self.errors.iter().all(|e| e.len() == cases)
    }

    /// Half-widths at scaled inputs. `O(cases)`, no allocation.
    pub(crate) fn at(&self, x: &Point) -> HalfWidths {
        let around = Around { inputs: &self.inputs, values: &self.errors, square: SMOOTHING * SMOOTHING };
        let [weights, sums @ ..] = around.sums(x);
        let mean = |k: usize| if weights > 0.0 { sums[k] / weights } else { 0.0 };
        let means = [0, 1, 2].map(|k| mean(k).max(self.least[k]));
        HalfWidths::new(self.coverage, [0, 1, 2].map(|k| self.factors[k] * means[k]))
    }
}

/// Weighted means of the errors of all cases but one, at its inputs.
fn mean_of_others(points: &[Point], errors: &[Errors], without: usize) -> Errors {
    let (mut weights, mut sums) = (0.0, [0.0; 3]);
    for (_, (point, errors)) in points.iter().zip(errors).enumerate().filter(|(case, _)| *case != without) {
        let near = square_distance(point, &points[without]) + SMOOTHING * SMOOTHING;
        let weight = 1.0 / (near * near);
        weights += weight;
        sums.iter_mut().zip(errors).for_each(|(sum, error)| *sum += weight * error);
    }
    sums.map(|sum| if weights > 0.0 { sum / weights } else { 0.0 })
}

/// The conformal quantile: the largest value when there are too few for the share asked.
pub(crate) fn quantile(mut values: Vec<f64>, coverage: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    let rank = ((values.len() as f64 + 1.0) * coverage).ceil() as usize;
    values.get(rank.clamp(1, values.len().max(1)) - 1).copied().unwrap_or(f64::NAN)
}
