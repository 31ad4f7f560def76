//! Blocks of memory against closed forms, other cuts of the same trace, and other pasts.

use proptest::prelude::*;
use rom::halfwidths::HalfWidths;
use rom::inputs::Inputs;
use rom::memory::{
    Advance, Creep, InputMemory, Line, Memory, MemorySpec, Orifice, Play, PronyTerm, Slopes, filter,
};

const RANGE: [f64; 2] = [0.0, 0.1];

fn spec(line: Option<Line>, play: &[Play], creep: &[Creep]) -> MemorySpec {
    let slopes = Slopes { displacement_mm: 800.0, stress_mpa: 0.0, force_n: 10.0 };
    let (play, creep) = (play.into(), creep.into());
    let of = InputMemory { input: 0, range: RANGE, line, orifice: None, play, creep, slopes };
    MemorySpec { inputs: vec![of], max_gap_s: 1.0 }
}

fn memory(line: Option<Line>, play: &[Play], creep: &[Creep]) -> Memory {
    Memory::new(spec(line, play, creep)).expect("valid")
}

fn all_blocks() -> Memory {
    let plays = [Play { threshold: 0.004, weight: 0.2 }, Play { threshold: 0.01, weight: 0.3 }];
    memory(
        Some(Line { fill_s: 0.3, empty_s: 1.5 }),
        &plays,
        &[Creep { time_s: 6.0, weight: 0.05 }, Creep { time_s: 0.8, weight: 0.1 }],
    )
}

fn inputs(pressure_mpa: f64) -> Inputs {
    Inputs::new(pressure_mpa, f64::INFINITY)
}

/// Output at the last of these (time in s, input).
fn output(memory: &mut Memory, readings: impl IntoIterator<Item = (f64, f64)>) -> f64 {
    for (t_s, input) in readings {
        memory.advance((t_s * 1e9).round() as u64, &inputs(input));
    }
    memory.effective(&inputs(f64::NAN)).pressure_mpa()
}

#[test]
fn line_follows_ramps_with_the_closed_form_and_turns_where_the_input_crosses_it() {
    let line = Line { fill_s: 0.5, empty_s: 2.0 };
    // Filling along a ramp from equilibrium: u - m tau (1 - e^(-t / tau)).
    let slope = 0.05;
    let rising = |t: f64| slope * t - slope * 0.5 * (1.0 - (-t / 0.5).exp());
    let mut one = memory(Some(line), &[], &[]);
    assert!((output(&mut one, [(1.0, 0.0), (1.8, slope * 0.8)]) - rising(0.8)).abs() < 1e-15);
    // Emptying along a fall to 0 in 0.2 s: first the input is above the output, then below; one step or a thousand.
    let input = |t: f64| 0.04 * (1.0 - t / 0.2);
    let mut cut = one.clone();
    let direct = output(&mut one, [(2.0, 0.0)]);
    let fine = output(&mut cut, (1..=1000).map(|k| 2e-4 * f64::from(k)).map(|t| (1.8 + t, input(t))));
    assert!((direct - fine).abs() < 1e-13, "{direct} {fine}");
    let crossed_s = 0.5 * ((rising(0.8) - 0.04) / (-0.2 * 0.5)).ln_1p();
    let expected = 0.2 * 2.0 * (1.0 - (-(0.2 - crossed_s) / 2.0).exp());
    assert!((direct - expected).abs() < 1e-13, "{direct} {expected}");
}

#[test]
fn play_depends_on_turning_points_alone() {
    let plays = [Play { threshold: 0.01, weight: 0.5 }];
    let turning = [0.0, 0.08, 0.02, 0.05];
    let mut slow = memory(None, &plays, &[]);
    let corners = (0_u32..).zip(turning).map(|(k, v)| (1.0 + 0.5 * f64::from(k), v));
    let expected = 0.5 * 0.05 + 0.5 * 0.04;
    assert!((output(&mut slow, corners) - expected).abs() < 1e-15);
    let mut fine = memory(None, &plays, &[]);
    let paths = turning.windows(2).enumerate().flat_map(|(at, pair)| {
        let (from, to) = (pair[0], pair[1]);
        (0..=50_u32)
            .map(move |k| (1.0 + at as f64 + f64::from(k) / 51.0, from + (to - from) * f64::from(k) / 50.0))
    });
    assert!((output(&mut fine, paths) - expected).abs() < 1e-15);
}

#[test]
fn creep_after_a_jump_follows_the_closed_form() {
    let mut jumped = memory(None, &[], &[Creep { time_s: 4.0, weight: 0.2 }]);
    let held = output(&mut jumped, [(1.0, 0.0), (1.000_000_001, 0.05), (1.9, 0.05), (2.8, 0.05)]);
    assert!((held - 0.05 * (1.0 - 0.2 * (-1.8_f64 / 4.0).exp())).abs() < 1e-10);
}

