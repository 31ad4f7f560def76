//! Tests of `src/cmd/plot/recording.rs` that need its private parts.

use super::*;

#[test]
fn envelope_is_short_and_keeps_extremes() {
    let mut points: Vec<(f64, f64)> = (0..100_000).map(|i| (f64::from(i), 1.0)).collect();
    (points[33_333].1, points[77_777].1) = (500.0, -3.0);
    let thin = envelope(&points);
    assert!(thin.len() <= MAX_POINTS + 2 && thin.windows(2).all(|pair| pair[0].0 <= pair[1].0));
    assert!(thin.contains(&(33_333.0, 500.0)) && thin.contains(&(77_777.0, -3.0)));
    assert_eq!(envelope(&points[..MAX_POINTS]), points[..MAX_POINTS]);
}
