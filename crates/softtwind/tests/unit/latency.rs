use super::*;

#[test]
fn percentiles_are_ordered_and_the_maximum_is_the_largest_value() {
    let mut latencies = Latencies::new().expect("allowed bounds");
    assert!(latencies.is_empty() && latencies.percentiles_us().max == 0.0);
    (1..=1000).for_each(|k| latencies.record_ns(1000 * k));
    let PercentilesUs { p50, p99, max } = latencies.percentiles_us();
    assert!((p50 - 500.0).abs() < 1.0 && (p99 - 990.0).abs() < 2.0 && (max - 1000.0).abs() < 1.0);
    latencies.record_ns(u64::MAX);
    assert!(latencies.percentiles_us().max >= MAX_NS as f64 / 1000.0, "saturated, not lost");
}
