use super::*;

/// Noise of standard deviation 1: sum of twelve uniform numbers from a linear congruence.
fn noise(seed: &mut u64) -> f64 {
    let mut uniform = || {
        *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (*seed >> 11) as f64 / (1_u64 << 53) as f64
    };
    (0..12).map(|_| uniform()).sum::<f64>() - 6.0
}

/// Errors at the end of ramps in standard deviations of the trend, and the standard deviation.
fn ramps(rate: f64) -> (Vec<f64>, f64) {
    let (mut seed, mut off, mut sigma) = (7, Vec::new(), 0.0);
    for _ in 0..200 {
        let mut trend = None;
        for k in 0..400 {
            let t_s = f64::from(k) / 200.0;
            let value = rate * t_s + 5e-4 * noise(&mut seed);
            trend = Some(Trend::follow(trend, t_s, value, 5e-4 * 5e-4, 0.005));
        }
        let trend = trend.expect("values");
        sigma = trend.variance().sqrt();
        off.push((trend.value() - rate * 399.0 / 200.0) / sigma);
    }
    (off, sigma)
}

#[test]
fn noise_averages_out_on_a_ramp_without_lag() {
    for rate in [0.0, 0.01, -0.02] {
        let (off, sigma) = ramps(rate);
        assert!(sigma < 0.35 * 5e-4, "{sigma}");
        let mean = off.iter().sum::<f64>() / 200.0;
        // A constant rate is the best case of a rate that walks.
        let square = off.iter().map(|off| off * off).sum::<f64>() / 200.0;
        assert!(mean.abs() < 0.25 && (0.5..1.2).contains(&square), "{rate}: {mean} {square}");
    }
}

#[test]
fn step_restarts_the_trend() {
    let at = |k: usize, value: f64, trend| Some(Trend::follow(trend, k as f64 / 200.0, value, 2.5e-7, 0.005));
    let mut trend = (0..100).fold(None, |trend, k| at(k, 0.02, trend));
    trend = at(100, 0.05, trend);
    assert_eq!(trend.map(|trend| trend.value()), Some(0.05));
    trend = at(101, 0.02, trend);
    assert_eq!(trend.map(|trend| trend.value()), Some(0.02));
}

#[test]
fn nan_is_replaced_by_the_next_value() {
    let wild = Trend::follow(None, 0.0, f64::NAN, 1.0, 0.1);
    assert_eq!(Trend::follow(Some(wild), 1.0, 3.0, 1.0, 0.1).value(), 3.0);
}
