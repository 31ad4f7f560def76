//! Tests of `src/source/sensor/filter.rs` that need its private parts.

use super::*;
use proptest::prelude::*;

#[test]
fn a_median_removes_a_spike_and_keeps_a_step() {
    let mut filter = Filter::new(FilterSpec::Median(3));
    let out: Vec<f64> =
        [1.0, 1.0, 9.0, 1.0, 2.0, 2.0, 2.0].iter().map(|value| filter.apply(0, *value)).collect();
    assert_eq!(out[1..], [1.0, 1.0, 1.0, 2.0, 2.0, 2.0]);
}

/// The closed form of the first-order step response, whatever the rate it is sampled at.
#[test]
fn a_low_pass_answers_a_step_as_theory_says() {
    for step_ns in [1_000_000u64, 5_000_000, 20_000_000] {
        let mut filter = Filter::new(FilterSpec::LowPassHz(2.0));
        filter.apply(0, 0.0);
        let mut t_ns = 0;
        while t_ns < 200_000_000 {
            t_ns += step_ns;
            let expected = 1.0 - (-(t_ns as f64) * 1e-9 * std::f64::consts::TAU * 2.0).exp();
            assert!((filter.apply(t_ns, 1.0) - expected).abs() < 1e-12);
        }
    }
}

#[test]
fn nan_passes_and_leaves_no_trace() {
    for spec in [FilterSpec::Off, FilterSpec::Median(3), FilterSpec::LowPassHz(1.0)] {
        let mut filter = Filter::new(spec);
        filter.apply(0, 1.0);
        assert!(filter.apply(1, f64::NAN).is_nan() && filter.apply(2, f64::INFINITY).is_infinite());
        assert_eq!(filter.apply(3, 1.0), 1.0, "{spec:?}");
    }
}

proptest! {
    /// A filter never leaves the range of what it was given.
    #[test]
    fn a_filter_stays_within_its_input(values in prop::collection::vec(-1e6f64..1e6, 1..60), which in 0usize..3) {
        let spec = [FilterSpec::Off, FilterSpec::Median(5), FilterSpec::LowPassHz(3.0)][which];
        let mut filter = Filter::new(spec);
        let (low, high) = values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(*v), b.max(*v)));
        for (index, value) in (0u64..).zip(&values) {
            let out = filter.apply(index * 7_000_000, *value);
            prop_assert!(out >= low && out <= high, "{out} outside {low} .. {high}");
        }
    }
}
