//! Half-widths of the results: split-conformal, from leave-one-out residuals or from the errors of held-out states
//! (`train::calibration`).
//!
//! The half-width of a whole regime is the `ceil((n + 1) c)`-th smallest of the `n` cases' worst-node residuals:
//! the error of an exchangeable state is smaller with probability at least `c`. It is constant. The local one follows the
//! error over the inputs: `s(x)` is the mean of the cases' residuals `e_j`, weighted by `1 / (|x - x_j|^2 + h^2)^2`; the
//! ratios `e_i / s_i(x_i)`, with `s_i` the mean without case `i`, have a conformal quantile `q`, and the half-width at `x` is
//! `q s(x)`. Leave-one-out removes a neighbour of every case, so the half-widths are slightly too large.

use crate::inputs::Point;
use crate::kernel::around::Around;
use crate::statistics::quantile;
use crate::unseen::{self, SMOOTHING, Unseen};
use serde::{Deserialize, Serialize};

/// Standard deviations of a normal distribution within half-widths, which hold for 90 % of the states.
pub const HALFWIDTH_SIGMAS: f64 = 1.645;

/// Conformal half-widths: bounds of the largest error over nodes, with the nominal coverage.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct HalfWidths {
    /// Nominal coverage (0.9).
    pub coverage: f64,
    /// Displacement (coordinates included) in mm.
    pub displacement_mm: f64,
    /// Stress in MPa.
    pub stress_mpa: f64,
    /// Contact force in N.
    pub force_n: f64,
}

impl HalfWidths {
    /// Those of a state whose error is not known, such as one outside the training range.
    pub const UNKNOWN: Self =
        Self { coverage: f64::NAN, displacement_mm: f64::NAN, stress_mpa: f64::NAN, force_n: f64::NAN };

    /// The same with those of an independent source: the root of the sum of the squares, at this coverage.
    #[must_use]
    pub fn with(self, other: &Self) -> Self {
        Self {
            coverage: self.coverage,
            displacement_mm: self.displacement_mm.hypot(other.displacement_mm),
            stress_mpa: self.stress_mpa.hypot(other.stress_mpa),
            force_n: self.force_n.hypot(other.force_n),
        }
    }
}

/// Errors of a case, at its worst node.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Errors {
    /// Displacement (coordinates included) in mm.
    pub displacement_mm: f64,
    /// Stress in MPa.
    pub stress_mpa: f64,
    /// Contact force in N.
    pub force_n: f64,
}

impl Errors {
    /// Displacement, stress, force.
    pub const fn values(self) -> [f64; 3] {
        [self.displacement_mm, self.stress_mpa, self.force_n]
    }
}

impl From<[f64; 3]> for Errors {
    fn from([displacement_mm, stress_mpa, force_n]: [f64; 3]) -> Self {
        Self { displacement_mm, stress_mpa, force_n }
    }
}

impl HalfWidths {
    /// Constant half-widths from the errors of all cases. Cases on the hull represent states near the edge.
    pub fn of_all(errors: &[Errors], coverage: f64) -> Self {
        let of = |k: usize| quantile(errors.iter().map(|e| e.values()[k]), coverage);
        Self::new(coverage, [0, 1, 2].map(of))
    }

    fn new(coverage: f64, [displacement_mm, stress_mpa, force_n]: [f64; 3]) -> Self {
        Self { coverage, displacement_mm, stress_mpa, force_n }
    }
}

/// Lower limit of a local mean, as a fraction of the median error.
const MIN_FRACTION: f64 = 0.3;

/// Half-widths that follow the error over the inputs of a regime.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LocalHalfWidths {
    /// Nominal coverage.
    pub coverage: f64,
    /// `dimensions x cases`: scaled inputs of the training cases, or of places among the unseen states.
    pub inputs: Vec<f64>,
    /// Errors of displacement (mm), stress (MPa) and force (N): leave-one-out errors of the cases, or means of the held-out states
    /// around the places.
    pub errors: [Vec<f64>; 3],
    /// Smallest local mean of each.
    pub least: Errors,
    /// Half-width over local mean of each.
    pub factors: Errors,
}

impl LocalHalfWidths {
    /// Half-widths with all factors 1; `points` are the cases or the places.
    fn without_factors(dimensions: usize, points: &[Point], errors: &[Errors], coverage: f64) -> Self {
        let of = |k: usize| -> Vec<f64> { errors.iter().map(|e| e.values()[k]).collect() };
        Self {
            coverage,
            inputs: (0..dimensions).flat_map(|i| points.iter().map(move |x| x[i])).collect(),
            errors: [of(0), of(1), of(2)],
            least: [0, 1, 2].map(|k| (MIN_FRACTION * quantile(of(k), 0.5)).max(f64::MIN_POSITIVE)).into(),
            factors: [1.0; 3].into(),
        }
    }

