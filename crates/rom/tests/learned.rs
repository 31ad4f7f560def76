//! Learned maps: lags and neurons over time, answers and half-widths, following.

use rom::halfwidths::HALFWIDTH_SIGMAS;
use rom::inputs::{Inputs, PARAMETERS};
use rom::learned::{
    Drift, KernelMap, Kernels, Lag, LearnedMap, LearnedState, LinearMap, MapInput, OffsetFilter, OutputWidth,
    Polynomial, Reservoir, Support,
};
use rom::memory::Line;

const STEP_NS: u64 = 10_000_000;

/// One input, a lag of 0.2 s filling and 0.4 s emptying, two neurons, and one output.
fn map() -> LearnedMap {
    LearnedMap {
        inputs: vec![MapInput { input: PARAMETERS as u32, mean: 0.0, deviation: 1.0, range: 2.0 }],
        step_ns: STEP_NS,
        max_gap_s: 1.0,
        lags: vec![
            Lag { input: 0, line: None },
            Lag { input: 0, line: Some(Line { fill_s: 0.2, empty_s: 0.4 }) },
        ],
        base: LinearMap { lags: vec![1], weights: vec![1.0, 2.0] },
        polynomials: vec![Polynomial {
            share: 0.5,
            lags: vec![0, 1],
            degree: 3,
            weights: (1..=8).map(f64::from).collect(),
        }],
        kernels: vec![Kernels {
            lags: vec![1],
            centres: vec![0.0],
            maps: vec![KernelMap { share: 0.25, radius: 2.0, weights: vec![0.0, 0.0, 8.0] }],
        }],
        reservoirs: vec![Reservoir {
            share: 0.25,
            times_s: vec![0.1, 0.3],
            drive: vec![0.0, 1.0, 0.1, -0.5],
            starts: vec![0, 1, 2],
            sources: vec![1, 0],
            strengths: vec![0.3, 0.4],
            weights: vec![0.0, 0.0, 4.0, 8.0],
        }],
        support: Support { lags: vec![0], rows: vec![-1.0, 0.0, 1.0], reach: 0.6, extent: 2.0 },
        widths: vec![OutputWidth {
            noise: 0.04,
            range: 10.0,
            growth: 1.0,
            base: 0.5,
            past: 3.0,
            ..OutputWidth::default()
        }],
        drifts: vec![Drift { start: 1.0, per_s: 0.0, noise_s: 0.5 }],
        markers: Vec::new(),
    }
}

fn inputs(value: f64) -> Inputs {
    Inputs::new(0.0, f64::INFINITY).with(PARAMETERS, value)
}

fn follow(map: &LearnedMap, trace: impl Iterator<Item = (u64, f64)>) -> LearnedState {
    let mut past = map.initial_state();
    trace.for_each(|(t_ns, value)| {
        past.advance(map, t_ns, &inputs(value), f64::INFINITY);
    });
    past
}

#[test]
fn lag_of_a_ramp_is_its_closed_form() {
    let map = map();
    assert_eq!(map.check(3, 1), Ok(()));
    let past = follow(&map, [(0, 0.0), (700_000_000, 0.7)].into_iter());
    let exact = 0.7 - 0.2 * (1.0 - f64::exp(-0.7 / 0.2));
    assert!((past.lags()[1] - exact).abs() < 1e-12 && past.lags()[0] == 0.7, "{:?}", past.lags());
    let past = follow(&map, [(0, 0.0), (700_000_000, -0.7)].into_iter());
    let exact = 0.4 * (1.0 - f64::exp(-0.7 / 0.4)) - 0.7;
    assert!((past.lags()[1] - exact).abs() < 1e-12, "{:?}", past.lags());
}

#[test]
fn state_does_not_depend_on_how_readings_were_cut() {
    let map = map();
    let trace = |step_ns: u64| {
        follow(&map, (0..=600_000_000 / step_ns).map(move |k| (k * step_ns, 1e-9 * (k * step_ns) as f64)))
    };
    let [coarse, fine] = [trace(60_000_000), trace(1_500_000)];
    let off = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(off(coarse.neurons(), fine.neurons()) < 1e-9, "{:?} {:?}", coarse.neurons(), fine.neurons());
    assert!(off(coarse.lags(), fine.lags()) < 1e-9);
    // Between two steps of the neurons as well: 7 ms after the last.
    let between = follow(&map, (0..=67).map(|k| (k * 1_000_000, 1e-3 * k as f64)));
    let at_once = follow(&map, [(0, 0.0), (67_000_000, 0.067)].into_iter());
    assert!(off(between.neurons(), at_once.neurons()) < 1e-9);
}

