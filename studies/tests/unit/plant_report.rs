//! Tests of `src/plant/report.rs`.

use super::*;

#[test]
fn percentiles_are_of_the_sorted_durations() {
    let mut durations: Vec<u64> = (1..=1000).rev().map(|us| us * 1000).collect();
    let found = percentiles(&mut durations);
    assert_eq!((found.count, found.p50_us, found.p99_us, found.max_us), (1000, 501.0, 991.0, 1000.0));
    assert_eq!(percentiles(&mut []).count, 0);
}

#[test]
fn step_response_has_overshoot_settling_and_final_error() {
    // Rises linearly to 1.1 of the target at 1.1 s, falls to it at 1.2 s, stays.
    let force = |t: f64| if t <= 1.1 { t } else { (1.1 - (t - 1.1)).max(1.0) };
    let points: Vec<(f64, f64)> = (0..=400).map(|i| f64::from(i) * 0.01).map(|t| (t, force(t))).collect();
    let found = step_response(1.0, &points);
    assert!((found.overshoot - 0.1).abs() < 1e-9);
    assert!(found.settling_s.is_some_and(|s| (s - 1.15).abs() < 0.011), "{found:?}");
    assert!(found.final_error.abs() < 1e-12 && found.final_rms < 1e-12);
    assert_eq!(step_response(9.0, &points).settling_s, None, "it never got there");
}
