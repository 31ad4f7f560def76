//! Local half-widths from the errors of held-out states.
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
use crate::statistics::quantile;

/// Scaled distance within which neighbours count alike: the sharpest of those tried by leave-one-out.
pub(crate) const SMOOTHING: f64 = 0.05;
/// Most places: on the shipped model more give no better half-widths, and each costs an evaluation some 2 ns.
pub(crate) const MAX_PLACES: usize = 128;
/// Scaled distances tried for `h`.
const SMOOTHINGS: [f64; 4] = [SMOOTHING, 0.1, 0.2, 0.4];
/// Scaled distance within which states have about equal weight in the quantile of a place.
const AROUND: f64 = 0.2;
/// Number of states around a place at which its quantile has half its weight.
const HALF: f64 = 10.0;

/// The values at the places and the factor on their mean.
pub(crate) struct Scale {
    pub at_places: Vec<f64>,
    pub factor: f64,
}

/// States spread over all: the first, then each time the one farthest from those before it.
pub(crate) fn places(points: &[Point]) -> Vec<usize> {
    let mut nearest = vec![f64::INFINITY; points.len()];
    let mut places = Vec::new();
    while places.len() < MAX_PLACES {
        let farthest = (0..points.len()).rev().max_by(|a, b| nearest[*a].total_cmp(&nearest[*b]));
        let Some(place) = farthest.filter(|place| nearest[*place] > 0.0) else { break };
        places.push(place);
        for (nearest, point) in nearest.iter_mut().zip(points) {
            *nearest = nearest.min(square_distance(point, &points[place]));
        }
    }
    places
}

/// States, their errors of one quantity, and the places among them.
pub(crate) struct Unseen<'a> {
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
            return Scale { at_places: Vec::new(), factor: f64::NAN };
        };
        let ratios: Vec<f64> = self.errors.iter().zip(&left_out).map(|(e, mean)| e / mean).collect();
        let wider: Vec<f64> =
            (0..self.places.len()).map(|place| self.wider(place, &ratios, factor)).collect();
        let of_state = |(state, mean): (usize, &f64)| {
            (mean * self.mean_at(state, |place| wider[place]).unwrap_or(1.0)).max(self.least)
        };
        let left_out: Vec<f64> = left_out.iter().enumerate().map(of_state).collect();
        let at_places = at_places.iter().zip(&wider).map(|(mean, wider)| mean * wider).collect();
        Scale { at_places, factor: self.factor(&left_out) }
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

    /// `g` of a place.
    fn wider(&self, place: usize, ratios: &[f64], factor: f64) -> f64 {
        let at = &self.points[self.places[place]];
        let mut around: Vec<(f64, f64)> = ratios
            .iter()
            .zip(self.points)
            .map(|(ratio, point)| (*ratio, weight(point, at, AROUND)))
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

pub(crate) fn weight(a: &Point, b: &Point, smoothing: f64) -> f64 {
    (square_distance(a, b) + smoothing * smoothing).powi(-2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_spread_and_distinct() {
        let at = |x: f64| {
            let mut point = Point::default();
            point[0] = x;
            point
        };
        assert_eq!(places(&[0.2, 0.0, 1.0, 0.2, 0.5].map(at)), [0, 2, 4, 1]);
        assert_eq!(places(&[at(0.3); 5]), [0]);
        assert!(places(&[]).is_empty());
    }
}
