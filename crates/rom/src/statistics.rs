//! Mean, median, quantile and range of some numbers, and points spread over many: one definition of each for the half-widths, for learning
//! and for the readers of files.

use std::borrow::Borrow;

/// Arithmetic mean; NaN without values.
pub fn mean(values: impl IntoIterator<Item = f64>) -> f64 {
    let (sum, count) = values.into_iter().fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
    if count > 0.0 { sum / count } else { f64::NAN }
}

/// Middle value, of an even number the larger one; `None` without values.
pub fn median(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let mut values: Vec<f64> = values.into_iter().collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

/// Value that a further one stays below with the probability `coverage` (conformal quantile): of `n` values the one of rank
/// `coverage (n + 1)`, the largest if there are too few for the coverage, NaN without values.
pub fn quantile(values: impl IntoIterator<Item = f64>, coverage: f64) -> f64 {
    let mut values: Vec<f64> = values.into_iter().collect();
    values.sort_by(f64::total_cmp);
    let rank = ((values.len() as f64 + 1.0) * coverage).ceil() as usize;
    values.get(rank.clamp(1, values.len().max(1)) - 1).copied().unwrap_or(f64::NAN)
}

/// Smallest and largest finite value; infinity and minus infinity without one.
pub fn ends(values: impl IntoIterator<Item = impl Borrow<f64>>) -> [f64; 2] {
    let finite = values.into_iter().map(|value| *value.borrow()).filter(|value| value.is_finite());
    finite.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], value| [low.min(value), high.max(value)])
}

/// Largest minus smallest finite value; 0 without one.
pub fn range(values: impl IntoIterator<Item = impl Borrow<f64>>) -> f64 {
    let [low, high] = ends(values);
    (high - low).max(0.0)
}

/// At most `most` of `count` points, spread over all: `first`, then each time the one whose square distance to the nearest of those before it
/// is largest, while that exceeds `least`. Cost `O(count most)`.
pub fn farthest_points(
    count: usize,
    first: usize,
    most: usize,
    least: f64,
    square_distance: impl Fn(usize, usize) -> f64,
) -> Vec<usize> {
    let (mut found, mut next) = (Vec::new(), (first < count).then_some(first));
    let mut nearest = vec![f64::INFINITY; count];
    while let Some(newest) = next.filter(|_| found.len() < most) {
        found.push(newest);
        nearest.iter_mut().enumerate().for_each(|(k, d)| *d = d.min(square_distance(k, newest)));
        let farthest = (0..count).rev().max_by(|a, b| nearest[*a].total_cmp(&nearest[*b]));
        next = farthest.filter(|k| nearest[*k] > least);
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_those_of_their_definitions() {
        assert_eq!((mean([1.0, 2.0, 6.0]), median([3.0, 1.0, 2.0])), (3.0, Some(2.0)));
        assert_eq!((median([1.0, 2.0]), median([])), (Some(2.0), None));
        assert!(mean([]).is_nan() && quantile([], 0.9).is_nan());
        let nineteen = || (1..=19).map(f64::from);
        assert_eq!((quantile(nineteen(), 0.9), quantile(nineteen(), 0.5)), (18.0, 10.0));
        assert_eq!(
            (ends([2.0, f64::NAN, -1.0]), range([2.0, -1.0]), range([0.0; 0])),
            ([-1.0, 2.0], 3.0, 0.0)
        );
        assert_eq!(quantile([1.0, 2.0, 3.0], 0.9), 3.0, "three values do not tell 90 %");
    }

    #[test]
    fn points_are_spread() {
        let spread = |x: &[f64], first, most, least| {
            farthest_points(x.len(), first, most, least, |a, b| (x[a] - x[b]).powi(2))
        };
        assert_eq!(spread(&[0.2, 0.0, 1.0, 0.2, 0.5], 0, 16, 0.0), [0, 2, 4, 1]);
        assert_eq!(spread(&[0.2, 0.0, 1.0, 0.2, 0.5], 4, 2, 0.0), [4, 1], "of two as far the first");
        assert_eq!(
            spread(&[0.2, 0.0, 1.0, 0.2, 0.5], 0, 16, 0.05),
            [0, 2, 4],
            "0.0 is within 0.2 of another"
        );
        assert_eq!(spread(&[0.3; 5], 0, 16, 0.0), [0]);
        assert!(spread(&[], 0, 16, 0.0).is_empty());
    }
}
