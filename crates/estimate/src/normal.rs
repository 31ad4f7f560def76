//! The normal and chi-squared distributions, as far as the filter needs them.

/// Density of the standard normal distribution.
pub(crate) fn density(z: f64) -> f64 {
    (-0.5 * z * z).exp() / (2.0 * std::f64::consts::PI).sqrt()
}

/// Upper tail of the standard normal distribution, `P(Z > z)`.
pub(crate) fn upper_tail(z: f64) -> f64 {
    0.5 * libm::erfc(z * std::f64::consts::FRAC_1_SQRT_2)
}

/// Beyond this many standard deviations the difference below has too few digits left.
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

/// The value below which a chi-squared variable lies with the probability of a standard normal one below `z`: Wilson and
/// Hilferty's cube, off by at most 0.5 % for the quantiles used here.
pub(crate) fn chi_squared_quantile(degrees: usize, z: f64) -> f64 {
    let n = degrees as f64;
    if degrees == 0 {
        return 0.0;
    }
    n * (1.0 - 2.0 / (9.0 * n) + z * (2.0 / (9.0 * n)).sqrt()).max(0.0).powi(3)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tails_are_those_of_tables() {
        for (z, tail) in
            [(0.0, 0.5), (1.0, 0.158_655_253_931), (2.0, 0.022_750_131_948), (5.0, 2.866_515_7e-7)]
        {
            assert!((upper_tail(z) / tail - 1.0).abs() < 1e-5, "{z}: {}", upper_tail(z));
            assert!((upper_tail(-z) - (1.0 - tail)).abs() < 1e-9);
        }
    }

    #[test]
    fn truncation_moves_the_mean_above_the_floor_and_narrows() {
        // At the mean: mean + sigma sqrt(2 / pi), variance sigma^2 (1 - 2 / pi).
        let (mean, sigma) = truncated(40.0, 15.0, 40.0);
        assert!(
            (mean - 40.0 - 15.0 * 0.797_884_56).abs() < 1e-6 && (sigma - 15.0 * 0.602_810_275).abs() < 1e-6
        );
        let (mean, sigma) = truncated(40.0, 15.0, -200.0);
        assert!((mean - 40.0).abs() < 1e-6 && (sigma - 15.0).abs() < 1e-6);
        let (mean, sigma) = truncated(0.0, 1.0, 12.0);
        assert!(mean > 12.0 && mean < 12.1 && sigma > 0.0 && sigma < 0.1);
    }

    #[test]
    fn quantiles_of_chi_squared_are_those_of_tables() {
        for (degrees, z, expected) in
            [(1, 1.959_964, 5.023_9), (3, 1.959_964, 9.348_4), (10, -1.959_964, 3.246_97)]
        {
            let found = chi_squared_quantile(degrees, z);
            assert!((found / expected - 1.0).abs() < 0.03, "{degrees}: {found}");
        }
    }
}
