//! Tests of `src/source/sensor.rs` that need its private parts: calibration, filter, pauses.

use super::*;
use proptest::prelude::*;

fn spec(points: &[[f64; 2]]) -> ValueSpec<()> {
    let (scale, offset, filter) = (1.0, 0.0, FilterSpec::Off);
    ValueSpec {
        from: (),
        scale,
        offset,
        points: points.to_vec(),
        unit: None,
        filter,
        no_value: vec![],
        sigma: None,
    }
}

/// Inputs that are measured.
fn named() -> InputNames {
    InputNames::new(["load_n", "flow_1", "force_n"])
}

fn problems_of(name: &str, value: ValueSpec<()>) -> Vec<String> {
    let (mut found, values) = (Vec::new(), Values::from([(name.to_owned(), value)]));
    problems(&values, &named(), &mut Problems::new(&mut found, ""), |(), _| {});
    found
}

#[test]
fn factor_offset_and_unit() {
    let value = ValueSpec { scale: 2.0, offset: -1.0, unit: Some("kPa".into()), ..spec(&[]) };
    let channel = value.channel("pressure_mpa", &InputNames::default()).unwrap();
    assert_eq!((channel.slot, channel.calibration.apply(26.0)), (0, Some(51.0 * 1e-3)));
    assert!(channel.calibration.apply(f64::NAN).unwrap().is_nan());
    assert_eq!(spec(&[]).channel("marker2_z_mm", &InputNames::default()).unwrap().slot, 8);
    assert!(spec(&[]).channel("gap", &InputNames::default()).is_none());
}

#[test]
fn a_measured_input_is_a_value_with_the_unit_of_its_name() {
    let value = ValueSpec { unit: Some("mN".into()), ..spec(&[]) };
    let channel = value.channel("load_n", &named()).unwrap();
    assert_eq!((channel.slot, channel.calibration.apply(26.0)), (NAMED, Some(26.0 * 1e-3)));
    assert_eq!(spec(&[]).channel("flow_1", &named()).unwrap().slot, NAMED + 1);
    assert_eq!(
        spec(&[]).channel("force_n", &named()).unwrap().slot,
        NAMED + 2,
        "the model's, not the contact's"
    );
    assert_eq!(spec(&[]).channel("force_n", &InputNames::default()).unwrap().slot, FORCE);
    assert!(spec(&[]).channel("load_n", &InputNames::default()).is_none());
    assert!(problems_of("load_n", ValueSpec { unit: Some("mm".into()), ..spec(&[]) })[0].contains("load_n"));
    assert!(problems_of("flow_1", ValueSpec { unit: Some("N".into()), ..spec(&[]) })[0].contains("flow_1"));
    assert!(problems_of("load", spec(&[]))[0].contains("`load_n`"));
}

#[test]
fn a_table_is_straight_between_its_points_and_has_no_value_outside() {
    let channel =
        spec(&[[0.5, 0.0], [2.5, 10.0], [4.5, 40.0]]).channel("gap_mm", &InputNames::default()).unwrap();
    let at = |raw| channel.calibration.apply(raw);
    assert_eq!([at(0.5), at(1.5), at(2.5), at(4.5)], [Some(0.0), Some(5.0), Some(10.0), Some(40.0)]);
    assert_eq!([at(0.4999), at(4.5001), at(-1e300)], [None; 3], "refused, not clamped");
}

#[test]
fn all_errors_in_a_value_are_listed() {
    let bad = ValueSpec {
        scale: 0.0,
        offset: f64::NAN,
        unit: Some("bar".into()),
        filter: FilterSpec::Median(2),
        sigma: Some(0.0),
        ..spec(&[[1.0, 0.0], [1.0, 2.0]])
    };
    let found = problems_of("gap_mm", bad);
    for key in ["unit", "scale", "offset", "points", "sigma", "filter"] {
        assert!(found.iter().any(|text| text.contains(&format!("values.gap_mm.{key}"))), "{key}: {found:#?}");
    }
    assert!(problems_of("pressure", spec(&[]))[0].contains("`pressure_mpa`"));
    assert!(problems_of("marker9_x_mm", spec(&[]))[0].contains("marker"));
    assert!(
        problems_of("gap_mm", ValueSpec { scale: 3.0, ..spec(&[[0.0, 0.0], [1.0, 1.0]]) })[0]
            .contains("either")
    );
}

proptest! {
    /// Between its ends a rising table is rising, and a table of two points is a line.
    #[test]
    fn a_rising_table_is_rising(steps in prop::collection::vec((0.01f64..5.0, 0.01f64..5.0), 1..8), a in 0.0f64..1.0, b in 0.0f64..1.0) {
        let mut points = vec![[0.0, 0.0]];
        for (dx, dy) in &steps {
            let [x, y] = points[points.len() - 1];
            points.push([x + dx, y + dy]);
        }
        let end = points[points.len() - 1][0];
        let channel = spec(&points).channel("force_n", &InputNames::default()).unwrap();
        let at = |share: f64| channel.calibration.apply(share * end).unwrap();
        prop_assert!((a <= b) == (at(a) <= at(b)) || (a - b).abs() < 1e-12);
    }
}

#[test]
fn a_median_removes_a_spike_and_keeps_a_step() {
    let mut filter = Filter::new(FilterSpec::Median(3));
    let out: Vec<f64> =
        [1.0, 1.0, 9.0, 1.0, 2.0, 2.0, 2.0].iter().map(|value| filter.apply(0, *value)).collect();
    assert_eq!(out[1..], [1.0, 1.0, 1.0, 2.0, 2.0, 2.0]);
}

/// The closed form of the first-order step response, whatever the rate it is sampled at.
#[test]
fn low_pass_has_the_step_response_of_theory() {
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

#[test]
fn pauses_double_up_to_the_limit_and_restart() {
    let mut backoff = Backoff::new(Duration::from_millis(100));
    let pauses: Vec<u128> = (0..5).map(|_| backoff.take().as_millis()).collect();
    assert_eq!(pauses, [20, 40, 80, 100, 100]);
    backoff.reset();
    assert_eq!(backoff.take().as_millis(), 20);
}
