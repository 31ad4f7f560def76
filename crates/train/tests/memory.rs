//! Memory identified from synthetic runs whose truth is known.

use rom::memory::{Creep, InputMemory, Line, Orifice, Play, Slopes};
use train::measured::Run;
use train::memory::{Block, Identified, identify, shortest_crossing_s};

/// Deterministic noise of unit variance, roughly normal.
fn noise(seed: u64, count: usize) -> Vec<f64> {
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    let mut uniform = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
    };
    (0..count).map(|_| (0..12).map(|_| uniform()).sum()).collect()
}

/// Pressure of steps of 0.3 s and ramps, MPa.
fn pressure(t_s: f64, shift: f64) -> f64 {
    let level = |k: i64| 0.045 + 0.04 * ((k as f64 * 2.4 + shift).sin());
    let k = (t_s / 3.0).floor();
    let share = ((t_s - 3.0 * k) / 0.3).min(1.0);
    level(k as i64 - 1) + share * (level(k as i64) - level(k as i64 - 1))
}

fn run(of: &InputMemory, shift: f64, sigma: f64) -> Run {
    let t_s: Vec<f64> =
        (0..800_u32).map(|k| 0.05 * f64::from(k) + 0.01 * (f64::from(k) * 1.7).sin()).collect();
    let values: Vec<f64> = t_s.iter().map(|t| pressure(*t, shift)).collect();
    let behind = of.responses(&t_s, &values);
    let noise = noise(7 + (shift * 10.0) as u64, values.len());
    let y = behind.iter().zip(&noise).map(|(p, e)| 900.0 * p + 4000.0 * p * p + sigma * e).collect();
    Run { time_s: t_s, inputs: vec![values], outputs: vec![y] }
}

fn block(line: Option<Line>, play: Vec<Play>, creep: Vec<Creep>) -> InputMemory {
    let slopes = Slopes::default();
    InputMemory { input: 0, range: [0.0, 0.09], line, orifice: None, play, creep, slopes }
}

fn found(of: &InputMemory, sigma: f64) -> Identified {
    identify(&[run(of, 0.0, sigma)], true, &[100.0], None).expect("a fit")
}

fn kept(found: &Identified) -> Vec<Block> {
    let kept: Vec<Block> = found.blocks.iter().filter(|b| b.is_kept).map(|b| b.block).collect();
    Block::ALL.into_iter().filter(|block| kept.contains(block)).collect()
}

#[test]
fn line_is_found_with_its_time_constants_within_the_intervals() {
    let of = block(Some(Line { fill_s: 0.4, empty_s: 1.3 }), vec![], vec![]);
    let found = found(&of, 0.5);
    assert_eq!(kept(&found), [Block::Line], "{found:?}");
    let constants = &found.blocks.iter().find(|b| b.block == Block::Line).expect("line").constants;
    for (constant, truth) in constants.iter().zip([0.4, 1.3]) {
        assert!((constant.value / truth - 1.0).abs() < 0.05, "{constant:?}");
        let [low, high] = constant.interval;
        assert!(low <= truth * 1.02 && truth <= high * 1.02 && high < 1.5 * low, "{constant:?}");
    }
    assert!(found.left_out[1] < 0.2 * found.left_out[0], "{:?}", found.left_out);
}

#[test]
fn orifice_is_found_where_the_flow_is_that_of_iso_6358() {
    let orifice = Some(Orifice { time_s: 2.0, critical_ratio: 0.3 });
    let of = InputMemory { orifice, ..block(None, vec![], vec![]) };
    let found = found(&of, 0.2);
    assert_eq!(kept(&found), [Block::Orifice], "{found:?}");
    let constants = &found.blocks.iter().find(|b| b.block == Block::Orifice).expect("orifice").constants;
    let [low, high] = constants[0].interval;
    assert!((low..high).contains(&2.0) && high < 1.5 * low, "{constants:?}");
}

#[test]
fn play_is_found_where_loops_do_not_depend_on_time() {
    let plays = (1..=4).map(|k| Play { threshold: 0.002 * f64::from(k), weight: 0.15 }).collect();
    let found = found(&block(None, plays, vec![]), 0.2);
    assert_eq!(kept(&found), [Block::Play], "{found:?}");
    assert!(found.left_out[1] < 0.4 * found.left_out[0], "{:?}", found.left_out);
}

#[test]
fn single_play_is_told_from_a_graded_one() {
    let found = found(&block(None, vec![Play { threshold: 0.00225, weight: 1.0 }], vec![]), 0.2);
    assert_eq!(kept(&found), [Block::SinglePlay], "{found:?}");
    let constants = &found.blocks.iter().find(|b| b.block == Block::SinglePlay).expect("play").constants;
    assert!((constants[0].value * 0.08 / 0.00225 - 1.0).abs() < 0.1, "{constants:?}");
}

