//! Structure of residuals over time: a model that explains its readings leaves noise, in which neighbours are independent.
//!
//! `softtwin calibrate` looks at a whole recording ([`Structure`]), the running filter at the readings of a window (`Window`). Both
//! decide by the same sums ([`NeighbourSums`]): the covariance of neighbouring residuals is the square of what is not noise.

use crate::setup::{MAX_ROWS, MeasuredRow};
use serde::Serialize;

/// Smallest number of residuals with a structure.
const MIN_COUNT: usize = 8;
/// Autocorrelation from which it is no chance, in standard deviations of that of white noise.
const SIGNIFICANT: f64 = 4.0;
/// Smallest fraction of the residuals' square for which lag or drift is named.
const NAMED_SHARE: f64 = 0.2;
/// Smallest change of the driving input, as a fraction of its range, that counts as rising or falling.
const STILL: f64 = 1e-3;

/// Squares of residuals and products of neighbours, with weights that may fall with time.
#[derive(Clone, Copy, Debug, Default)]
struct NeighbourSums {
    last: Option<f64>,
    /// Sums of the weights and of their squares, of the weighted squares and products.
    weights: f64,
    squared_weights: f64,
    squares: f64,
    products: f64,
    pairs: f64,
}

impl NeighbourSums {
    /// Adds the next residual.
    fn add(&mut self, residual: f64) {
        self.weights += 1.0;
        self.squared_weights += 1.0;
        self.squares += residual * residual;
        if let Some(last) = self.last.replace(residual) {
            self.products += last * residual;
            self.pairs += 1.0;
        }
    }

    /// Reduces the weight of all residuals to this part.
    fn forget(&mut self, keep: f64) {
        let sums = [&mut self.weights, &mut self.squares, &mut self.products, &mut self.pairs];
        sums.into_iter().for_each(|sum| *sum *= keep);
        self.squared_weights *= keep * keep;
    }

    /// Number of residuals of equal weight that would average as well.
    fn count(&self) -> f64 {
        self.weights * self.weights / self.squared_weights
    }

    fn mean_square(&self) -> f64 {
        self.squares / self.weights
    }

    /// Covariance of neighbours; NaN without any.
    fn neighbours(&self) -> f64 {
        self.products / self.pairs
    }

    /// Standard deviation of that covariance if all residuals are noise.
    fn chance(&self) -> f64 {
        self.mean_square() / self.count().sqrt()
    }

    /// Root of the covariance of neighbours: what is not noise.
    fn systematic(&self) -> f64 {
        self.neighbours().max(0.0).sqrt()
    }

    /// Whether that is larger than one standard deviation of sensor and model, and no chance.
    fn is_unexplained(&self, sigma: f64) -> bool {
        self.neighbours() > SIGNIFICANT * self.chance() && self.systematic() > sigma
    }
}

/// Time constant of the window's weights, s.
const WINDOW_S: f64 = 10.0;
/// Part of the residuals that is no noise, in standard deviations of sensor and model, from which an alarm says so. Up to it the wider
/// intervals say enough: a running estimate follows its readings, while one of constants is refused from 1 on.
const BEYOND_WIDENING: f64 = 3.0;
/// Least error of a model, in standard deviations of the sensor, that residuals are compared with.
const LEAST_MODEL_ERROR: f64 = 0.1;

/// Residuals of the last readings by row, with weights `exp(-t / 10 s)`.
#[derive(Clone, Debug, Default)]
pub(crate) struct Window {
    last_t_s: Option<f64>,
    rows: [NeighbourSums; MAX_ROWS],
}

impl Window {
    /// Adds the residuals of a reading; NaN: none.
    pub(crate) fn add(&mut self, t_s: f64, residuals: &[f64; MAX_ROWS]) {
        let passed_s = t_s - self.last_t_s.replace(t_s).unwrap_or(t_s);
        let keep = (-passed_s / WINDOW_S).exp();
        for (sums, residual) in self.rows.iter_mut().zip(residuals) {
            sums.forget(keep);
            if residual.is_finite() {
                sums.add(*residual);
            }
        }
    }

    /// Rows with enough residuals, beside their sums.
    fn known<'a>(
        &'a self,
        rows: &'a [MeasuredRow],
    ) -> impl Iterator<Item = (&'a NeighbourSums, &'a MeasuredRow)> {
        self.rows.iter().zip(rows).filter(|(sums, _)| sums.count() >= MIN_COUNT as f64)
    }

    /// Whether the residuals of a row have a structure that sensor and model do not explain.
    pub(crate) fn is_unexplained(&self, rows: &[MeasuredRow]) -> bool {
        self.known(rows).any(|(sums, row)| sums.is_unexplained(BEYOND_WIDENING * row.variance(1.0).sqrt()))
    }

    /// Factor of the standard deviations of estimates: how many times larger the part of the residuals that is no noise is than the
    /// model's error, in the row where it is largest; at least 1.
    pub(crate) fn widening(&self, rows: &[MeasuredRow]) -> f64 {
        let factor = |(sums, row): (&NeighbourSums, &MeasuredRow)| {
            let beyond = sums.neighbours() - sums.chance();
            if beyond > 0.0 {
                beyond.sqrt() / row.model_sigma.max(LEAST_MODEL_ERROR * row.sigma)
            } else {
                0.0
            }
        };
        self.known(rows).map(factor).fold(1.0, f64::max)
    }
}

