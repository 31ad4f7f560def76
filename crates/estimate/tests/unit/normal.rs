use super::*;

#[test]
fn tails_agree_with_tables() {
    for (z, tail) in [(0.0, 0.5), (1.0, 0.158_655_253_931), (2.0, 0.022_750_131_948), (5.0, 2.866_515_7e-7)] {
        assert!((upper_tail(z) / tail - 1.0).abs() < 1e-5, "{z}: {}", upper_tail(z));
        assert!((upper_tail(-z) - (1.0 - tail)).abs() < 1e-9);
    }
}

#[test]
fn truncated_normal_has_a_mean_above_the_floor_and_a_smaller_deviation() {
    // At the mean: mean + sigma sqrt(2 / pi), variance sigma^2 (1 - 2 / pi).
    let (mean, sigma) = truncated(40.0, 15.0, 40.0);
    assert!((mean - 40.0 - 15.0 * 0.797_884_56).abs() < 1e-6 && (sigma - 15.0 * 0.602_810_275).abs() < 1e-6);
    let (mean, sigma) = truncated(40.0, 15.0, -200.0);
    assert!((mean - 40.0).abs() < 1e-6 && (sigma - 15.0).abs() < 1e-6);
    let (mean, sigma) = truncated(0.0, 1.0, 12.0);
    assert!(mean > 12.0 && mean < 12.1 && sigma > 0.0 && sigma < 0.1);
}

#[test]
fn chi_squared_quantiles_agree_with_tables() {
    for (degrees, z, expected) in
        [(1, 1.959_964, 5.023_9), (3, 1.959_964, 9.348_4), (10, -1.959_964, 3.246_97)]
    {
        let found = chi_squared_quantile(degrees, z);
        assert!((found / expected - 1.0).abs() < 0.03, "{degrees}: {found}");
    }
}
