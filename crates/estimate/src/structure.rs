//! Structure of the residuals of a fit over time: a model that explains a recording leaves noise.

/// Smallest number of residuals with a structure.
const MIN_COUNT: usize = 8;
/// Autocorrelation from which it is no chance, in standard deviations of that of white noise.
const SIGNIFICANT: f64 = 4.0;
/// Smallest fraction of the residuals' square for which lag or drift is named.
const NAMED_SHARE: f64 = 0.2;
/// Smallest change of the driving input, as a fraction of its range, that counts as rising or falling.
const STILL: f64 = 1e-3;

/// A measured quantity over time.
#[derive(Clone, Copy, Debug)]
pub struct Series<'a> {
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
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Structure {
    /// Root mean square of all residuals, outliers included.
    pub rms: f64,
    /// Root of the covariance of neighbouring residuals: what is not noise.
    pub systematic: f64,
    /// Whether that is larger than one standard deviation, and no chance.
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
    pub fn of(series: Series<'_>) -> Option<Self> {
        let Series { t_s, measured, predicted, driving, sigma } = series;
        let residual = |i: usize| measured[i] - predicted[i];
        let kept: Vec<usize> = (0..t_s.len()).filter(|i| residual(*i).is_finite()).collect();
        if kept.len() < MIN_COUNT {
            return None;
        }
        let n = kept.len() as f64;
        let square = kept.iter().map(|i| residual(*i).powi(2)).sum::<f64>();
        let neighbours =
            kept.windows(2).map(|pair| residual(pair[0]) * residual(pair[1])).sum::<f64>() / (n - 1.0);
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
        let lag_s = regress(kept.windows(2).map(|pair| (slope(pair), residual(pair[1]))), square);
        let drift_per_s = regress(kept.iter().map(|i| (t_s[*i] - middle_s, residual(*i))), square);
        let systematic = neighbours.max(0.0).sqrt();
        let significant = neighbours > SIGNIFICANT * square / n / n.sqrt();
        Some(Self {
            rms: (square / n).sqrt(),
            systematic,
            is_unexplained: significant && systematic > sigma,
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
