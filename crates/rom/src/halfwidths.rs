//! Half-widths of the results: split-conformal, from leave-one-out residuals or from the errors of held-out states
//! (`train::calibration`).
//!
//! The half-width of a whole regime is the `ceil((n + 1) c)`-th smallest of the `n` cases' worst-node residuals:
//! the error of an exchangeable state is smaller with probability at least `c`. It is constant. The local one follows the
//! error over the inputs: `s(x)` is the mean of the cases' residuals `e_j`, weighted by `1 / (|x - x_j|^2 + h^2)^2`; the
//! ratios `e_i / s_i(x_i)`, with `s_i` the mean without case `i`, have a conformal quantile `q`, and the half-width at `x` is
//! `q s(x)`. Leave-one-out removes a neighbour of every case, so the half-widths are slightly too large.
//!
//! # From the errors of held-out states
//!
//! These errors scatter more than leave-one-out errors, and there may be too many for one evaluation. A
//! half-width is therefore `q s(x)`, where `s(x)` is the mean of values `s_j` at some of the states, the places (`LocalHalfWidths::at`), and
//! ```text
//! s_j = g_j sum_i e_i / (d_ij^2 + h^2)^2 / sum_i 1 / (d_ij^2 + h^2)^2      over all states i, d_ij from place j
//! g_j = (q_j / q_0)^(n_j / (n_j + 10))
//! ```
//! `h` gives the least quantile loss, the proper score of a quantile. `q_0` is the conformal quantile of the ratios
//! `e_i / s(x_i)` with all `g = 1`, `q_j` their weighted quantile around place `j`, among as many states as `n_j` equal weights would be: where the
//! errors scatter more than elsewhere, half-widths are wider. `q` is the conformal quantile of the ratios with these `g`. The error of a
//! state is left out of the `s` of its ratio.

use crate::inputs::{Point, square_distance};
use crate::kernel::around::Around;
use crate::statistics::{farthest_points, quantile};
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
        let width = |k: usize| quantile(errors.iter().map(|e| e.values()[k]), coverage);
        Self::new(coverage, [0, 1, 2].map(width))
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
        let errors_of = |k: usize| -> Vec<f64> { errors.iter().map(|e| e.values()[k]).collect() };
        Self {
            coverage,
            inputs: (0..dimensions).flat_map(|i| points.iter().map(move |x| x[i])).collect(),
            errors: [errors_of(0), errors_of(1), errors_of(2)],
            least: [0, 1, 2]
                .map(|k| (MIN_FRACTION * quantile(errors_of(k), 0.5)).max(f64::MIN_POSITIVE))
                .into(),
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

    /// Calibrates on the errors of held-out states at these scaled inputs ([`Unseen`]). Cost `O(states)`.
    pub fn of_unseen(dimensions: usize, points: &[Point], errors: &[Errors], coverage: f64) -> Self {
        let distance = |a: usize, b: usize| square_distance(&points[a], &points[b]);
        let places = farthest_points(points.len(), 0, MAX_PLACES, 0.0, distance);
        let of_places: Vec<Point> = places.iter().map(|place| points[*place]).collect();
        let mut local = Self::without_factors(dimensions, &of_places, errors, coverage);
        let mut factors = [0.0; 3];
        for (k, least) in local.least.values().into_iter().enumerate() {
            let errors = &std::mem::take(&mut local.errors[k]);
            let scale = Unseen { points, places: &places, errors, least, coverage }.scale();
            (factors[k], local.errors[k]) = (scale.quantile, scale.s_at_places);
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
        let weight = weight(point, &points[without], SMOOTHING);
        weights += weight;
        sums.iter_mut().zip(errors.values()).for_each(|(sum, error)| *sum += weight * error);
    }
    sums.map(|sum| if weights > 0.0 { sum / weights } else { 0.0 })
}

/// Scaled distance within which neighbours count alike: the sharpest of those tried by leave-one-out.
const SMOOTHING: f64 = 0.05;
/// Most places: on the shipped model more give no better half-widths, and each costs an evaluation some 2 ns.
const MAX_PLACES: usize = 128;
/// Scaled distances tried for `h`.
const SMOOTHINGS: [f64; 4] = [SMOOTHING, 0.1, 0.2, 0.4];
/// Scaled distance within which states have about equal weight in the quantile of a place.
const AROUND: f64 = 0.2;
/// Number of states around a place at which its quantile has half its weight.
const HALF: f64 = 10.0;

/// Half-width of one quantity: `q s(x)` of the equations above.
struct Scale {
    /// `s_j` at the places.
    pub s_at_places: Vec<f64>,
    /// `q` of the equations above.
    pub quantile: f64,
}

/// States, their errors of one quantity, and the places among them.
struct Unseen<'a> {
    pub points: &'a [Point],
    pub places: &'a [usize],
    pub errors: &'a [f64],
    /// Lower limit of a mean.
    pub least: f64,
    /// Nominal coverage.
    pub coverage: f64,
}

