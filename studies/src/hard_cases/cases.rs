//! The named hard cases.

use super::case::{HardCase, Probe, Query};
use super::ending::Ending;
use crate::synthetic::{State, database, force_n, snapshot, training_states};
use rom::snapshots::{Database, FieldKind, Split};
use train::config::{KernelKind, KernelSpec, Tail, TrainConfig};

/// Error that counts as correct where nothing but interpolation stands between data and answer.
const BOUND: f64 = 0.01;

/// All cases, in the order of the report.
pub fn hard_cases() -> Vec<HardCase> {
    let mut cases = vec![plain()];
    cases.extend([1e-3, 1e-6, 1e-9, 1e-12, 1e-15].map(near_duplicate));
    cases.extend([duplicate(0.0), duplicate(0.1)]);
    cases.extend([collinear(), clustered(), few(1), few(2), edge(), switch(), permuted(), other_units()]);
    cases.extend([
        constant(),
        rank_one(),
        rank_deficient(),
        many_decades(),
        subnormal(),
        tiny_stress(),
        noisy(),
    ]);
    cases.extend([0.01, 0.1, 1.0, 10.0, 100.0, 1000.0].map(gaussian));
    cases
}

/// The defaults, without the second leave-one-out that only reports.
fn config() -> TrainConfig {
    TrainConfig::default()
}

fn states() -> Vec<State> {
    training_states(9, 6, 5)
}

fn case(name: &str, hard: &str, database: Database, queries: Vec<Query>) -> HardCase {
    HardCase {
        name: name.into(),
        hard: hard.into(),
        database,
        config: config(),
        probe: Probe::Queries(queries),
        bound: BOUND,
        expected: Ending::Correct,
    }
}

fn query(pressure: f64, gap: f64) -> Query {
    let gap_or_none = gap.is_finite().then_some(gap);
    let force_n = gap_or_none.map_or(0.0, |g| force_n(pressure, g));
    Query { pressure, gap, truth: snapshot(pressure, gap_or_none), force_n }
}

/// States inside the training range, free and in contact, none of them trained on.
fn inside() -> Vec<Query> {
    [(0.03, f64::INFINITY), (0.071, f64::INFINITY), (0.062, 17.3), (0.047, 29.0), (0.033, 14.0), (0.08, 35.0)]
        .map(|(p, g)| query(p, g))
        .to_vec()
}

fn plain() -> HardCase {
    case("plain", "nothing: the yardstick of the others", database(&states()), inside())
}

/// A deterministic number in [-1, 1] for an index.
fn noise(i: usize) -> f64 {
    ((i as f64 * 12.9898).sin() * 43_758.547).fract()
}

fn perturb(database: &mut Database, case: usize, share: f64) {
    let entries = database.entries();
    for (i, v) in database.snapshots[case * entries..(case + 1) * entries].iter_mut().enumerate() {
        *v += (f64::from(*v) * share * noise(i)) as f32;
    }
}

fn near_duplicate(distance: f64) -> HardCase {
    let mut all = states();
    let (_, p, gap) = all[20];
    all.push((Split::Train, p + distance * 0.085, gap));
    let mut data = database(&all);
    let last = all.len() - 1;
    perturb(&mut data, last, 1e-5);
    let hard = "two samples this close (fraction of the range), their fields 1e-5 apart by solver tolerance";
    case(&format!("near-duplicate {distance:.0e}"), hard, data, inside())
}

fn duplicate(difference: f64) -> HardCase {
    let mut all = states();
    all.push(all[20]);
    let mut data = database(&all);
    let last = all.len() - 1;
    perturb(&mut data, last, difference);
    if difference == 0.0 {
        return case("duplicate, equal", "one sample twice", data, inside());
    }
    let hard = "one sample twice with fields that contradict each other by 10 %";
    HardCase { expected: Ending::Refused, ..case("duplicate, different", hard, data, inside()) }
}

fn collinear() -> HardCase {
    let line = |t: f64| (0.01 + 0.08 * t, 10.0 + 25.0 * t);
    let mut all = training_states(9, 0, 0);
    all.extend((0..15).map(|i| line(f64::from(i) / 14.0)).map(|(p, g)| (Split::Train, p, Some(g))));
    let queries = [0.23, 0.5, 0.81].map(line).map(|(p, g)| query(p, g)).to_vec();
    case(
        "collinear",
        "pressure and gap of all contact samples on one line; asked on the line",
        database(&all),
        queries,
    )
}

fn clustered() -> HardCase {
    let mut all = states();
    all.extend(
        (0..10).map(|i| (Split::Train, 0.04 + 4e-4 * f64::from(i), Some(15.0 + 0.1 * noise(i as usize)))),
    );
    case("clustered", "a third of the contact samples within 5 % of the range", database(&all), inside())
}

fn few(count: usize) -> HardCase {
    let all: Vec<State> = (0..count).map(|i| (Split::Train, 0.03 + 0.02 * i as f64, None)).collect();
    let queries = all.iter().map(|(_, p, _)| query(*p, f64::INFINITY)).collect();
    let hard = "nothing to interpolate between; asked at the samples";
    // Of one state nothing is known of the error: no tail is determined without it.
    let expected = if count == 1 { Ending::Refused } else { Ending::Correct };
    HardCase { expected, ..case(&format!("{count} sample(s)"), hard, database(&all), queries) }
}