    /// Calibrates on the errors of the cases at these scaled inputs. Cost `O(cases^2)`.
    pub fn calibrate(dimensions: usize, points: &[Point], errors: &[Errors], coverage: f64) -> Self {
        let mut local = Self::without_factors(dimensions, points, errors, coverage);
        let means: Vec<[f64; 3]> = (0..points.len()).map(|i| mean_of_others(points, errors, i)).collect();
        let least = local.least.values();
        let factor = |k: usize| {
            let ratios = errors.iter().zip(&means).map(|(e, m)| e.values()[k] / m[k].max(least[k]));
            quantile(ratios, coverage)
        };
        local.factors = [0, 1, 2].map(factor).into();
        local
    }

    /// Calibrates on the errors of held-out states at these scaled inputs ([`unseen`](crate::unseen)). Cost `O(states)`.
    pub fn of_unseen(dimensions: usize, points: &[Point], errors: &[Errors], coverage: f64) -> Self {
        let places = unseen::places(points);
        let of_places: Vec<Point> = places.iter().map(|place| points[*place]).collect();
        let mut local = Self::without_factors(dimensions, &of_places, errors, coverage);
        let mut factors = [0.0; 3];
        for (k, least) in local.least.values().into_iter().enumerate() {
            let errors = &std::mem::take(&mut local.errors[k]);
            let scale = Unseen { points, places: &places, errors, least, coverage }.scale();
            (factors[k], local.errors[k]) = (scale.factor, scale.at_places);
        }
        Self { factors: factors.into(), ..local }
    }

    /// True if the lengths fit a regime of `dimensions` inputs.
    pub(crate) fn fits(&self, dimensions: usize) -> bool {
        let cases = self.errors[0].len();
        cases > 0 && self.inputs.len() == cases * dimensions && self.errors.iter().all(|e| e.len() == cases)
    }

    /// Half-widths at scaled inputs. `O(cases)`, no allocation.
    pub(crate) fn at(&self, x: &Point) -> HalfWidths {
        let around = Around { inputs: &self.inputs, values: &self.errors, square: SMOOTHING * SMOOTHING };
        let [weights, sums @ ..] = around.sums(x);
        let mean = |k: usize| if weights > 0.0 { sums[k] / weights } else { 0.0 };
        let (least, factors) = (self.least.values(), self.factors.values());
        HalfWidths::new(self.coverage, [0, 1, 2].map(|k| factors[k] * mean(k).max(least[k])))
    }
}

/// Weighted means of the errors of all cases but one, at its inputs.
fn mean_of_others(points: &[Point], errors: &[Errors], without: usize) -> [f64; 3] {
    let (mut weights, mut sums) = (0.0, [0.0; 3]);
    for (_, (point, errors)) in points.iter().zip(errors).enumerate().filter(|(case, _)| *case != without) {
        let weight = unseen::weight(point, &points[without], SMOOTHING);
        weights += weight;
        sums.iter_mut().zip(errors.values()).for_each(|(sum, error)| *sum += weight * error);
    }
    sums.map(|sum| if weights > 0.0 { sum / weights } else { 0.0 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::Rng;

    /// Errors that grow along the first input and scatter more along the second.
    fn drawn(rng: &mut Rng, states: usize) -> (Vec<Point>, Vec<Errors>) {
        let mut one = || {
            let mut x = Point::default();
            (x[0], x[1]) = (rng.uniform(), rng.uniform());
            let scatter = rng.uniform().powf(1.0 + 4.0 * x[1]);
            (x, Errors::from([(1.0 + x[0]) * scatter, scatter, 0.0]))
        };
        (0..states).map(|_| one()).unzip()
    }

    #[test]
    fn coverage_of_new_states_is_nominal_in_every_part_of_the_inputs() {
        let mut rng = Rng::new(7);
        let (points, errors) = drawn(&mut rng, 900);
        let local = LocalHalfWidths::of_unseen(2, &points, &errors, 0.9);
        assert_eq!(local.errors[0].len(), unseen::MAX_PLACES);
        let (points, errors) = drawn(&mut rng, 4000);
        let mut within = [[0.0; 2]; 2];
        for (point, errors) in points.iter().zip(&errors) {
            let widths = local.at(point);
            let is_within =
                errors.displacement_mm <= widths.displacement_mm && errors.stress_mpa <= widths.stress_mpa;
            assert!(errors.force_n <= widths.force_n, "an error of 0 is within");
            within[usize::from(point[0] > 0.5)][usize::from(point[1] > 0.5)] +=
                f64::from(u8::from(is_within));
        }
        let shares = within.map(|row| row.map(|count| count / 1000.0));
        assert!(shares.iter().flatten().all(|share| (0.8..0.97).contains(share)), "{shares:?}");
        let all = shares.iter().flatten().sum::<f64>() / 4.0;
        assert!((0.85..0.95).contains(&all), "{shares:?}");
    }

    #[test]
    fn equal_errors_at_one_place_give_that_error_as_half_width() {
        let at = Point::default();
        let alike = LocalHalfWidths::of_unseen(1, &[at; 20], &[[1.0, 2.0, 0.0].into(); 20], 0.9).at(&at);
        assert!((alike.displacement_mm, alike.stress_mpa) == (1.0, 2.0), "{alike:?}");
    }
}