#[test]
fn neurons_settle_and_a_settled_state_stays() {
    let map = map();
    let past = follow(&map, (0..500).map(|k| (k * 20_000_000, 0.4)));
    let [a, b] = [past.neurons()[0], past.neurons()[1]];
    assert!((a - (0.4 + 0.3 * b).tanh()).abs() < 1e-9 && (b - (0.1 - 0.2 + 0.4 * a).tanh()).abs() < 1e-9);
    let mut settled = map.initial_state();
    settled.settle(&map, &inputs(0.4));
    assert!((settled.neurons()[0] - a).abs() < 1e-9);
}

#[test]
fn following_takes_over_a_constant_offset_and_leaves_out_what_was_not_measured() {
    let mut following = OffsetFilter::new(&map());
    let square = |of: &OffsetFilter, t_ns: u64| of.squared_half_width(0, t_ns, 1.0);
    assert!(
        (square(&following, 0) - (1.0 + HALFWIDTH_SIGMAS.powi(2))).abs() < 1e-12,
        "{}",
        square(&following, 0)
    );
    following.take(0, &[1.0]);
    assert_eq!(following.offset(0), 0.0, "one value of unknown duration");
    // A variance of 1 at first and of 0.5 / 0.5 s = 1 of a value: half of the error.
    following.take(500_000_000, &[1.0]);
    assert!((following.offset(0) - 0.5).abs() < 1e-12, "{}", following.offset(0));
    following.take(1_000_000_000, &[f64::NAN]);
    assert!((following.offset(0) - 0.5).abs() < 1e-12);
    (3..40).for_each(|k| following.take(500_000_000 * k, &[1.0]));
    assert!((following.offset(0) - 1.0).abs() < 0.05 && square(&following, 20_000_000_000) < 1.2);
    // Errors that the training does not explain: the half-width contains them.
    (40..400).for_each(|k| following.take(500_000_000 * k, &[if k % 2 == 0 { 6.0 } else { -6.0 }]));
    assert!(following.offset(0).abs() < 2.0 && square(&following, 200_000_000_000) > 30.0 * HALFWIDTH_SIGMAS);
    // What was not measured, or not later than the last value, changes nothing.
    let before = format!("{following:?}");
    for (t_ns, error) in [(400, f64::NAN), (400, f64::INFINITY), (399, 1.0), (1, 1.0)] {
        following.take(500_000_000 * t_ns, &[error]);
        assert_eq!(format!("{following:?}"), before, "{t_ns} {error}");
    }
    following.restart();
    assert_eq!(following.offset(0), 0.0);
}

/// A sensor that is read at every fifth instant tells of its output what it would tell alone.
#[test]
fn outputs_that_are_measured_at_their_own_instants_are_followed_as_if_alone() {
    let mut two = map();
    two.widths.push(two.widths[0]);
    two.drifts.push(Drift { start: 2.0, per_s: 0.1, noise_s: 0.5 });
    let (mut both, mut alone) = (OffsetFilter::new(&two), OffsetFilter::new(&two));
    for k in 0..200_u64 {
        let error = (0.1 * k as f64).sin();
        let slow = if k % 5 == 0 { error } else { f64::NAN };
        both.take(20_000_000 * k, &[error, slow]);
        if k % 5 == 0 {
            alone.take(20_000_000 * k, &[f64::NAN, slow]);
        }
        let bits = |filter: &OffsetFilter| {
            [filter.offset(1), filter.squared_half_width(1, 20_000_000 * k, 1.0)].map(f64::to_bits)
        };
        assert_eq!(bits(&both), bits(&alone), "{k}");
    }
    assert!(both.offset(1) != 0.0 && both.offset(0) != both.offset(1) && alone.offset(0) == 0.0);
}

#[test]
fn maps_whose_numbers_do_not_fit_are_refused() {
    let broken: [fn(&mut LearnedMap); 8] = [
        |map| map.inputs[0].input = 9,
        |map| map.step_ns = 0,
        |map| map.base.weights.clear(),
        |map| map.base.lags[0] = 2,
        |map| map.polynomials[0].degree = 2,
        |map| map.kernels[0].maps[0].weights.clear(),
        |map| map.reservoirs[0].sources[0] = 7,
        |map| map.support.rows.clear(),
    ];
    for (at, breaks) in broken.into_iter().enumerate() {
        let mut map = map();
        breaks(&mut map);
        assert!(map.check(3, 1).is_err(), "{at}");
    }
}