/// A measured quantity over time.
#[derive(Clone, Copy, Debug)]
pub struct ResidualSeries<'a> {
    /// Times, s.
    pub t_s: &'a [f64],
    /// Measured values; NaN: none.
    pub measured: &'a [f64],
    /// Values of the model with the fitted constants.
    pub predicted: &'a [f64],
    /// Input that drives it, such as the pressure.
    pub driving: &'a [f64],
    /// Standard deviation of measurement and model together.
    pub sigma: f64,
}

/// Structure of the residuals `measured - predicted` of one quantity.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Structure {
    /// Root mean square of all residuals, outliers included.
    pub rms: f64,
    /// Root of the covariance of neighbouring residuals: what is not noise.
    pub systematic: f64,
    /// Whether that is larger than one standard deviation, and no chance.
    #[serde(skip)]
    pub is_unexplained: bool,
    /// Mean residual while the driving input rises minus that while it falls, as a fraction of the measured range.
    pub loop_share: f64,
    /// Time by which the measurement follows the model, s, where that explains a good part of the residuals.
    pub lag_s: Option<f64>,
    /// Change per second, where that explains a good part of the residuals.
    pub drift_per_s: Option<f64>,
}

impl Structure {
    /// `None` with fewer than eight values. Cost: linear in the values.
    pub fn of(series: ResidualSeries<'_>) -> Option<Self> {
        let ResidualSeries { t_s, measured, predicted, driving, sigma } = series;
        let residual = |i: usize| measured[i] - predicted[i];
        let kept: Vec<usize> = (0..t_s.len()).filter(|i| residual(*i).is_finite()).collect();
        if kept.len() < MIN_COUNT {
            return None;
        }
        let n = kept.len() as f64;
        let mut sums = NeighbourSums::default();
        kept.iter().for_each(|i| sums.add(residual(*i)));
        let range = |values: &[f64]| {
            let finite = || kept.iter().map(|i| values[*i]).filter(|value| value.is_finite());
            finite().fold(f64::NEG_INFINITY, f64::max) - finite().fold(f64::INFINITY, f64::min)
        };
        let step = STILL * range(driving);
        let mean = |sign: f64| {
            let moves = |pair: &&[usize]| sign * (driving[pair[1]] - driving[pair[0]]) > step;
            let (sum, count) = kept
                .windows(2)
                .filter(moves)
                .fold((0.0, 0.0), |(sum, count), pair| (sum + residual(pair[1]), count + 1.0));
            (count > 0.0).then(|| sum / count)
        };
        let between = mean(1.0).zip(mean(-1.0)).map_or(0.0, |(rising, falling)| rising - falling);
        let slope = |pair: &[usize]| {
            (predicted[pair[1]] - predicted[pair[0]]) / (t_s[pair[1]] - t_s[pair[0]]).max(f64::MIN_POSITIVE)
        };
        let middle_s = kept.iter().map(|i| t_s[*i]).sum::<f64>() / n;
        let lag_s = regress(kept.windows(2).map(|pair| (slope(pair), residual(pair[1]))), sums.squares);
        let drift_per_s = regress(kept.iter().map(|i| (t_s[*i] - middle_s, residual(*i))), sums.squares);
        Some(Self {
            rms: sums.mean_square().sqrt(),
            systematic: sums.systematic(),
            is_unexplained: sums.is_unexplained(sigma),
            loop_share: if range(measured) > 0.0 { between / range(measured) } else { 0.0 },
            lag_s: lag_s.map(|slope| -slope).filter(|lag_s| *lag_s > 0.0),
            drift_per_s,
        })
    }
}

/// Factor of `x` in `y`, where it explains a good part of the sum of all squares of `y`.
fn regress(pairs: impl Iterator<Item = (f64, f64)>, square: f64) -> Option<f64> {
    let finite = pairs.filter(|(x, y)| x.is_finite() && y.is_finite());
    let (xy, xx) = finite.fold((0.0, 0.0), |(xy, xx), (x, y)| (xy + x * y, xx + x * x));
    (xx > 0.0 && xy * xy > NAMED_SHARE * xx * square).then(|| xy / xx)
}
