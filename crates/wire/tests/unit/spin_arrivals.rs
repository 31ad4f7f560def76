//! The rhythm of arrivals: what is predicted, and what is not.

use super::*;

const MS: u64 = 1_000_000;
const START: u64 = 5_000_000 * MS;

/// Predictions made before each arrival, and what the rhythm is after the last.
fn predictions(times: impl IntoIterator<Item = u64>) -> (Vec<Option<u64>>, Arrivals) {
    let mut arrivals = Arrivals::default();
    let mut predicted = Vec::new();
    for time in times {
        predicted.push(arrivals.next_ns());
        arrivals.arrived(time);
    }
    (predicted, arrivals)
}

/// Numbers in 0..1 that look like chance and are the same in every run.
fn chance(seed: u64) -> impl Iterator<Item = f64> {
    let mut state = seed;
    std::iter::repeat_with(move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64
    })
}

fn grid(count: u64) -> impl Iterator<Item = u64> {
    (0..count).map(|k| START + k * MS)
}

#[test]
fn an_exact_rhythm_is_predicted_exactly_from_the_eighth_arrival_on() {
    let (predicted, arrivals) = predictions(grid(100));
    assert!(predicted[..8].iter().all(Option::is_none));
    for (k, next) in predicted.iter().enumerate().skip(8) {
        assert!(next.unwrap().abs_diff(START + k as u64 * MS) <= 20, "{k}: {next:?}");
    }
    assert!(arrivals.jitter_ns() < 50.0 && (arrivals.period_ns() - 1e6).abs() < 10.0);
}

/// Sender on a grid, each arrival up to 100 us later: the prediction is better than the last arrival plus a period.
#[test]
fn jitter_is_averaged_and_measured() {
    let late: Vec<u64> = chance(7).take(2000).map(|c| (c * 100_000.0) as u64).collect();
    let times: Vec<u64> = grid(2000).zip(&late).map(|(time, late)| time + late).collect();
    let (predicted, arrivals) = predictions(times.iter().copied());
    let errors = |from: &dyn Fn(usize) -> Option<u64>| -> f64 {
        let all: Vec<f64> = (100..2000).filter_map(|k| Some(from(k)?.abs_diff(times[k]) as f64)).collect();
        assert!(all.len() > 1880, "{}", all.len());
        all.iter().sum::<f64>() / all.len() as f64
    };
    let (ours, last) = (errors(&|k| predicted[k]), errors(&|k| Some(times[k - 1] + MS)));
    assert!(ours < 0.95 * last && ours < 32_000.0, "{ours} {last}");
    assert!((15_000.0..45_000.0).contains(&arrivals.jitter_ns()), "{}", arrivals.jitter_ns());
}

/// A source that waits a period after each of its readings: its deviations add up.
#[test]
fn a_drifting_rhythm_is_followed() {
    let mut time = START as f64;
    let times: Vec<u64> = chance(3)
        .take(3000)
        .enumerate()
        .map(|(k, c)| {
            time += 1e6 + 20_000.0 * c + k as f64 * 10.0;
            time as u64
        })
        .collect();
    let (predicted, _) = predictions(times.iter().copied());
    let beyond = (100..3000).filter(|k| predicted[*k].is_none_or(|next| next.abs_diff(times[*k]) > 60_000));
    assert!(beyond.count() < 10);
}

#[test]
fn a_gap_keeps_the_period_and_is_relied_on_again_soon() {
    let times: Vec<u64> = grid(60).filter(|time| !(30..34).contains(&((time - START) / MS))).collect();
    let (predicted, _) = predictions(times.iter().copied());
    let silent: Vec<usize> = (8..times.len()).filter(|k| predicted[*k].is_none()).collect();
    assert_eq!(silent, [31, 32, 33], "the arrivals right after the gap");
    assert!(predicted[40].unwrap().abs_diff(times[40]) <= 20);
}

#[test]
fn a_stop_and_another_rate_begin_anew() {
    let later = START + 10_000 * MS;
    for period_ns in [MS / 10, MS, 3 * MS] {
        let times: Vec<u64> = grid(50).chain((0..50).map(|k| later + k * period_ns)).collect();
        let (predicted, arrivals) = predictions(times.iter().copied());
        assert!(predicted[51..56].iter().all(Option::is_none), "{predicted:?}");
        assert!(predicted[75].unwrap().abs_diff(times[75]) <= 20, "{period_ns}");
        assert!((arrivals.period_ns() - period_ns as f64).abs() < 10.0, "{period_ns}");
    }
}

#[test]
fn another_rate_without_a_stop_is_learned() {
    for period_ns in [MS / 10, MS / 2, MS * 2, MS * 10] {
        let change = START + 50 * MS;
        let times: Vec<u64> = grid(50).chain((0..80).map(|k| change + k * period_ns)).collect();
        let (predicted, _) = predictions(times.iter().copied());
        assert!(predicted[100].unwrap().abs_diff(times[100]) <= 50, "{period_ns}");
    }
}

#[test]
fn one_late_arrival_moves_nothing() {
    let times: Vec<u64> =
        grid(60).map(|time| time + if time == START + 40 * MS { 400_000 } else { 0 }).collect();
    let (predicted, _) = predictions(times.iter().copied());
    for k in 41..60 {
        assert!(predicted[k].unwrap().abs_diff(times[k]) <= 20, "{k}: {:?}", predicted[k]);
    }
}

#[test]
fn samples_that_waited_together_count_as_one_arrival() {
    let bursts = grid(60).flat_map(|time| (0..5).map(move |n| time + n * 2_000));
    let (_, arrivals) = predictions(bursts);
    assert!((arrivals.period_ns() - 1e6).abs() < 10.0);
    assert!(arrivals.next_ns().unwrap().abs_diff(START + 60 * MS) <= 20);
}

#[test]
fn a_rhythm_that_begins_with_a_lost_reading_has_the_right_period() {
    for lost in [1, 2] {
        let times: Vec<u64> =
            grid(40).enumerate().filter(|(k, _)| *k != lost).map(|(_, time)| time).collect();
        let (predicted, arrivals) = predictions(times.iter().copied());
        assert!((arrivals.period_ns() - 1e6).abs() < 10.0, "{lost}");
        assert!(predicted[38].unwrap().abs_diff(times[38]) <= 20, "{lost}");
    }
}
