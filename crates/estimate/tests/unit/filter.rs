use super::*;
use crate::matrix::MAX_STATES;

fn keep(kept: &mut Rewind, t_s: f64, gap_floor_mm: f64) {
    kept.keep(t_s, &[t_s; MAX_STATES], &Symmetric::diagonal(&[1.0]), gap_floor_mm);
}

#[test]
fn last_estimate_before_the_contact_is_found_until_forgotten() {
    let mut kept = Rewind::new();
    (0..1000).for_each(|k| keep(&mut kept, f64::from(k), 0.1 * f64::from(k)));
    assert_eq!((kept.0.len(), kept.0.capacity()), (REWIND_MAX, REWIND_MAX));
    let found = kept.before_contact(90.0).expect("one");
    assert!((88.0..=88.5).contains(&found.gap_floor_mm), "{found:?}");
    assert!(kept.clone().0.capacity() >= REWIND_MAX);
    assert!(kept.before_contact(20.0).is_none(), "dropped for newer ones");
    kept.forget();
    assert!(kept.before_contact(90.0).is_none(), "all are removed");
}

#[test]
fn lower_estimates_are_removed_when_the_bound_rises() {
    let mut kept = Rewind::new();
    for floor_mm in [10.0, 20.0, 30.0, 5.0, 12.0] {
        keep(&mut kept, floor_mm, floor_mm);
    }
    let found = kept.before_contact(40.0).expect("one");
    assert_eq!(found.gap_floor_mm, 12.0);
}

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
            trend = Some(InputTrend::follow(trend, t_s, value, 5e-4 * 5e-4, 0.005));
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
    let at =
        |k: usize, value: f64, trend| Some(InputTrend::follow(trend, k as f64 / 200.0, value, 2.5e-7, 0.005));
    let mut trend = (0..100).fold(None, |trend, k| at(k, 0.02, trend));
    trend = at(100, 0.05, trend);
    assert_eq!(trend.map(|trend| trend.value()), Some(0.05));
    trend = at(101, 0.02, trend);
    assert_eq!(trend.map(|trend| trend.value()), Some(0.02));
}

#[test]
fn nan_is_replaced_by_the_next_value() {
    let wild = InputTrend::follow(None, 0.0, f64::NAN, 1.0, 0.1);
    assert_eq!(InputTrend::follow(Some(wild), 1.0, 3.0, 1.0, 0.1).value(), 3.0);
}
