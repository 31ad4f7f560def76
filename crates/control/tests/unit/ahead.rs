use super::*;

const DT_S: f64 = 5e-3;

/// The largest error of what a trend says `ahead_s` ahead, over two seconds after `from_s`.
fn error(target: impl Fn(f64) -> Target, from_s: f64, ahead_s: f64) -> f64 {
    let mut trend = TargetTrend::default();
    let times = (0..((from_s + 2.0) / DT_S) as usize).map(|cycle| cycle as f64 * DT_S);
    let errors = times.map(|t_s| {
        let found = trend.step(target(t_s), DT_S)(ahead_s);
        if t_s < from_s { 0.0 } else { (found.value - target(t_s + ahead_s).value).abs() }
    });
    errors.fold(0.0, f64::max)
}

#[test]
fn a_sine_is_continued_better_than_by_a_straight_line() {
    for (hz, ahead_s) in [(0.3, 0.25), (0.5, 0.25), (1.0, 0.1)] {
        let w = std::f64::consts::TAU * hz;
        let sine = |t_s: f64| Target { value: (w * t_s).sin(), rate: w * (w * t_s).cos() };
        // Of a straight line the error is 2 (1 - cos) and the like: about half of the square of the angle.
        let straight = 0.5 * (w * ahead_s).powi(2);
        let found = error(sine, 1.0, ahead_s);
        assert!(found < 0.5 * straight, "{hz} Hz: {found}, {straight}");
    }
}

#[test]
fn a_ramp_is_continued_exactly_and_its_bend_is_no_trend() {
    let ramp = |t_s: f64| match t_s < 1.0 {
        true => Target::step(0.0),
        false => Target { value: 2.0 * (t_s - 1.0), rate: 2.0 },
    };
    assert!(error(ramp, 1.0, 0.2) < 1e-12);
    assert!(error(|_| Target::step(3.0), 0.0, 0.2) < 1e-12);
}

#[test]
fn a_series_is_straight_between_its_values_and_stays_after_them() {
    let series = TargetSeries { values: &[1.0, 3.0, 2.0], interval_s: 0.1 };
    assert_eq!(series.at(0.0), Target { value: 1.0, rate: 20.0 });
    assert!((series.at(0.15).value - 2.5).abs() < 1e-12 && (series.at(0.15).rate + 10.0).abs() < 1e-12);
    assert_eq!(series.at(0.2), Target::step(2.0));
    assert_eq!(series.at(5.0), Target::step(2.0));
    assert_eq!(TargetSeries { values: &[4.0], interval_s: 0.1 }.at(0.0), Target::step(4.0));
    assert!(TargetSeries { values: &[], interval_s: 0.1 }.at(0.0).value.is_nan());
}