impl Unseen<'_> {
    /// Values and factor of this quantity. Cost `O(states x places)`.
    pub fn scale(&self) -> Scale {
        let candidates = SMOOTHINGS.map(|smoothing| self.smoothed(smoothing));
        let scored = candidates.into_iter().map(|(at_places, left_out)| {
            let factor = self.factor(&left_out);
            (self.loss(factor, &left_out), factor, at_places, left_out)
        });
        let Some((_, factor, at_places, left_out)) = scored.min_by(|a, b| a.0.total_cmp(&b.0)) else {
            return Scale { s_at_places: Vec::new(), quantile: f64::NAN };
        };
        let ratios: Vec<f64> = self.errors.iter().zip(&left_out).map(|(e, mean)| e / mean).collect();
        let local: Vec<f64> =
            (0..self.places.len()).map(|place| self.local_factor(place, &ratios, factor)).collect();
        let of_state = |(state, mean): (usize, &f64)| {
            (mean * self.mean_at(state, |place| local[place]).unwrap_or(1.0)).max(self.least)
        };
        let left_out: Vec<f64> = left_out.iter().enumerate().map(of_state).collect();
        let s_at_places = at_places.iter().zip(&local).map(|(mean, local)| mean * local).collect();
        Scale { s_at_places, quantile: self.factor(&left_out) }
    }

    /// The mean error around each place, and what the mean over places is at each state with its error in none of them.
    fn smoothed(&self, smoothing: f64) -> (Vec<f64>, Vec<f64>) {
        let sums = |place: &usize| {
            let weights = self.points.iter().map(|point| weight(point, &self.points[*place], smoothing));
            weights.zip(self.errors).fold((0.0, 0.0), |(all, sum), (w, error)| (all + w, sum + w * error))
        };
        let sums: Vec<(f64, f64)> = self.places.iter().map(sums).collect();
        let left_out = |state: usize| {
            let without = |place: usize| {
                let own = weight(&self.points[state], &self.points[self.places[place]], smoothing);
                (sums[place].1 - own * self.errors[state]) / (sums[place].0 - own)
            };
            self.mean_at(state, without).unwrap_or(0.0).max(self.least)
        };
        (
            sums.iter().map(|(weights, sum)| sum / weights).collect(),
            (0..self.points.len()).map(left_out).collect(),
        )
    }

    /// The mean over the places around a state, without the state itself; `None` without another place.
    fn mean_at(&self, state: usize, value: impl Fn(usize) -> f64) -> Option<f64> {
        let (mut weights, mut sum) = (0.0, 0.0);
        for (place, at) in self.places.iter().enumerate().filter(|(_, at)| **at != state) {
            let w = weight(&self.points[state], &self.points[*at], SMOOTHING);
            weights += w;
            sum += w * value(place);
        }
        (weights > 0.0).then(|| sum / weights)
    }

    /// The conformal quantile of the errors over these means.
    fn factor(&self, means: &[f64]) -> f64 {
        quantile(self.errors.iter().zip(means).map(|(error, mean)| error / mean), self.coverage)
    }

    fn loss(&self, factor: f64, means: &[f64]) -> f64 {
        let of_state = |(error, mean): (&f64, &f64)| {
            let beyond = error - factor * mean;
            beyond * if beyond > 0.0 { self.coverage } else { self.coverage - 1.0 }
        };
        self.errors.iter().zip(means).map(of_state).sum()
    }

    /// `g_j` of the equations above: how much wider the half-width is around a place than on average, drawn to 1 where few states are near.
    fn local_factor(&self, place: usize, ratios: &[f64], factor: f64) -> f64 {
        let centre = &self.points[self.places[place]];
        let mut around: Vec<(f64, f64)> = ratios
            .iter()
            .zip(self.points)
            .map(|(ratio, point)| (*ratio, weight(point, centre, AROUND)))
            .collect();
        around.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (sum, squares) =
            around.iter().fold((0.0, 0.0), |(sum, squares), (_, w)| (sum + w, squares + w * w));
        let mut below = 0.0;
        let reached = around.iter().find(|(_, w)| {
            below += w;
            below >= self.coverage * sum
        });
        let found = reached.map_or(0.0, |(ratio, _)| ratio / factor);
        let count = sum * sum / squares;
        // Without an error around the place the ratio is undefined.
        if found > 0.0 && found.is_finite() { found.powf(count / (count + HALF)) } else { 1.0 }
    }
}

fn weight(a: &Point, b: &Point, smoothing: f64) -> f64 {
    (square_distance(a, b) + smoothing * smoothing).powi(-2)
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
        assert_eq!(local.errors[0].len(), MAX_PLACES);
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
