//! Tests of `src/twin/residual.rs` that need its private parts.

use super::*;
use proptest::prelude::*;
use rom::rng::Rng;

const MS: u64 = 1_000_000;

fn residual(ms: u64, value: f64, halfwidth: f64) -> Residual {
    Residual { t_sensor_ns: ms * MS, value, halfwidth, sigma: 0.0 }
}

#[test]
fn the_alarm_comes_after_the_time_and_goes_at_once() {
    let mut watch = ResidualWatch::default();
    let mut at = |ms: u64, value: f64| watch.update(residual(ms, value, 0.02), 0.3).mismatch;
    assert!(!at(0, 0.01) && !at(100, -0.5) && !at(200, 0.5) && !at(300, -0.5), "too short and too few");
    assert!(!at(399, 0.5), "outside for 299 ms is no alarm");
    assert!(at(400, -0.5) && at(500, 0.03), "300 ms are, on either side");
    assert!(!at(600, 0.02), "back inside: over");
    assert!(
        !at(700, 0.5) && !at(1_000, -0.5) && !at(1_100, 0.5) && !at(1_200, -0.5),
        "and the time restarts"
    );
    assert!(at(1_300, 0.5), "five readings are enough");
}

#[test]
fn outlier_or_missing_value_restarts_the_time() {
    let mut watch = ResidualWatch::default();
    for ms in 0..1_000u64 {
        let value = if ms % 100 == 99 { f64::NAN } else { 1.0 };
        assert!(!watch.update(residual(ms, value, 0.02), 0.2).mismatch, "{ms} ms");
    }
    let judged = watch.update(residual(0, 1.0, f64::NAN), 0.0);
    assert!(!judged.mismatch, "without a half-width nothing can be said");
}

#[test]
fn contribution_is_zero_without_measurement_and_stays_while_none_comes() {
    let mut watch = ResidualWatch::default();
    let none = Residual { t_sensor_ns: 0, value: f64::NAN, halfwidth: 1e-4, sigma: 0.005 };
    assert_eq!(watch.update(none, 0.5), ResidualVerdict { contribution: 0.0, mismatch: false });
    for k in 1..400_u64 {
        let _moves = watch.update(Residual { t_sensor_ns: 5 * k * MS, value: 0.04, ..none }, 0.5);
    }
    assert!(watch.update(Residual { t_sensor_ns: 3_000 * MS, ..none }, 0.5).contribution >= 0.04);
    watch.restart();
    assert_eq!(watch.update(none, 0.5).contribution, 0.0);
}

#[test]
fn single_outlier_does_not_widen_and_two_in_a_row_do() {
    let (mut seen, mut random) = (Seen::default(), Rng::new(3));
    let mut at = |k: u64, value: f64| seen.update(1_000 * MS + 5 * k * MS, value, 0.2);
    for k in 0..395 {
        let value = if k % 50 == 49 { 30.0 } else { 0.2 * random.normal() };
        let contribution = at(k, value);
        assert!(contribution < 0.4, "{contribution} mm at reading {k}");
    }
    assert!(at(400, 30.0) < 0.4 && at(401, 30.0) > 20.0);
}

/// Half-width of the model, N.
const HALFWIDTH_N: f64 = 1e-4;

/// Coverage of the true error after the first second, mean half-width (N), and time of the first alarm (s), over 20 s of readings whose
/// prediction is off by `error_n` of the time.
fn run(seed: u64, rate_hz: f64, sigma: f64, error_n: impl Fn(f64) -> f64) -> (f64, f64, Option<f64>) {
    let (mut watch, mut random) = (ResidualWatch::default(), Rng::new(seed));
    let (mut within, mut counted, mut sum, mut alarm_s) = (0, 0, 0.0, None);
    for k in 0..(20.0 * rate_hz) as u64 {
        let t_s = k as f64 / rate_hz;
        let value = error_n(t_s) + sigma * random.normal();
        let t_sensor_ns = 1_000 * MS + (t_s * 1e9) as u64;
        let judged = watch.update(Residual { t_sensor_ns, value, halfwidth: HALFWIDTH_N, sigma }, 0.5);
        if judged.mismatch {
            alarm_s.get_or_insert(t_s);
        }
        if t_s >= 1.0 {
            let halfwidth_n = HALFWIDTH_N.hypot(judged.contribution);
            counted += 1;
            within += u32::from(error_n(t_s).abs() <= halfwidth_n);
            sum += halfwidth_n;
        }
    }
    (f64::from(within) / f64::from(counted), sum / f64::from(counted), alarm_s)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn half_width_contains_a_steady_offset(
        seed in 1_u64..1_000_000, rate_hz in 20.0..500.0_f64, sigma in 0.001..0.006_f64,
        offset_n in 0.025..0.043_f64, side in prop::bool::ANY,
    ) {
        let offset_n = if side { offset_n } else { -offset_n };
        let (coverage, mean_n, alarm_s) = run(seed, rate_hz, sigma, |_| offset_n);
        prop_assert!(coverage >= 0.95, "{}", coverage);
        prop_assert!(mean_n < offset_n.abs() + 1.5 * sigma, "{}", mean_n);
        prop_assert!(alarm_s.is_some_and(|alarm_s| alarm_s <= 1.0), "{:?}", alarm_s);
    }

    #[test]
    fn half_width_contains_an_error_that_moves_with_the_force(
        seed in 1_u64..1_000_000, rate_hz in 50.0..500.0_f64, hz in 0.02..0.5_f64, error_n in 0.025..0.043_f64,
    ) {
        let (coverage, mean_n, _) =
            run(seed, rate_hz, 0.005, |t_s| error_n * (0.6 + 0.4 * (std::f64::consts::TAU * hz * t_s).sin()));
        prop_assert!(coverage >= 0.85, "{}", coverage);
        prop_assert!(mean_n < 1.5 * error_n, "{}", mean_n);
    }

    #[test]
    fn noise_alone_raises_no_alarm_and_widens_by_less_than_itself(
        seed in 1_u64..1_000_000, rate_hz in 20.0..500.0_f64, sigma in 0.001..0.01_f64,
    ) {
        let (coverage, mean_n, alarm_s) = run(seed, rate_hz, sigma, |_| 0.0);
        prop_assert_eq!((coverage, alarm_s), (1.0, None));
        prop_assert!(mean_n < HALFWIDTH_N + 0.6 * sigma, "{} of {}", mean_n, sigma);
    }
}
