//! Tests of `src/latency.rs` that need its private parts.

use proptest::prelude::*;

proptest! {
    #[test]
    fn percentiles_are_those_of_the_sorted_values_within_a_percent(
        values in prop::collection::vec(prop_oneof![1..100u64, 1_000..1_000_000u64, 1..super::MAX_NS], 1..300),
        share in 0.0..=1.0f64,
    ) {
        let mut histogram = super::histogram();
        values.iter().for_each(|value| histogram.saturating_record(*value));
        let mut sorted = values.clone();
        sorted.sort_unstable();
        let rank = ((values.len() as f64 * share).ceil() as usize).max(1);
        let exact = sorted[rank - 1];
        let found = histogram.value_at_quantile(share);
        prop_assert!(found >= exact && found - exact <= exact / 100, "{found} for {exact}");
        let largest = sorted[sorted.len() - 1];
        prop_assert!(histogram.max() >= largest && histogram.max() - largest <= largest / 100);
    }
}

#[test]
fn empty_histogram_is_zero_and_durations_are_limited_to_an_hour() {
    let mut histogram = super::histogram();
    histogram.saturating_record(u64::MAX);
    assert!(histogram.max() >= super::MAX_NS && histogram.max() < super::MAX_NS / 50 * 51);
    histogram.reset();
    assert_eq!((histogram.value_at_quantile(0.5), histogram.max(), histogram.len()), (0, 0, 0));
}
