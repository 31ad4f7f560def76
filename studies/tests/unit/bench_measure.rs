//! Tests of `src/bench/measure.rs` that need its private parts.

use super::*;

#[test]
fn quantiles_are_microseconds_and_tails_fall_to_one_sample() {
    let mut series = Durations::new("x");
    (1..=1000u64).rev().for_each(|us| series.push(us * 1000));
    let q = series.quantiles();
    for (found, expected) in [(q.p50, 500.0), (q.p99, 990.0), (q.p999, 999.0), (q.max, 1000.0)] {
        assert!((found / expected - 1.0).abs() < 1e-3, "{found} is not {expected}");
    }
    let tail = series.tail();
    assert!(tail.windows(2).all(|w| w[0].0 <= w[1].0 && w[0].1 >= w[1].1) && tail.len() < 500);
    assert_eq!(tail.last().map(|last| last.1), Some(0.001));
    assert!(Durations::new("x").p50().is_nan());
}

#[test]
fn bandwidth_is_bytes_over_time() {
    assert_eq!(gbps(3_000_000, 30.0), 100.0);
}