#[test]
fn single_play_is_found_behind_a_line() {
    let line = Line { fill_s: 0.3, empty_s: 0.9 };
    let found = found(&block(Some(line), vec![Play { threshold: 0.00225, weight: 1.0 }], vec![]), 0.2);
    assert_eq!(kept(&found), [Block::Line, Block::SinglePlay], "{found:?}");
    let of = |block: Block| &found.blocks.iter().find(|b| b.block == block).expect("a block").constants;
    for (constant, truth) in of(Block::Line).iter().zip([0.3, 0.9]) {
        assert!((constant.value / truth - 1.0).abs() < 0.05, "{constant:?}");
    }
    assert!((of(Block::SinglePlay)[0].value * 0.08 / 0.00225 - 1.0).abs() < 0.15, "{found:?}");
}

#[test]
fn creep_is_found_beside_a_line() {
    let of =
        block(Some(Line { fill_s: 0.3, empty_s: 0.6 }), vec![], vec![Creep { time_s: 5.0, weight: 0.15 }]);
    let found = found(&of, 0.1);
    assert_eq!(kept(&found), [Block::Line, Block::Creep], "{found:?}");
    let creep = &found.blocks.iter().find(|b| b.block == Block::Creep).expect("creep").constants;
    assert!((creep[0].value / 5.0 - 1.0).abs() < 0.3 && (creep[1].value - 0.15).abs() < 0.05, "{creep:?}");
}

#[test]
fn static_actuator_gets_no_memory_at_any_noise() {
    for sigma in [0.1, 5.0] {
        let found = found(&block(None, vec![], vec![]), sigma);
        assert!(found.memory.is_none(), "{found:?}");
    }
}

#[test]
fn runs_without_use_have_no_result() {
    let still = Run { time_s: vec![0.0, 1.0, 2.0], inputs: vec![vec![0.1; 3]], outputs: vec![vec![1.0; 3]] };
    assert!(identify(&[still], true, &[1.0], None).is_none());
    assert!(identify(&[], true, &[1.0], None).is_none());
    // Too little of anything is no panic.
    for rows in 0..12 {
        let time_s = (0..rows).map(f64::from).collect();
        let values: Vec<f64> = (0..rows).map(|row| 0.01 * f64::from(row % 5)).collect();
        let short = Run { time_s, inputs: vec![values.clone()], outputs: vec![values] };
        let _ = identify(std::slice::from_ref(&short), true, &[1.0], None);
        assert!(identify(&[Run { outputs: Vec::new(), ..short }], true, &[], None).is_none());
    }
}

#[test]
fn second_lag_is_found_behind_a_line() {
    let line = Line { fill_s: 0.5, empty_s: 0.8 };
    let found = found(&block(Some(line), vec![], vec![Creep { time_s: 0.3, weight: 1.0 }]), 0.1);
    assert_eq!(kept(&found), [Block::Line, Block::SecondLag], "{found:?}");
    assert!(found.left_out[1] < 0.05 * found.left_out[0], "{:?}", found.left_out);
}

#[test]
fn drift_of_a_run_is_no_memory() {
    let mut run = run(&block(Some(Line { fill_s: 0.4, empty_s: 1.3 }), vec![], vec![]), 0.0, 0.2);
    run.outputs[0].iter_mut().zip(&run.time_s).for_each(|(y, t)| *y += 0.2 * t);
    let found = identify(&[run], true, &[100.0], None).unwrap();
    assert_eq!(kept(&found), [Block::Line], "{found:?}");
    let constants = &found.blocks.iter().find(|b| b.block == Block::Line).expect("line").constants;
    assert!((constants[0].value / 0.4 - 1.0).abs() < 0.05, "{constants:?}");
}

#[test]
fn shortest_crossing_is_found_behind_slower_ones_and_pauses() {
    let s = |points: &[(f64, f64)]| {
        let (times, values): (Vec<f64>, Vec<f64>) = points.iter().copied().unzip();
        shortest_crossing_s(&times, &values, 1.0)
    };
    // Down by 0.5 within the rise, then up at once.
    assert!((s(&[(0.0, 0.0), (4.0, 0.6), (4.001, 0.1), (4.01, 1.1)]) - 0.009).abs() < 1e-12);
    // A slow rise, a rest, and a jump within 0.01 s.
    assert!((s(&[(0.0, 0.0), (2.0, 0.5), (4.0, 0.4), (4.01, 1.5)]) - 0.01).abs() < 1e-12);
    assert!((s(&[(0.0, 2.0), (3.0, 1.6), (5.0, 1.7), (5.5, 0.6)]) - 0.5).abs() < 1e-12);
    assert_eq!(s(&[(0.0, 0.0), (1.0, 0.9), (2.0, 0.3)]), f64::INFINITY);
}