fn edge() -> HardCase {
    let queries =
        [(0.09, f64::INFINITY), (0.09, 9.75), (0.1, 20.0), (0.095, 8.0), (0.12, 12.0), (0.1, f64::INFINITY)];
    let hard = "asked at a corner of the hull and up to 40 % of the range beyond";
    case("hull and beyond", hard, database(&states()), queries.map(|(p, g)| query(p, g)).to_vec())
}

fn switch() -> HardCase {
    let hard = "both sides of the onset at 101 gaps from the sag to the reach, both included";
    HardCase {
        probe: Probe::Switch,
        bound: 1e-3,
        ..case("onset", hard, database(&training_states(12, 8, 7)), Vec::new())
    }
}

fn permuted() -> HardCase {
    let ordered = states();
    let n = ordered.len();
    let shuffled: Vec<State> = (0..n).map(|i| ordered[(i * 16 + 5) % n]).collect();
    let probe = Probe::SameAs(Box::new(database(&ordered)));
    HardCase {
        probe,
        bound: 1e-4,
        ..case("permuted", "the same cases in another order", database(&shuffled), Vec::new())
    }
}

/// Pressure in kPa, lengths in metres.
fn other_units() -> HardCase {
    let mut data = database(&states());
    for c in &mut data.cases {
        c.pressure_mpa *= 1e3;
        c.gap_mm = c.gap_mm.map(|g| g * 1e-3);
    }
    let to_metres = |values: &mut [f32]| {
        for (i, v) in values.iter_mut().enumerate() {
            *v *= if i % 5 < 4 { 1e-3 } else { 1.0 };
        }
    };
    to_metres(&mut data.snapshots);
    data.undeformed_mm.iter_mut().flatten().flatten().for_each(|x| *x *= 1e-3);
    for range in [&mut data.obstacle.x_mm, &mut data.obstacle.z_mm] {
        *range = range.map(|v| v * 1e-3);
    }
    let mut queries = inside();
    for q in &mut queries {
        (q.pressure, q.gap) = (q.pressure * 1e3, q.gap * 1e-3);
        to_metres(&mut q.truth);
    }
    case("other units", "pressure in kPa, lengths in metres", data, queries)
}

/// Replaces the stress field everywhere, in database and truths.
fn with_stress(name: &str, hard: &str, stress: impl Fn(f64, usize, f32) -> f32) -> HardCase {
    let (mut data, mut queries) = (database(&states()), inside());
    let entries = data.entries();
    let replace = |values: &mut [f32], p: f64| {
        values.iter_mut().skip(4).step_by(5).enumerate().for_each(|(node, v)| *v = stress(p, node, *v));
    };
    for (i, c) in data.cases.iter().enumerate() {
        replace(&mut data.snapshots[i * entries..(i + 1) * entries], c.pressure_mpa);
    }
    queries.iter_mut().for_each(|q| replace(&mut q.truth, q.pressure));
    case(name, hard, data, queries)
}

fn constant() -> HardCase {
    with_stress("constant field", "stress the same in every case: no mode at all", |_, node, _| {
        1.0 + node as f32
    })
}

fn rank_one() -> HardCase {
    with_stress("rank one", "stress proportional to pressure: one mode, the rest rounding", |p, node, _| {
        (p * node as f64) as f32
    })
}

fn rank_deficient() -> HardCase {
    let hard = "stress a sum of two functions of pressure: two modes for forty cases";
    with_stress("rank-deficient", hard, |p, node, _| (p * node as f64 + p * p * (node % 7) as f64) as f32)
}

fn many_decades() -> HardCase {
    let hard = "stress whose modes differ by 14 decades";
    with_stress("14 decades", hard, |p, node, _| {
        let k = node % 8;
        (10.0_f64.powi(-2 * k as i32) * (1.0 + (p * 11.0 * (k + 1) as f64).cos())) as f32
    })
}

fn subnormal() -> HardCase {
    let hard = "every other stress entry is subnormal in f32 (1e-42)";
    with_stress("subnormal", hard, |_, node, v| if node % 4 == 1 { 1e-42 } else { v })
}

fn tiny_stress() -> HardCase {
    with_stress("starved stress", "stress seven decades under the coordinates", |_, _, v| v * 1e-6)
}

fn noisy() -> HardCase {
    let mut data = database(&training_states(20, 9, 8));
    let (entries, fields) = (data.entries(), data.fields.len());
    for (i, v) in data.snapshots.iter_mut().enumerate() {
        let size = if data.fields[i % fields].kind == FieldKind::Stress { 0.2 } else { 40.0 };
        *v += (1e-3 * size * noise(i + i / entries)) as f32;
    }
    let mut config = config();
    for regime in [&mut config.free, &mut config.contact] {
        regime.smoothing = vec![0.0, 1e-6, 1e-5, 1e-4, 1e-3];
    }
    let hard = "every entry off by up to 0.1 % of its field; smoothing left to leave-one-out";
    HardCase { config, ..case("noisy", hard, data, inside()) }
}

fn gaussian(shape: f64) -> HardCase {
    let mut config = config();
    for regime in [&mut config.free, &mut config.contact] {
        regime.kernels = vec![KernelSpec { kernel: KernelKind::Gaussian { shape }, tail: Tail::Linear }];
    }
    let hard = "flat Gaussians are all but linearly dependent, needles see no neighbour";
    let expected = if shape > 50.0 { Ending::Flagged } else { Ending::Correct };
    let data = database(&states());
    HardCase { config, expected, ..case(&format!("gaussian {shape}"), hard, data, inside()) }
}
