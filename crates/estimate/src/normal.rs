//! Normal and chi-squared distributions.

/// Density of the standard normal distribution.
pub(crate) fn density(z: f64) -> f64 {
    (-0.5 * z * z).exp() / (2.0 * std::f64::consts::PI).sqrt()
}

/// Upper tail of the standard normal distribution, `P(Z > z)`.
pub(crate) fn upper_tail(z: f64) -> f64 {
    0.5 * libm::erfc(z * std::f64::consts::FRAC_1_SQRT_2)
}

/// Standard deviations beyond which the difference in [`truncated`] loses its digits.
const FAR: f64 = 30.0;

/// Mean and standard deviation of a normal variable known to lie above `floor`.
pub(crate) fn truncated(mean: f64, sigma: f64, floor: f64) -> (f64, f64) {
    let a = (floor - mean) / sigma;
    if a < -FAR {
        return (mean, sigma);
    }
    if a > FAR {
        // The tail is an exponential distribution of scale sigma / a to the first order.
        return (floor + sigma / a, sigma / a);
    }
    let ratio = density(a) / upper_tail(a);
    (mean + sigma * ratio, sigma * (1.0 + a * ratio - ratio * ratio).sqrt())
}

/// Chi-squared quantile of the probability of a standard normal variable below `z`, by the Wilson-Hilferty approximation; its
/// error is at most 0.5 % for the quantiles used here.
pub(crate) fn chi_squared_quantile(degrees: usize, z: f64) -> f64 {
    let n = degrees as f64;
    if degrees == 0 {
        return 0.0;
    }
    n * (1.0 - 2.0 / (9.0 * n) + z * (2.0 / (9.0 * n)).sqrt()).max(0.0).powi(3)
}

#[cfg(test)]
#[path = "../tests/unit/normal.rs"]
mod tests;
