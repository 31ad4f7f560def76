use super::*;

/// A line with play in nothing: delay, valve's rate, two lags, offset, and noise by a fixed sequence.
struct Truth {
    delay_s: f64,
    rate_mpa_per_s: f64,
    line: Line,
    gain: f64,
}

const TRUTH: Truth = Truth {
    delay_s: 0.05,
    rate_mpa_per_s: f64::INFINITY,
    line: Line { fill_s: 0.2, empty_s: 0.8 },
    gain: 1.0,
};
const NOISE_MPA: f64 = 1e-4;

/// Steps and a ramp, read every 5 ms and simulated every 0.1 ms.
fn rows(truth: &Truth) -> Vec<ActuationCycle> {
    let command = |t_s: f64| match t_s {
        t_s if t_s < 0.5 => 0.0,
        t_s if t_s < 36.0 => [0.02, 0.035, 0.02, 0.04, 0.055, 0.04, 0.06, 0.075, 0.06][(t_s / 4.0) as usize],
        t_s => 0.06 * (1.0 - (t_s - 36.0) / 10.0),
    };
    let (mut valve, mut cavity, mut seed) = (0.0, 0.0, 1_u64);
    let mut rows = Vec::new();
    let h = 1e-4;
    for step in 0..460_000_u32 {
        let t_s = f64::from(step) * h;
        if step % 50 == 0 {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            // Uniform noise of that standard deviation.
            let noise = NOISE_MPA * 12_f64.sqrt() * ((seed >> 11) as f64 / (1_u64 << 53) as f64 - 0.5);
            let gauge_mpa = 1.4e-3 + truth.gain * cavity + noise;
            rows.push(ActuationCycle {
                time_s: t_s,
                command_mpa: command(t_s),
                gauge_mpa,
                measured: f64::NAN,
            });
        }
        // The command of the last reading, a delay ago.
        let late = ((t_s - truth.delay_s).max(0.0) / 5e-3 + 1e-9).floor() * 5e-3;
        let most = truth.rate_mpa_per_s * h;
        valve += (command(late) - valve).clamp(-most, most);
        let tau_s = if valve >= cavity { truth.line.fill_s } else { truth.line.empty_s };
        cavity += (valve - cavity) * h / tau_s;
    }
    rows
}

fn contains(constant: ConstantInterval, truth: f64, slack: f64) -> bool {
    let [low, high] = constant.interval;
    (low - slack..=high + slack).contains(&truth)
}

/// Also beyond the first third of the scan, and with a leak or a wrong scale of the gauge.
#[test]
fn delay_and_times_are_found_within_their_intervals() {
    for (delay_s, gain) in [(0.0, 1.0), (0.03, 1.0), (0.09, 0.8), (0.12, 1.0), (0.27, 1.0)] {
        let found = line(&rows(&Truth { delay_s, gain, ..TRUTH })).unwrap();
        assert!((found.delay.value - delay_s).abs() < 3e-3, "{delay_s}: {:?}", found.delay);
        assert!(found.delay.interval[1] - found.delay.interval[0] < 0.01, "{:?}", found.delay);
        assert!(contains(found.delay, delay_s, 2e-3), "{delay_s}: {:?}", found.delay);
        assert!((found.line.fill_s / 0.2 - 1.0).abs() < 0.03, "{:?}", found.line);
        assert!((found.line.empty_s / 0.8 - 1.0).abs() < 0.03, "{:?}", found.line);
        assert!(found.valve_rate.is_none(), "{:?}", found.valve_rate);
        assert!(found.residual_mpa < 1.3 * NOISE_MPA, "{}", found.residual_mpa);
    }
}

#[test]
fn a_slow_valve_is_told_from_a_delay_and_a_lag() {
    let found = line(&rows(&Truth { rate_mpa_per_s: 0.12, ..TRUTH })).unwrap();
    let rate = found.valve_rate.unwrap();
    assert!((rate.value / 0.12 - 1.0).abs() < 0.03 && contains(rate, 0.12, 2e-3), "{rate:?}");
    assert!((found.delay.value - TRUTH.delay_s).abs() < 5e-3, "{:?}", found.delay);
    assert!((found.line.fill_s / 0.2 - 1.0).abs() < 0.05, "{:?}", found.line);
}

#[test]
fn a_gauge_that_does_not_follow_has_no_line() {
    let rows = rows(&TRUTH);
    let with = |gauge: &dyn Fn(&ActuationCycle) -> f64| -> Vec<ActuationCycle> {
        rows.iter().map(|row| ActuationCycle { gauge_mpa: gauge(row), ..*row }).collect()
    };
    assert!(line(&with(&|row| 1e-4 * (row.time_s * 7.0).sin())).is_none());
    assert!(line(&with(&|row| -row.gauge_mpa)).is_none());
    assert!(line(&with(&|_| f64::NAN)).is_none());
    assert!(line(&[]).is_none());
}