#[test]
fn orifice_fills_linearly_while_choked_and_exponentially_at_the_end() {
    let orifice = Orifice { time_s: 0.5, critical_ratio: 0.4 };
    let mut spec = spec(None, &[], &[]);
    (spec.inputs[0].orifice, spec.max_gap_s) = (Some(orifice), 10.0);
    let mut memory = Memory::new(spec).expect("valid");
    let mut at = |t_s: f64, p: f64| {
        memory.advance((t_s * 1e9) as u64, &inputs(p));
        memory.effective(&inputs(p)).pressure_mpa()
    };
    at(0.0, 0.0);
    // The pressure jumps to 0.4 MPa within 1 ns; ratios up to 0.4 until the cavity has 0.4 (0.4 + p_atm) - p_atm.
    at(1e-9, 0.4);
    let choked_s = 0.5 * (0.4 - 0.101_325 / 0.501_325);
    for k in 1..=10 {
        let t_s = choked_s * f64::from(k) / 10.0;
        let exact = 0.501_325 * t_s / 0.5;
        assert!((at(t_s + 1e-9, 0.4) - exact).abs() < 1e-4, "{k}");
    }
    // From 99 % on the difference decays with 0.01 T / psi(0.99).
    let lag_s = 0.01 * 0.5 / (1.0 - (0.59_f64 / 0.6).powi(2)).sqrt();
    let left: Vec<f64> = (0..400).map(|k| 0.4 - at(choked_s + 2e-9 + 0.002 * f64::from(k), 0.4)).collect();
    let late: Vec<&[f64]> = left.windows(2).filter(|w| w[0] < 0.004 && w[1] > 1e-6).collect();
    assert!(late.len() > 20);
    for pair in late {
        assert!((pair[1] / pair[0] - (-0.002 / lag_s).exp()).abs() < 1e-6, "{pair:?}");
    }
}

#[test]
fn prony_filter_is_creep_with_the_poles_of_the_series() {
    // One term: after a jump of 1, 1 - g e^(-t / T) with g = r / (1 + r), T = (1 + r) tau.
    let terms = [PronyTerm { ratio: 0.25, time_s: 0.05 }, PronyTerm { ratio: 0.5, time_s: 2.0 }];
    let one = filter(&terms[..1]).expect("valid");
    assert!((one[0].weight - 0.2).abs() < 1e-12 && (one[0].time_s - 0.0625).abs() < 1e-12, "{one:?}");
    // Two: 1 - sum w = 1 / (1 + sum r), and P = P^ + sum r h for a ramp of P^ of the filter, far from the start.
    let two = filter(&terms).expect("valid");
    let late: f64 = two.iter().map(|creep| creep.weight).sum();
    assert!((1.0 - late - 1.0 / 1.75).abs() < 1e-12, "{two:?}");
    let delay: f64 = two.iter().map(|creep| creep.weight * creep.time_s).sum();
    assert!((delay - (0.25 * 0.05 + 0.5 * 2.0)).abs() < 1e-9, "{two:?}");
    assert!(filter(&[PronyTerm { ratio: 0.2, time_s: -1.0 }]).is_err());
    assert!(filter(&[terms[0]; 5]).is_err());
}

#[test]
fn readings_without_use_leave_the_memory_unchanged_and_name_their_outcome() {
    let mut memory = all_blocks();
    let mut at = |t_ms: u64, input: f64| memory.advance(t_ms * 1_000_000, &inputs(input));
    assert_eq!(at(1000, 0.02), Advance::Started);
    assert_eq!(at(1100, 0.04), Advance::Advanced);
    assert_eq!(at(1100, 0.09), Advance::Late, "repeated stamp");
    assert_eq!(at(1050, 0.09), Advance::Late, "reordered");
    assert_eq!(at(1150, f64::NAN), Advance::NotFinite);
    assert_eq!(at(1150, f64::INFINITY), Advance::NotFinite);
    assert_eq!(at(1200, 0.05), Advance::Advanced);
    let mut without = all_blocks();
    let plain = output(&mut without, [(1.0, 0.02), (1.1, 0.04), (1.2, 0.05)]);
    assert_eq!(memory.effective(&inputs(0.0)).pressure_mpa().to_bits(), plain.to_bits());
    let before = memory.spread()[0];
    let own = HalfWidths { coverage: 0.9, displacement_mm: 3.0, stress_mpa: f64::NAN, force_n: 0.0 };
    let widened = own.with(&memory.half_widths());
    assert!((widened.displacement_mm - 3.0_f64.hypot(800.0 * before)).abs() < 1e-12, "{widened:?}");
    assert!((widened.force_n - 10.0 * before).abs() < 1e-12 && widened.stress_mpa.is_nan(), "{widened:?}");
    assert_eq!(memory.advance(60_000_000_000, &inputs(0.03)), Advance::Gap);
    assert!(memory.spread()[0] > 0.001 && before > 0.001);
    memory.restart();
    assert_eq!(memory.advance(5, &inputs(0.03)), Advance::Started);
}

