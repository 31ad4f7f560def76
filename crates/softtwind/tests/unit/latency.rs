use super::*;

#[test]
fn percentiles_are_ordered_and_the_maximum_is_the_largest_value() {
    let mut latencies = Latencies::new();
    assert!(latencies.is_empty() && latencies.percentiles_us().max == 0.0);
    (1..=1000).for_each(|k| latencies.record_ns(1000 * k));
    let PercentilesUs { p50, p99, max } = latencies.percentiles_us();
    assert!((p50 - 500.0).abs() < 6.0 && (p99 - 990.0).abs() < 11.0 && (max - 1000.0).abs() < 11.0);
}
