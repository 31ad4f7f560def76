//! Whether a quantity grows: the slope of Theil and Sen with its confidence interval, which single outliers do not move.

use serde::Serialize;

/// Standard deviations of the normal distribution on both sides that leave 1 % outside.
const Z: f64 = 2.576;

/// The slope of a series, per unit of its abscissa.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Slope {
    /// Median of the slopes between all pairs of points.
    pub slope: f64,
    /// Ends of the interval that has the true slope with 99 % confidence.
    pub low: f64,
    /// See `low`.
    pub high: f64,
    /// Points.
    pub points: usize,
}

impl Slope {
    /// Slope of points (x, y) with different x; `None` for fewer than 10.
    ///
    /// The interval is Sen's: from the variance of Kendall's statistic, without a correction for ties (which widens it).
    pub fn of(points: &[(f64, f64)]) -> Option<Self> {
        let n = points.len();
        if n < 10 {
            return None;
        }
        let pairs = points.iter().enumerate().flat_map(|(k, a)| points[k + 1..].iter().map(move |b| (a, b)));
        let mut slopes: Vec<f64> = pairs.map(|(a, b)| (b.1 - a.1) / (b.0 - a.0)).collect();
        slopes.sort_by(f64::total_cmp);
        let (count, points_f) = (slopes.len() as f64, n as f64);
        let half = Z * (points_f * (points_f - 1.0) * (2.0 * points_f + 5.0) / 18.0).sqrt();
        let at = |place: f64| slopes[(place.max(0.0) as usize).min(slopes.len() - 1)];
        Some(Self {
            slope: slopes[slopes.len() / 2],
            low: at(((count - half) / 2.0).floor()),
            high: at(((count + half) / 2.0).ceil()),
            points: n,
        })
    }

    /// Whether the quantity grows, by at least `smallest` over `span`: both with 99 % confidence.
    pub fn grows(&self, span: f64, smallest: f64) -> bool {
        self.low > 0.0 && self.low * span >= smallest
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A fixed sequence of numbers between -1 and 1 without a trend.
    fn noise(k: usize) -> f64 {
        let bits = (k as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 11;
        bits as f64 / (1u64 << 52) as f64 - 1.0
    }

    fn of(y: impl Fn(usize) -> f64) -> Slope {
        Slope::of(&(0..200).map(|k| (k as f64, y(k))).collect::<Vec<_>>()).expect("enough points")
    }

    #[test]
    fn slope_below_the_noise_is_found_and_noise_steps_outliers_have_none() {
        let leak = of(|k| 5000.0 + 0.05 * k as f64 + 2.0 * noise(k));
        assert!(leak.grows(200.0, 4.0) && (leak.slope - 0.05).abs() < 0.02, "{leak:?}");
        assert!(leak.low < 0.05 && 0.05 < leak.high, "{leak:?}");
        assert!(!of(|k| 5000.0 + 20.0 * noise(k)).grows(200.0, 0.0), "noise");
        assert!(!of(|_| 5000.0).grows(200.0, 0.0), "flat");
        assert!(!of(|k| if k == 199 { 1e9 } else { 5000.0 }).grows(200.0, 0.0), "one outlier at the end");
        assert!(!of(|k| 5000.0 - k as f64).grows(200.0, 0.0), "falling");
    }

    #[test]
    fn interval_equals_the_closed_form_for_a_line() {
        let line = of(|k| 3.0 * k as f64);
        assert_eq!((line.slope, line.low, line.high), (3.0, 3.0, 3.0));
        assert_eq!(Slope::of(&[(0.0, 0.0); 9]), None);
    }
}