#[test]
fn blocks_that_are_not_valid_are_refused() {
    let refused = |spec: MemorySpec| Memory::new(spec).is_err();
    assert!(refused(spec(Some(Line { fill_s: 0.0, empty_s: 1.0 }), &[], &[])));
    assert!(refused(spec(Some(Line { fill_s: 1.0, empty_s: f64::NAN }), &[], &[])));
    assert!(refused(spec(None, &[Play { threshold: 0.01, weight: 0.6 }; 2], &[])));
    assert!(refused(spec(None, &[Play { threshold: -0.01, weight: 0.1 }], &[])));
    assert!(refused(spec(None, &[Play { threshold: 0.01, weight: 0.1 }; 7], &[])));
    assert!(refused(spec(None, &[], &[Creep { time_s: -1.0, weight: 0.1 }])));
    assert!(refused(spec(None, &[], &[Creep { time_s: 1.0, weight: -0.1 }])));
    assert!(refused(MemorySpec { inputs: vec![], max_gap_s: 1.0 }));
    let mut twice = spec(Some(Line { fill_s: 1.0, empty_s: 1.0 }), &[], &[]);
    twice.inputs.push(twice.inputs[0].clone());
    assert!(refused(twice.clone()));
    twice.inputs[1].input = 8;
    assert!(refused(twice));
}

#[test]
fn responses_of_a_run_are_those_of_its_readings() {
    let mut memory = all_blocks();
    memory.hold_never();
    let t_s: Vec<f64> = (0..200_u32).map(|k| 0.02 * f64::from(k) + if k > 120 { 5.0 } else { 0.0 }).collect();
    let values: Vec<f64> = t_s.iter().map(|t| 0.05 + 0.04 * (3.0 * t).sin()).collect();
    let responses = memory.spec().inputs[0].responses(&t_s, &values);
    let stepped: Vec<f64> =
        t_s.iter().zip(&values).map(|(t, v)| output(&mut memory, [(1.0 + t, *v)])).collect();
    let most = responses.iter().zip(&stepped).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(most < 1e-10, "{most}");
}

/// A trace of sweeps, steps of 20 ms and rests.
fn trace(phase: f64, t_s: f64) -> f64 {
    let step = |at: f64| ((t_s - at) / 0.02).clamp(0.0, 1.0);
    let sweep = 0.02 * (std::f64::consts::TAU * (0.4 + 0.1 * t_s) * t_s + phase).sin();
    0.04 + sweep + 0.025 * (step(3.0) - step(6.0))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(8))]

    #[test]
    fn results_do_not_depend_on_how_readings_were_cut(phase in 0.0..6.0_f64, jitter in prop::collection::vec(-0.4..0.4_f64, 1000)) {
        let at = |k: u32, hz: f64| 1.0 + f64::from(k) / hz;
        let mut cuts = [(); 3].map(|()| all_blocks());
        for k in 0..=10_u32 {
            // Common instants every second: 100 Hz, 1 kHz, 100 Hz with jitter.
            let start = k.saturating_sub(1);
            let reading = |t: f64| (t, trace(phase, t));
            let slow = output(&mut cuts[0], (100 * start..=100 * k).map(|i| reading(at(i, 100.0))));
            let fast = output(&mut cuts[1], (1000 * start..=1000 * k).map(|i| reading(at(i, 1000.0))));
            let uneven = (100 * start..=100 * k).map(|i| {
                let off = if i % 100 == 0 { 0.0 } else { jitter[i as usize % 1000] / 100.0 };
                reading(at(i, 100.0) + off)
            });
            let uneven = output(&mut cuts[2], uneven);
            prop_assert!((slow - fast).abs() < 1e-3 * 0.065, "{slow} {fast}");
            prop_assert!((uneven - fast).abs() < 1e-3 * 0.065, "{uneven} {fast}");
        }
    }

    #[test]
    fn any_past_lies_within_the_spread_and_fades(past in prop::collection::vec((0.001..2.0_f64, 0.0..0.1_f64), 12), phase in 0.0..6.0_f64) {
        let mut knowing = all_blocks();
        let mut t_s = 0.0;
        let past: Vec<(f64, f64)> = past.into_iter().map(|(dt, v)| { t_s += dt.min(0.9); (t_s, v) }).collect();
        output(&mut knowing, past);
        let mut restarted = all_blocks();
        let mut spreads = Vec::new();
        for k in 1..=4000_u32 {
            let now = t_s + 0.01 * f64::from(k);
            let input = 0.05 + 0.045 * (now + phase).sin();
            let truth = output(&mut knowing, [(now, input)]);
            let nominal = output(&mut restarted, [(now, input)]);
            // The first reading of the restarted one does not know where the input comes from.
            let spread = restarted.spread()[0];
            prop_assert!((truth - nominal).abs() <= spread + 1e-12, "{k}: {truth}, {nominal} +- {spread}");
            spreads.push(spread);
        }
        prop_assert!(spreads[0] > 0.01 && spreads[3999] < 2e-4, "{} {}", spreads[0], spreads[3999]);
    }
}
